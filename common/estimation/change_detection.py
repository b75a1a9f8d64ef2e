"""Checks of what was learned: detects another tissue or grip, and predictions that are worse than the hold.

Change: the error of the plain expert is set against its usual size, the mean of the last 30 s. A clock runs
while it is over three times the usual and runs back while it is not; at half a second there is a kick, and
the long memory lets go. A reversal or an outlier is over before that. The usual then starts from the errors
of now, and the next kick is 10 s away at the earliest: one change is one kick, and what is merely harder to
predict none.

Trial: errors are summed over 2 s of motion. A trial is failed where the predictions' rms error is over twice
the hold's, beyond a fifth of the range of the forces of this trial and the one before. Then the learner
begins anew: it has learned from invalid forces (a sensor's garbage moves the memories of
`experts` and `blend`, which take minutes to fade, and the range of the forces, which never does). A trial
begins with nothing of the one before but that range, so that forces of any size are over after two of them.
"""

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from forefeel.common.jit import kernel

_USUAL_MEMORY_S = 30.0
_NOW_MEMORY_S = 0.5
_LARGE = 3.0
_PATIENCE_S = 0.5
_APART_S = 10.0
_LARGE_OF_RANGE = 1e-3
_TRIAL_S = 2.0
_FURTHER = 2.0
_FURTHER_OF_RANGE = 0.2


class Change(Protocol):
    """Sums of weighted |e| and of the weights in both memories; the clock; the time in s
    since the first error or the last kick."""

    usual: float
    weight: float
    now: float
    now_weight: float
    clock_s: float
    since_s: float


@kernel
def changed(change: Change, error_n: float, range_n: float, w: float) -> bool:
    """Updates the usual error of the plain expert by one of `w` seconds; True where a change is detected.

    That is after 0.5 s over three times the usual, but not in the first 10 s, nor within 10 s of the last
    one; the usual then restarts from the errors of now. It includes a thousandth of `range_n`, of the forces.
    """
    size_n = abs(error_n)
    usual_n = change.usual / (change.weight + 1e-9) + _LARGE_OF_RANGE * range_n
    large = size_n > _LARGE * usual_n
    keep, keep_now = math.exp(-w / _USUAL_MEMORY_S), math.exp(-w / _NOW_MEMORY_S)
    change.usual = change.usual * keep + w * size_n
    change.weight = change.weight * keep + w
    change.now = change.now * keep_now + w * size_n
    change.now_weight = change.now_weight * keep_now + w
    change.since_s += w
    change.clock_s = change.clock_s + w if large else max(0.0, change.clock_s - w)
    if change.clock_s < _PATIENCE_S or change.since_s < _APART_S:
        return False
    change.clock_s = change.since_s = 0.0
    change.usual, change.weight = change.now / change.now_weight, 1.0
    return True


class Trial(Protocol):
    """Time in s; sums of w e^2 of prediction and zero-order hold; ranges of the forces; 1 after a failure."""

    seconds: float
    predicted_n2: float
    held_n2: float
    low_n: float
    high_n: float
    low_before_n: float
    high_before_n: float
    failed: float


def begin(trial: NDArray[np.void]) -> None:
    """Initialises a record of zeros as one without forces."""
    trial["low_n"] = trial["low_before_n"] = np.inf
    trial["high_n"] = trial["high_before_n"] = -np.inf


@kernel
def judge(trial: Trial, force_n: float, predicted_n: float, held_n: float, w: float) -> None:
    """Adds `w` seconds of squared errors to a trial; every 2 s sets `failed` if due and restarts the sums.

    It is due if the mean square error of the prediction is NaN, or exceeds 4 times that of the zero-order
    hold, `held_n`, plus the square of a fifth of the range of forces in this and the last trial. Never clears
    `failed`.
    """
    trial.seconds += w
    trial.predicted_n2 += w * (force_n - predicted_n) ** 2
    trial.held_n2 += w * (force_n - held_n) ** 2
    trial.low_n, trial.high_n = min(trial.low_n, force_n), max(trial.high_n, force_n)
    if trial.seconds < _TRIAL_S:
        return
    range_n = max(trial.high_n, trial.high_before_n) - min(trial.low_n, trial.low_before_n)
    allowed_n2 = _FURTHER**2 * trial.held_n2 + (_FURTHER_OF_RANGE * range_n) ** 2 * trial.seconds
    if not trial.predicted_n2 <= allowed_n2:
        trial.failed = 1.0
    trial.low_before_n, trial.high_before_n = trial.low_n, trial.high_n
    trial.seconds = trial.predicted_n2 = trial.held_n2 = 0.0
    trial.low_n, trial.high_n = math.inf, -math.inf
