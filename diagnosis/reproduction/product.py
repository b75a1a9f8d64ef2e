"""The product's predictor on a recording, as `forefeel evaluate` replays it: it sees what arrives only."""

import numpy as np

from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.evaluation.arrivals import DelayedLink, arrivals
from forefeel.diagnosis.evaluation.methods import Forefeel
from forefeel.diagnosis.evaluation.replay import replay
from forefeel.diagnosis.reproduction.contact import Array
from forefeel.diagnosis.reproduction.online import held


def product_prediction(recording: Recording, delay_s: float) -> Array:
    """The force predicted for each sample, shape (n,); before anything has arrived the held one."""
    assert recording.force_n is not None
    trace = replay(recording, arrivals(recording.time_s, DelayedLink(delay_s)), Forefeel(None))
    return np.where(trace.answered, trace.force_n, held(recording.time_s, recording.force_n, delay_s))
