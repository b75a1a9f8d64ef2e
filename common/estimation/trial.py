"""Whether what was learned is worth keeping: not where the predictions are further off than the hold.

Errors are summed over trials of 2 s of motion. A trial is failed where the predictions' rms error is over
twice the hold's, beyond a thousandth of the range of the forces of this trial and the one before. Then the
learner begins anew: what it learned came from forces that were none (a sensor's garbage moves the memories
of `experts` and `blend`, which take minutes to fade, and the range of the forces, which never does). A
trial begins with nothing of the one before but that range, so that forces of any size are over after two of
them.
"""

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from forefeel.common.jit import kernel

TRIAL_S = 2.0
_FURTHER = 2.0
_OF_RANGE = 0.2


class Trial(Protocol):
    """Time in s; sums of w e^2 of what was said and of the zero-order hold; ranges of the forces;
    1 once one was failed.
    """

    seconds: float
    said_n2: float
    held_n2: float
    low_n: float
    high_n: float
    low_before_n: float
    high_before_n: float
    failed: float


def begin(trial: NDArray[np.void]) -> None:
    """Makes a record of zeros one that has seen nothing."""
    trial["low_n"] = trial["low_before_n"] = np.inf
    trial["high_n"] = trial["high_before_n"] = -np.inf


@kernel
def judge(trial: Trial, force_n: float, said_n: float, held_n: float, w: float) -> None:
    """A force, what was said of it and what the hold was; `w`: the time in s that it stands for."""
    trial.seconds += w
    trial.said_n2 += w * (force_n - said_n) ** 2
    trial.held_n2 += w * (force_n - held_n) ** 2
    trial.low_n, trial.high_n = min(trial.low_n, force_n), max(trial.high_n, force_n)
    if trial.seconds < TRIAL_S:
        return
    range_n = max(trial.high_n, trial.high_before_n) - min(trial.low_n, trial.low_before_n)
    allowed_n2 = _FURTHER**2 * trial.held_n2 + (_OF_RANGE * range_n) ** 2 * trial.seconds
    if not trial.said_n2 <= allowed_n2:
        trial.failed = 1.0
    trial.low_before_n, trial.high_before_n = trial.low_n, trial.high_n
    trial.seconds = trial.said_n2 = trial.held_n2 = 0.0
    trial.low_n, trial.high_n = math.inf, -math.inf
