"""Linear viscoelastic contact: the model of the paper."""

from common.effects.base import ForceEffect, Parameter


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

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(a, v, x)."""
        return (a, v, x)
