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

from typing import Protocol

import numpy as np


class Change(Protocol):
    """Sums of weighted |e| and of the weights in both memories; the clock; the time in s
    since the first error or the last kick."""

    usual: float
    weight: float
    now: float
    now_weight: float
    clock_s: float
    since_s: float


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


def begin(trial: np.void) -> None:
    """Initialises a record of zeros as one without forces."""
    trial["low_n"] = trial["low_before_n"] = np.inf
    trial["high_n"] = trial["high_before_n"] = -np.inf
