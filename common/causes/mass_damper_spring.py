"""Linear viscoelastic contact: the model of the paper."""

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.offline import Array


class MassDamperSpring(ForceEffect):
    """`f = m a + b v + k x`."""

    name = "mass_damper_spring"
    site = "wall"
    parameters = (
        Parameter("mass_kg", "kg", 0.01, 0.0, 1e4),
        Parameter("damping_n_s_m", "N s/m", 0.1, 0.0, 1e6),
        Parameter("stiffness_n_m", "N/m", 1.0, 0.0, 1e9),
    )
    reference = (
        "Study on Contact Force Prediction for the Vascular Interventional Surgical Robot "
        "Based on Parameter Identification, equation (1)"
    )
    fingerprint = "proportional to acceleration, velocity or position: ellipses without jumps or memory"

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(a, v, x)."""
        return (a, v, x)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        return np.stack((a, v, x)).T
