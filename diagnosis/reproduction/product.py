"""The product's predictor on a recording, as `forefeel evaluate` replays it: it sees what arrives only."""

import numpy as np

from common.recording.recording import Recording
from diagnosis.evaluation.arrivals import Link, arrivals
from diagnosis.evaluation.methods import Forefeel
from diagnosis.evaluation.replay import replay
from diagnosis.reproduction.contact import Array
from diagnosis.reproduction.online import held


def product_prediction(recording: Recording, delay_s: float) -> Array:
    """The force predicted for each sample, shape (n,); before anything has arrived the held one."""
    assert recording.force_n is not None
    trace = replay(recording, arrivals(recording.time_s, Link(delay_s)), Forefeel(None))
    return np.where(trace.answered, trace.force_n, held(recording.time_s, recording.force_n, delay_s))
