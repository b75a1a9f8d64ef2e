"""Viscous friction that differs between inserting and retracting."""

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.candidate import ForceColumns, Found, MotionGrid, Shape, Values
from forefeel.common.causes.offline import Array


def _bend(motion: MotionGrid, _shape: Shape) -> list[Array]:
    return [np.abs(motion.v)]


def _by_direction(found: Found) -> Values:
    (more,), damping = found.coefficients, found.base[1]
    return {"forward_n_s_m": damping + more, "backward_n_s_m": damping - more}


class AsymmetricDamping(ForceEffect):
    """`f = forward_n_s_m v` while inserting, `backward_n_s_m v` while retracting.

    It adds to the `damping_n_s_m` of a `mass_damper_spring`. Only the sums of that one and these are
    determined: where the damping is 0, these are the coefficients by direction.
    """

    name = "asymmetric_damping"
    site = "shaft"
    parameters = (
        Parameter("forward_n_s_m", "N s/m", 0.0, 0.0, 1e6),
        Parameter("backward_n_s_m", "N s/m", 0.0, 0.0, 1e6),
    )
    reference = "Janot, Gautier and Brunot, Data Set and Reference Models of EMPS, 2019, asymmetric friction"
    fingerprint = "two slopes over velocity that meet at rest: a share proportional to |v|"
    words = "damping that differs by direction"
    equation = ("{forward_n_s_m} max(x', 0) + {backward_n_s_m} min(x', 0)",)
    candidates = (
        ForceColumns(signs=(0,), columns=_bend, at_wall=True, naming=_by_direction, picture="speed"),
    )

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(max(v, 0), min(v, 0))."""
        return (v, 0.0) if v > 0.0 else (0.0, v)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        return np.stack((np.maximum(v, 0.0), np.minimum(v, 0.0))).T
