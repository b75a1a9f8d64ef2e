"""Plays a recording to a method as a master would have met it. Pure: no clock, no I/O."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from forefeel.common.error_size import Floats
from forefeel.common.estimation.evaluator import Estimate
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.evaluation.arrivals import Arrivals
from forefeel.diagnosis.evaluation.methods import Method, MethodEstimate

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class MethodTrace:
    """What a method said at each of n stamps.

    Attributes:
        answered: where it said something. force_n, low_n, high_n: NaN where it did not, or has no band.
        leading: the expert that led, None where there is none.
    """

    answered: Mask
    force_n: Floats
    low_n: Floats
    high_n: Floats
    leading: tuple[str | None, ...]


def replay(recording: Recording, arrivals: Arrivals, method: Method) -> MethodTrace:
    """At each stamp: the forces that have arrived since the last one, the own motion, then the prediction.

    After a gap the method is restarted, between the forces that arrived in the gap and the next motion.

    Raises:
        ValueError: the recording has no force.
    """
    if recording.force_n is None:
        raise ValueError(f"{recording.name}: no force")
    time_s, position_m, force_n = (
        column.tolist() for column in (recording.time_s, recording.position_m, recording.force_n)
    )
    starts = {piece.start for piece in recording.segments()[1:]}
    said: list[MethodEstimate | Estimate | None] = []
    for k, batch in enumerate(arrivals.batches()):
        for i in batch:
            method.observe(time_s[i], force_n[i])
        if k in starts:
            method.restart()
        method.move(time_s[k], position_m[k])
        said.append(method.predict())
    known = [estimate or MethodEstimate(np.nan) for estimate in said]
    columns = np.array([estimate[:3] for estimate in known], dtype=np.float64)  # None becomes NaN
    answered, leading = np.array([each is not None for each in said]), tuple(each.leading for each in known)
    return MethodTrace(answered, columns[:, 0], columns[:, 1], columns[:, 2], leading)
