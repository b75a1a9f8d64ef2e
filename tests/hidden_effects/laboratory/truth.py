"""A recording, and the truth about it."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Truth:
    """What is hidden in a recording. Forces are in N (N m of a joint), before the sign of the cell.

    Attributes:
        motion: description of world and motion.
        names: names of the vocabulary that are there, with the rms of what mass, damping, stiffness and bias
            cannot imitate of each, as a share of the force's standard deviation; the largest first.
        allowed: other names, or verdicts, that say the same of this world.
        separable: False where no method can tell the causes apart on this motion.
        sense: -1 where the cell shows the reaction.
        mass, damping, stiffness: None where they are no number of this world.
        parameters: (cause, parameter, value), where the vocabulary's own parameter is directly comparable.
        hidden: rms of all that mass, damping, stiffness and bias leave, as a share.
        left_n: rms of the unmodelled rest. noise_n: rms of the noise.
        outside: the largest effect has no name in the vocabulary.
    """

    kind: str
    seed: int
    motion: str
    names: tuple[tuple[str, float], ...]
    allowed: tuple[str, ...]
    separable: bool
    sense: float
    mass: float | None
    damping: float | None
    stiffness: float | None
    parameters: tuple[tuple[str, str, float], ...]
    hidden: float
    force_n: float
    left_n: float
    noise_n: float
    outside: bool


@dataclass(frozen=True, eq=False)
class Recorded:
    """What is in the file: position in m (rad), force in N (N m), and the header of each column.

    `force_clean`: force of the world at the stamps, without noise, rest and tare. `second`: the same world in
    another motion, which has no second itself. `further`: more columns by their header.
    """

    time_s: Array
    position: Array
    force: Array
    header: tuple[str, str, str]
    force_clean: Array
    second: "Recorded | None"
    truth: Truth
    further: dict[str, Array] = field(default_factory=dict)
