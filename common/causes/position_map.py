"""A force that belongs to the position: gravity, cogging, a guide that is not straight."""

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.offline import Array


def _sines(x: Array, period_m: float) -> list[Array]:
    phase = (2.0 * np.pi / period_m) * x
    return [np.sin(phase), np.cos(phase), np.sin(2.0 * phase), np.cos(2.0 * phase)]


_NAMES = "sine_n", "cosine_n", "second_sine_n", "second_cosine_n"


class PositionMap(ForceEffect):
    """`f = sum over j = 1, 2 of A_j sin(j p) + B_j cos(j p)`, p = 2 pi x / period_m.

    Periodic where the stroke holds several periods; of a period longer than the stroke a smooth map. No
    diagnosis looks for it: it would take the place of what is not understood.
    """

    name = "position_map"
    site = "shaft"
    parameters = (
        *(Parameter(name, "N", 0.0, -1e4, 1e4) for name in _NAMES),
        Parameter("period_m", "m", 0.01, 1e-6, 1e3, linear=False),
    )
    reference = "Fourier series; gravity of a joint: Armstrong, Khatib and Burdick, ICRA 1986"
    fingerprint = "a curve over position, the same in both directions, at any speed and at rest"

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """sin p, cos p, sin 2p, cos 2p."""
        return tuple(float(each) for each in _sines(np.asarray(x), self.values["period_m"]))

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        return np.stack(_sines(x, self.values["period_m"])).T
