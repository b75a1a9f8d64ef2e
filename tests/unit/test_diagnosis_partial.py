"""Partial answers: what stands beside structure, what is left, what would have shown."""

import numpy as np
import pytest

from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.analysis import analyse
from forefeel.diagnosis.diagnose import diagnose
from forefeel.diagnosis.judge import Judge, judged
from forefeel.diagnosis.verdict import Diagnosis
from forefeel.results.verdict_text import answer
from tests.unit.evaluation_samples import Floats

RATE_HZ, NOISE_N = 100.0, 2e-3


def strokes(seconds: float = 20.0) -> tuple[Floats, Floats, Floats]:
    """Stamps, positions over 16 mm that never repeat, and speeds."""
    t = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    x = 5e-3 * np.sin(2.1 * t) + 2e-3 * np.sin(5.3 * t + 1.0) + 1e-3 * np.sin(13.7 * t)
    return t, x, np.gradient(x, t)


def recorded(t: Floats, x: Floats, more_n: Floats) -> Recording:
    noise = np.random.default_rng(5).normal(0.0, NOISE_N, len(t))
    return Recording("part", t, x, 40.0 * x + 0.5 * np.gradient(x, t) + more_n + noise, "part.csv")


def found_in(t: Floats, x: Floats, more_n: Floats) -> Diagnosis:
    return diagnose(recorded(t, x, more_n)).diagnosis


def test_friction_beside_a_bump_without_a_name_is_named_and_the_bump_is_shown() -> None:
    t, x, v = strokes()
    bump = 0.06 * np.exp(-0.5 * ((x - 3e-3) / 1.2e-3) ** 2)
    found = found_in(t, x, 0.12 * np.sign(v) + bump)
    assert found.verdict == "partly_explained"
    assert found.causes[0].name == "coulomb_friction"
    assert found.causes[0].parameters["force_n"].value == pytest.approx(0.12, rel=0.1)
    assert found.held_out.gain_low > 0.3
    first = found.follows[0]
    assert first.variable == "position"
    assert first.share > 0.5
    assert found.next_motion is not None
    assert found.next_motion.low_m is not None and found.next_motion.high_m is not None
    assert found.next_motion.low_m < 3e-3 < found.next_motion.high_m
    assert found.next_motion.high_m - found.next_motion.low_m < 0.7 * np.ptp(x)
    lines = answer(recorded(t, x, bump), found, None)
    assert any(line.startswith("Follows") and "position" in line for line in lines)
    assert any("forefeel investigate" in line for line in lines)


def test_a_wandering_force_is_no_bias_and_not_nothing() -> None:
    t, x, _ = strokes()
    walk = np.cumsum(np.random.default_rng(2).standard_normal(len(t)))
    found = found_in(t, x, 0.05 + 0.03 * walk / np.std(walk))
    assert (found.verdict, found.causes) == ("unexplained", ())
    assert found.follows[0].variable == "time"
    assert found.next_motion is not None and found.next_motion.words is None


def test_a_weight_that_stands_upright_is_a_negative_stiffness() -> None:
    t, x, v = strokes()
    a = np.gradient(v, t)
    noise = np.random.default_rng(6).normal(0.0, NOISE_N, len(t))
    force = 0.1 * a + 0.5 * v - 30.0 * x + 0.05 * np.sign(v) + noise
    found = diagnose(Recording("upright", t, x, force, "upright.csv")).diagnosis
    assert "force_is_the_reaction" not in found.flags
    assert [cause.name for cause in found.causes if cause.name != "bias"] == ["coulomb_friction"]
    assert found.extended.parameters["stiffness_n_m"] == pytest.approx(-30.0, rel=0.02)
    assert found.extended.parameters["mass_kg"] == pytest.approx(0.1, rel=0.05)


def test_what_would_have_shown_is_named_above_that_size_and_not_far_below() -> None:
    t, x, v = strokes()
    nothing = found_in(t, x, np.zeros_like(t))
    assert nothing.verdict == "nothing_missing"
    least_n = nothing.detectable["coulomb_friction.force_n"]
    assert "dry friction above" in "\n".join(answer(recorded(t, x, np.zeros_like(t)), nothing, None))
    above = found_in(t, x, 1.5 * least_n * np.sign(v))
    assert [cause.name for cause in above.causes] == ["coulomb_friction"]
    assert found_in(t, x, 0.4 * least_n * np.sign(v)).causes == ()


def test_a_bias_that_is_dropped_stays_open_to_what_is_searched_for_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Friction in proportion to a load takes a weight for itself; without it the weight may come back."""
    t, x, v = strokes(8.0)
    doubts = iter(["bias", "coulomb_friction"])
    monkeypatch.setattr(Judge, "doubted", lambda _: next(doubts, None))
    both = analyse(recorded(t, x, 0.5 + 0.12 * np.sign(v)), names=["bias", "coulomb_friction"])
    assert set(both.fit.model) == {"bias", "coulomb_friction"}
    assert "bias" in judged(both)[1].search.names
