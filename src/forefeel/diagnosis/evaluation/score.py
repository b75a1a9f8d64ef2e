"""Errors and time offset of a method's predictions against the measured force; pure functions of arrays."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from forefeel.common.error_size import ErrorSize, Floats, error_size
from forefeel.common.time_offset import time_offset_s
from forefeel.diagnosis.evaluation.methods import Mask, MethodTrace

# s after the first stamp, and the delay, before scoring begins
SETTLING_S = 3.0
# times the largest force of the recording, beyond which a method has diverged
RUNAWAY = 100.0


@dataclass(frozen=True, slots=True)
class BandScore:
    """Coverage and width of the 95 % band.

    Attributes:
        coverage: share of the scored forces inside. width_n: its mean full width.
        leading: the expert that led most often at the scored stamps.
    """

    coverage: float | None = None
    width_n: float | None = None
    leading: str | None = None


@dataclass(frozen=True, slots=True)
class Score:
    """Size of the error and time offset (above 0: late); None where the method diverged, `diverged_at_s`
    after the first stamp.
    """

    size: ErrorSize
    offset_s: float | None = None
    diverged_at_s: float | None = None
    band: BandScore = BandScore()


def scored_stamps(time_s: Floats, delay_s: float, zoh: MethodTrace) -> Mask:
    """Mask of the stamps from 3 s + delay after the first one on at which a force has arrived."""
    return np.asarray((time_s - time_s[0] >= SETTLING_S + delay_s) & zoh.answered)


def completed(trace: MethodTrace, zoh: MethodTrace) -> Floats:
    """Predictions that count for a method: zoh's where it has none."""
    return np.where(trace.answered, trace.force_n, zoh.force_n)


def score(time_s: Floats, force_n: Floats, trace: MethodTrace, zoh: MethodTrace, rows: Mask) -> Score:
    """Score of one method over the scored stamps `rows`; zoh's prediction counts where it has none. All
    arrays have shape (n,).

    It diverged if a prediction at one of them is not finite or beyond 100 times the largest force recorded:
    then there is neither size nor band, but the time of the first such stamp, scored or not.
    """
    predicted_n = completed(trace, zoh)
    largest_n = float(np.abs(force_n).max())
    beyond = (largest_n > 0.0) & (np.abs(predicted_n) > RUNAWAY * largest_n)
    runaway = zoh.answered & (beyond | ~np.isfinite(predicted_n))
    if np.any(runaway & rows):
        first = int(np.flatnonzero(runaway)[0])
        return Score(ErrorSize(), diverged_at_s=float(time_s[first] - time_s[0]))
    size = error_size(predicted_n[rows], force_n[rows])
    offset_s = time_offset_s(time_s, np.where(rows, predicted_n, np.nan), force_n)
    return Score(size, offset_s, band=_band(force_n, trace, rows))


def _band(force_n: Floats, trace: MethodTrace, rows: Mask) -> BandScore:
    """Coverage and mean width of the 95 % band over the stamps of `rows` that have one, None without any; and
    the expert that led most often in `rows`, None where none did.
    """
    known = rows & np.isfinite(trace.low_n) & np.isfinite(trace.high_n)
    leading = Counter(trace.leading[k] for k in np.flatnonzero(rows) if trace.leading[k])
    most = leading.most_common(1)[0][0] if leading else None
    if not known.any():
        return BandScore(leading=most)
    low_n, high_n, true_n = trace.low_n[known], trace.high_n[known], force_n[known]
    inside = (low_n <= true_n) & (true_n <= high_n)
    return BandScore(float(np.mean(inside)), float(np.mean(high_n - low_n)), most)
