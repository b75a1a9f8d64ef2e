"""Force ripple over position: magnets of a linear motor, turns of a lead screw."""

from math import cos, pi, sin

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.numerics import Array


class Cogging(ForceEffect):
    """`f = sine_n sin(2 pi x / pitch_m) + cosine_n cos(2 pi x / pitch_m)`."""

    name = "cogging"
    site = "shaft"
    parameters = (
        Parameter("sine_n", "N", 0.0, -1e3, 1e3),
        Parameter("cosine_n", "N", 0.0, -1e3, 1e3),
        Parameter("pitch_m", "m", 0.002, 1e-6, 10.0, linear=False),
    )
    reference = "Gieras, Piech and Tomczuk, Linear Synchronous Motors, 2nd ed., chapter 4"
    fingerprint = "a ripple over position with a constant pitch, the same at any speed and in both directions"

    def _configure(self) -> None:
        self._per_metre = 2.0 * pi / self.values["pitch_m"]

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(sin(2 pi x / pitch), cos(2 pi x / pitch)): one per linear parameter, in their order."""
        turn = self._per_metre * x
        return (sin(turn), cos(turn))

    def columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        # may be left out: the same over a whole recording, so that a diagnosis need not loop in Python
        turn = self._per_metre * x
        return np.stack((np.sin(turn), np.cos(turn))).T
