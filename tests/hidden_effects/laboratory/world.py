"""What every world of a laboratory has: two motions, the parts of its force in both, and how it is measured.

A part is named as the vocabulary names it; "" is mass, damper and spring. Sizes are drawn as shares of the
force of the first motion, so that they are neither lost nor all there is.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from tests.hidden_effects.laboratory.motion import OVER, Motion, Rng, moved
from tests.hidden_effects.laboratory.truth import Array

Parts = dict[str, Array]


@dataclass(frozen=True, eq=False)
class World:
    """Two motions of one world, the parts of its force in each, and how it is measured.

    `rough`: rms noise of the position, in its unit. `step`: of the encoder. `noise`, `rest`: as shares of the
    force's standard deviation. `over`: steps of the motions' grid per sample. `lost`: share of the samples
    that are not in the file. `late`: samples by which the force is read late at most. `timed`: parts of a
    clock of their own, whose lateness does not show. `further`: more columns of the file, along each motion.
    """

    words: str
    rate_hz: float
    motions: tuple[Motion, Motion]
    parts: tuple[Parts, Parts]
    noise: float
    rest: float
    step: float
    rough: float = 0.0
    angular: bool = False
    sense: float = 1.0
    allowed: tuple[str, ...] = ()
    separable: bool = True
    outside: bool = False
    base: tuple[float | None, float | None, float | None] = (None, None, None)
    parameters: tuple[tuple[str, str, float], ...] = ()
    numbers: dict[str, float] = field(default_factory=dict)
    over: int = OVER
    lost: float = 0.0
    late: float = 0.5
    timed: tuple[str, ...] = ()
    further: tuple[Parts, Parts] = field(default_factory=lambda: ({}, {}))


def total(parts: Parts) -> Array:
    return np.asarray(sum(parts.values()))


def std(values: Array) -> float:
    return float(np.std(values))


def two_motions(path: Callable[[], Array], t: Array, settles_s: float) -> tuple[Motion, Motion]:
    return moved(t, path(), settles_s), moved(t, path(), settles_s)


def sense_of(rng: Rng) -> float:
    return 1.0 if rng.random() < 0.6 else -1.0
