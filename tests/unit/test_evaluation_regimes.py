import numpy as np
import pytest

from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.evaluation.evaluate import notes
from forefeel.diagnosis.evaluation.regimes import REGIMES, RegimeScore, by_regime, regimes
from tests.unit.evaluation_samples import Floats, made_up, recording

RATE_HZ = 1000.0
PARTS = (
    ("rest", 1.0), ("forward", 2.0), ("backward", 2.0), ("short stop", 0.15), ("backward", 1.0),
    ("rest", 1.0),
)  # fmt: skip
"""What the operator does, and for how many s."""
SPEED_M_S = {"rest": 0.0, "short stop": 0.0, "forward": 0.01, "backward": -0.01}
EXPECTED = (
    ("rest", 0.0, 1.0), ("onset", 1.0, 1.3), ("cruise", 1.3, 3.0),
    ("reversal", 3.0, 3.3), ("cruise", 3.3, 6.15), ("rest", 6.15, 7.15),
)  # fmt: skip
BLUR_S = 0.03  # that of a difference over 50 ms


def strokes(noise_m: float = 0.0) -> Recording:
    speed = np.concatenate([np.full(round(s * RATE_HZ), SPEED_M_S[what]) for what, s in PARTS])
    x = np.cumsum(speed) / RATE_HZ + noise_m * np.random.default_rng(1).choice([-1.0, 1.0], len(speed))
    return recording(np.arange(len(x)) / RATE_HZ, x, np.zeros(len(x)))


def names(of: Recording) -> list[str]:
    return [REGIMES[number] for number in regimes(of)]


@pytest.mark.parametrize("noise_m", [0.0, 1e-6], ids=["clean", "dither of an encoder"])
def test_each_regime_is_where_its_definition_says(noise_m: float) -> None:
    sample = strokes(noise_m)
    found = names(sample)
    for name, start_s, stop_s in EXPECTED:
        inside = (sample.time_s > start_s + BLUR_S) & (sample.time_s < stop_s - BLUR_S)
        assert {found[k] for k in np.flatnonzero(inside)} == {name}


def test_onset_in_the_other_direction_is_no_reversal() -> None:
    t = np.arange(4000) / RATE_HZ
    x = 0.01 * (np.minimum(t, 1.0) - np.maximum(t - 2.0, 0.0))
    found = names(recording(t, x, t))
    assert found.count("onset") == pytest.approx(300, abs=1)
    assert found.count("reversal") <= 1  # v turns with the first sample of the onset


def test_gap_ends_a_rest_and_forgets_the_direction() -> None:
    sample = strokes()
    after = np.where(sample.time_s < 0.9, 0.0, np.where(sample.time_s < 3.0, 1.0, 2.0))
    cut = (sample.time_s < 0.9) | ((sample.time_s > 1.05) & (sample.time_s < 2.9)) | (sample.time_s > 3.05)
    found = names(recording(sample.time_s[cut] + after[cut], sample.position_m[cut], sample.time_s[cut]))
    assert "reversal" not in found
    assert "onset" not in found
    assert {"rest", "cruise"} == set(found)


@pytest.mark.parametrize("period_s", [0.001, 0.016, 0.09])
def test_standstill_is_rest_and_constant_speed_cruise_at_any_rate(period_s: float) -> None:
    t = np.arange(0.0, 6.0, period_s)
    assert set(names(recording(t, np.zeros(len(t)), t))) == {"rest"}
    assert set(names(recording(t, 0.01 * t, t))) == {"cruise"}


def test_samples_without_neighbours_cruise() -> None:
    t = np.arange(10.0)
    assert set(names(recording(t, np.zeros(10), t))) == {"cruise"}


def test_regimes_share_the_scored_samples_and_the_squared_error() -> None:
    sample, rng = strokes(), np.random.default_rng(4)
    n = len(sample)
    rows = sample.time_s > 2.0
    force_n, zoh_n, forefeel_n = (rng.normal(0, 1, n) for _ in range(3))
    scores = by_regime(regimes(sample), rows, force_n, zoh_n, forefeel_n)
    assert sum(score.share for score in scores.values()) == pytest.approx(1.0, rel=1e-12)

    def whole(which: str) -> float:
        return sum(score.share * (getattr(score, which) or 0.0) ** 2 for score in scores.values())

    assert whole("zoh_rms_n") == pytest.approx(np.mean((zoh_n - force_n)[rows] ** 2), rel=1e-12)
    assert whole("forefeel_rms_n") == pytest.approx(np.mean((forefeel_n - force_n)[rows] ** 2), rel=1e-12)
    assert scores["onset"] == RegimeScore(0.0)  # it is over before the first scored sample


# --- notes ---


def said(time_s: Floats, position_m: Floats) -> str:
    return "; ".join(notes(recording(time_s, position_m, np.zeros(len(time_s)))))


def test_uneven_sampling_is_said_with_its_spread() -> None:
    time_s = np.arange(2000, dtype=np.float64) * 0.005
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
