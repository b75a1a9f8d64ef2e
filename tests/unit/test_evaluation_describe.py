import numpy as np

from forefeel.diagnosis.evaluation.evaluate import notes
from tests.unit.evaluation_samples import Floats, made_up, recording

TIME_S: Floats = np.arange(2000, dtype=np.float64) * 0.005


def said(time_s: Floats, position_m: Floats) -> str:
    return "; ".join(notes(recording(time_s, position_m, np.zeros(len(time_s)))))


def test_uneven_sampling_is_said_with_its_spread() -> None:
    time_s = TIME_S.copy()
    time_s[1::2] += 0.001  # periods of 6 and 4 ms in turn
    text = said(time_s, 0.01 * np.sin(time_s))
    assert "not sampled uniformly" in text
    assert "4 to 6 ms" in text


def test_gaps_are_counted_and_placed() -> None:
    sample = made_up(gap_s=0.4)
    assert "1 gap over 0.1 s, not bridged: 0.41 s at 3.99 s" in "; ".join(notes(sample))
    time_s = np.concatenate([np.arange(0, 1, 0.01) + 2 * k for k in range(8)])
    assert "7 gaps" in said(time_s, np.sin(time_s))
    assert "and 2 more" in said(time_s, np.sin(time_s))
