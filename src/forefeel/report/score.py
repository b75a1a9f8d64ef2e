"""Scores of the prediction, command by command; pure functions of arrays.

A prediction is made for a command. What it should have been is known later: the first force that the slave
measured while it followed the motion from that command to the next. So both are paired by the stamp that the
force brings back, and neither delay nor loss of the network enters the score. The baseline is to go on
showing the newest force that had arrived (a zero-order hold, ZOH); it is scored on the same commands.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forefeel.common.error_size import ErrorSize, Floats, error_size
from forefeel.common.slots import ANSWERED_NS

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class PredictionComparison:
    """Prediction and zoh, both on the same `commands` (their number); `ratio` of their rms."""

    commands: int = 0
    prediction: ErrorSize = field(default_factory=ErrorSize)
    zoh: ErrorSize = field(default_factory=ErrorSize)
    ratio: float | None = None


@dataclass(frozen=True, slots=True)
class Spread:
    """Quantiles (linear between samples), maximum and mean; None without a value."""

    p50: float | None = None
    p99: float | None = None
    max: float | None = None
    mean: float | None = None


def first_answers(
    commands: tuple[NDArray[Any], NDArray[Any]],
    answered: tuple[NDArray[Any], NDArray[Any]],
    answer_stamp_ns: NDArray[Any],
) -> Indices:
    """Index, for each command, of the force that answers it first by the slave's stamps; -1: none does. A
    force answers the newest command of its session up to the motion that it names, unless that command is
    5 ms or more older than the motion.

    Args:
        commands: (session ids, stamps in ns) of n commands, in any order.
        answered: (session ids, stamps in ns of the answered motions) of m forces, in any order.
        answer_stamp_ns: the m forces' stamps.
    """
    answers = np.full(len(commands[0]), -1)
    newest_first = np.argsort(-answer_stamp_ns, kind="stable")
    for session_id in np.unique(commands[0]):
        sent = np.flatnonzero(commands[0] == session_id)
        sent = sent[np.argsort(commands[1][sent], kind="stable")]
        sent_ns = commands[1][sent].astype(np.float64)
        forces = newest_first[answered[0][newest_first] == session_id]
        place = np.searchsorted(sent_ns, answered[1][forces], "right") - 1
        known = (place >= 0) & (answered[1][forces] - sent_ns[place] < ANSWERED_NS)
        # where several answer, the last one that is written stays
        answers[sent[place[known]]] = forces[known]
    return answers


def first_of_each(session_id: NDArray[Any], sequence: NDArray[Any]) -> Indices:
    """Ascending indices at which each pair of session and sequence occurs for the first time."""
    return np.sort(np.unique(_codes(session_id, sequence), return_index=True)[1])


def _codes(session_id: NDArray[Any], sequence: NDArray[Any]) -> Indices:
    """One integer for each pair: ids have 63 bits and would not be exact in a float."""
    session = np.unique(session_id, return_inverse=True)[1]
    number = np.unique(sequence, return_inverse=True)[1]
    return np.asarray(session * (number.max(initial=0) + 1) + number, dtype=np.int64)


def stretches(answers_sequence: Floats, stamp_ns: NDArray[Any]) -> Indices:
    """Number, for each force, of the unbroken run of forces that answer a command, counted from 1 in the
    order of the stamps; -1 for a force that answers none. A gap in the stamps ends no run.

    Args:
        answers_sequence: of the command that each force answers, NaN for none.
        stamp_ns: of each force.
    """
    order = np.argsort(stamp_ns, kind="stable")
    following = ~np.isnan(answers_sequence[order])
    begins = following & ~np.append(False, following[:-1])[: len(following)]
    numbers = np.empty(len(order), dtype=np.int64)
    numbers[order] = np.where(following, np.cumsum(begins), -1)
    return numbers


def of_one_stretch(stretch: Indices) -> NDArray[np.bool_]:
    """Mask of the commands that were executed, or lie between two executed ones of the same stretch.

    Args:
        stretch: in which each command was executed, in the order of sending; -1: it was not executed.
    """
    rows = np.arange(len(stretch))
    known = stretch >= 0
    before = np.maximum.accumulate(np.where(known, rows, -1))
    after = np.minimum.accumulate(np.where(known, rows, len(stretch))[::-1])[::-1]
    edged = np.append(stretch, -1)  # the first and the last command have nothing beyond them
    return np.asarray((edged[before] == edged[after]) & (edged[before] >= 0))


def scored(predicted_n: Floats, zoh_n: Floats, force_n: Floats) -> NDArray[np.bool_]:
    """Marks the commands for which all three exist (are not NaN)."""
    return np.isfinite(predicted_n) & np.isfinite(zoh_n) & np.isfinite(force_n)


def compare(predicted_n: Floats, zoh_n: Floats, force_n: Floats) -> PredictionComparison:
    """Errors of prediction and zoh over the commands where both and the answer exist."""
    rows = scored(predicted_n, zoh_n, force_n)
    prediction = error_size(predicted_n[rows], force_n[rows])
    zoh = error_size(zoh_n[rows], force_n[rows])
    ratio = prediction.rms_n / zoh.rms_n if prediction.rms_n is not None and zoh.rms_n else None
    return PredictionComparison(int(np.count_nonzero(rows)), prediction, zoh, ratio)


def spread(values: Floats) -> Spread:
    known = values[np.isfinite(values)]
    if not len(known):
        return Spread()
    p50, p99 = np.quantile(known, (0.50, 0.99)).tolist()
    return Spread(p50, p99, float(known.max()), float(known.mean()))
