import numpy as np
import pytest

from forefeel.diagnosis.evaluation.describe import notes
from tests.unit.evaluation_samples import Floats, made_up, recording

TIME_S: Floats = np.arange(2000, dtype=np.float64) * 0.005
NOISE = np.random.default_rng(8).normal(0, 1, len(TIME_S))
NOTHING = "motion tells nothing, expect the zero-order hold"


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


@pytest.mark.parametrize(
    "position_m",
    [np.zeros(len(TIME_S)), np.full(len(TIME_S), 0.02), 0.02 + 1e-6 * NOISE],
    ids=["zero", "elsewhere", "noise"],
)
def test_standing_still_is_said(position_m: Floats) -> None:
    assert f"position does not move: {NOTHING}" in said(TIME_S, position_m)


@pytest.mark.parametrize("noise_m", [0.0, 1e-6, 2e-5])
def test_constant_speed_is_said(noise_m: float) -> None:
    text = said(TIME_S, 1e-3 * TIME_S + noise_m * NOISE)
    assert f"position moves at constant speed, 1 mm/s: {NOTHING}" in text
    assert "constant speed, 1 mm/s" in said(TIME_S, -1e-3 * TIME_S)


def test_a_short_standstill_before_constant_speed_is_counted() -> None:
    text = said(TIME_S, 1e-3 * np.maximum(TIME_S - 0.4, 0.0))
    assert "constant speed" in text
    assert ", 95 % of the time" in text


@pytest.mark.parametrize("hz", [0.05, 0.5, 5.0])
@pytest.mark.parametrize("noise_m", [0.0, 1e-5])
def test_motion_that_tells_something_is_not_called_nothing(hz: float, noise_m: float) -> None:
    text = said(TIME_S, 0.01 * np.sin(2 * np.pi * hz * TIME_S) + noise_m * NOISE)
    assert "tells nothing" not in text
