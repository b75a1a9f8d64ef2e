"""Friction that grows with the inserted length."""

from common.effects.base import ForceEffect, Parameter
from common.effects.direction import direction


class PositionDependentFriction(ForceEffect):
    """`f = force_per_length_n_m max(x, 0) sign(v)`: the capstan's law to first order in the length.

    The sign is that of `direction`: continuous within 10 um/s of rest, zero at rest.
    """

    name = "position_dependent_friction"
    site = "wall"
    parameters = (Parameter("force_per_length_n_m", "N/m", 0.0, 0.0, 1e6),)
    reference = "capstan (Euler-Eytelwein) equation, linearised in the length of contact"

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(inserted length times direction,)."""
        return (x * direction(v) if x > 0.0 else 0.0,)
