"""A force that belongs to the position: gravity, cogging, a guide that is not straight."""

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.candidate import Extent, MotionGrid, PositionWave, Shape, log_grid
from forefeel.common.causes.offline import Array

_LEAST_SCORE = 30.0  # chosen: of hundreds of periods the best of pure noise gains up to half of that


def _sines(x: Array, period_m: float) -> list[Array]:
    phase = (2.0 * np.pi / period_m) * x
    return [np.sin(phase), np.cos(phase), np.sin(2.0 * phase), np.cos(2.0 * phase)]


def _waves(motion: MotionGrid, shape: Shape) -> list[Array]:
    return _sines(motion.x, shape[0])


def _periods(extent: Extent) -> list[Shape]:
    return log_grid(extent.range_m / 20.0, extent.range_m / 3.0, 4)


_NAMES = "sine_n", "cosine_n", "second_sine_n", "second_cosine_n"


class PositionMap(ForceEffect):
    """`f = sum over j = 1, 2 of A_j sin(j p) + B_j cos(j p)`, p = 2 pi x / period_m.

    Periodic where the stroke holds several periods; of a period longer than the stroke a smooth map, which
    no diagnosis looks for: it would take the place of a spring, a wall or a friction that is not understood.
    """

    name = "position_map"
    site = "shaft"
    parameters = (
        *(Parameter(name, "N", 0.0, -1e4, 1e4) for name in _NAMES),
        Parameter("period_m", "m", 0.01, 1e-6, 1e3, linear=False),
    )
    reference = "Fourier series; gravity of a joint: Armstrong, Khatib and Burdick, ICRA 1986"
    fingerprint = "a curve over position, the same in both directions, at any speed and at rest"
    words = "a force that belongs to the position, such as cogging or a screw's pitch"
    equation = (
        "{sine_n} sin(p) + {cosine_n} cos(p) + {second_sine_n} sin(2 p) + {second_cosine_n} cos(2 p), "
        "p = 2 pi x/{period_m}",
    )
    candidates = (
        PositionWave(
            coefficients=_NAMES, shapes=("period_m",), signs=(0,) * 4, columns=_waves, grid=_periods,
            costly=True, least_score=_LEAST_SCORE, picture="position",
        ),
    )  # fmt: skip

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """sin p, cos p, sin 2p, cos 2p."""
        return tuple(float(each) for each in _sines(np.asarray(x), self.values["period_m"]))

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        return np.stack(_sines(x, self.values["period_m"])).T
