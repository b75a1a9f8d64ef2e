"""Force ripple over position: magnets of a linear motor, turns of a lead screw."""

from math import pi

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.motion import Kinematics, Value


class Cogging(ForceEffect):
    """`f = sine_n sin(2 pi x / pitch_m) + cosine_n cos(2 pi x / pitch_m)`."""

    name = "cogging"
    site = "shaft"
    parameters = (
        Parameter("sine_n", "N", 0.0, -1e3, 1e3),
        Parameter("cosine_n", "N", 0.0, -1e3, 1e3),
        Parameter("pitch_m", "m", 0.002, 1e-6, 10.0, linear=False),
    )
    picture = "position"
    reference = "Gieras, Piech and Tomczuk, Linear Synchronous Motors, 2nd ed., chapter 4"
    fingerprint = "a ripple over position with a constant pitch, the same at any speed and in both directions"

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        """(sin, cos) of 2 pi x / pitch_m: one per linear parameter, in their order."""
        turn = 2.0 * pi / self.values["pitch_m"] * m.x
        return m.sin(turn), m.cos(turn)
