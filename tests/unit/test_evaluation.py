"""The honest evaluation: arrivals, methods, scores and the document."""

import json

import numpy as np
import pytest

from forefeel.common.errors import ConfigurationError, RecordingError
from forefeel.common.estimation.evaluator import Estimate
from forefeel.diagnosis.evaluation.arrivals import DelayedLink, arrivals
from forefeel.diagnosis.evaluation.delays import delayed_links, most_usual
from forefeel.diagnosis.evaluation.evaluate import checked_model, evaluate, prepare, rules, to_json
from forefeel.diagnosis.evaluation.methods import LONGEST_LATENESS_S, METHODS, Pairs, replay
from tests.unit.evaluation_samples import made_up, recording, zoh_oracle
from tests.unit.model_samples import effect, model


def arrived_at(time_s: np.ndarray, link: DelayedLink) -> dict[int, int]:
    """The stamp (its index) at which each sample's force is new."""
    batches = arrivals(time_s, link).batches()
    assert len(batches) == len(time_s)
    return {i: k for k, batch in enumerate(batches) for i in batch}


def test_jitter_spreads_and_reorders_within_its_bounds() -> None:
    time_s = made_up(duration_s=30.0, gap_s=0.0).time_s
    link = DelayedLink(0.3, jitter_s=0.05, seed=4)
    batches = arrivals(time_s, link).batches()
    sequence = [i for batch in batches for i in batch]
    assert sequence != sorted(sequence)
    late_s = np.array([time_s[k] - time_s[i] for k, batch in enumerate(batches) for i in batch])
    assert late_s.min() >= 0.25
    assert late_s.max() <= 0.35 + 0.02  # up to the next stamp
    # uniform: its mean, and a third of the forces in the first third
    assert late_s.mean() == pytest.approx(0.305, abs=0.004)
    assert np.mean(late_s < 0.25 + 0.1 / 3 + 0.005) == pytest.approx(1 / 3, abs=0.04)


def test_no_force_is_there_before_its_own_stamp() -> None:
    time_s = made_up(duration_s=5.0).time_s
    found = arrived_at(time_s, DelayedLink(0.01, jitter_s=0.5))
    assert all(k >= i for i, k in found.items())
    assert sum(k == i for i, k in found.items()) > 100  # those that would be early


def test_loss_takes_its_share() -> None:
    time_s = np.arange(20_000) * 1e-3
    found = arrived_at(time_s, DelayedLink(0.0, loss=0.05, seed=1))
    assert 1 - len(found) / len(time_s) == pytest.approx(0.05, abs=0.006)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"delay_s": -0.1}, "delay_s = -0.1"), ({"delay_s": float("nan")}, "delay_s = nan"),
        ({"delay_s": 31.0}, "0 to 30 s"), ({"delay_s": 0.3, "jitter_s": float("inf")}, "jitter_s = inf"),
        ({"delay_s": 0.3, "loss": 1.0}, "loss = 1: expected a probability from 0 to below 1, 0.01 for 1 %"),
        ({"delay_s": 0.3, "loss": float("nan")}, "loss = nan"),
        ({"delay_s": 0.3, "seed": -1}, "seed = -1"),
    ],
)  # fmt: skip
def test_a_link_that_can_not_be_is_refused(wrong: dict[str, float], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        DelayedLink(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("delay_s", [0.0, 0.02, 0.3, 0.301, 100 / 7])
@pytest.mark.parametrize("uneven", [0.0, 0.3])
def test_zoh_is_its_definition(delay_s: float, uneven: float) -> None:
    sample = made_up(duration_s=5.0, uneven=uneven)
    assert sample.force_n is not None
    trace = replay(sample, arrivals(sample.time_s, DelayedLink(delay_s)), METHODS["zoh"](None))
    expected = zoh_oracle(sample.time_s, sample.force_n, delay_s)
    np.testing.assert_array_equal(trace.force_n, expected)
    np.testing.assert_array_equal(trace.answered, np.isfinite(expected))


def test_zoh_keeps_the_newest_stamp_whatever_the_order() -> None:
    zoh = METHODS["zoh"](None)
    assert zoh.predict() is None
    for stamp_s, force_n in (1.0, 10.0), (3.0, 30.0), (2.0, 20.0):
        zoh.observe(stamp_s, force_n)
    zoh.restart()
    zoh.move(4.0, 0.0)
    assert zoh.predict() == Estimate(30.0)


def test_the_paper_does_not_differentiate_across_a_gap() -> None:
    sample = made_up(duration_s=4.0)
    trace = replay(sample, arrivals(sample.time_s, DelayedLink(0.3)), METHODS["paper"](None))
    start = sample.segments()[1].start
    assert trace.answered[2:start].all()
    np.testing.assert_array_equal(trace.answered[start : start + 3], [False, False, True])


@pytest.mark.parametrize("name", ["mbk_bias", "forefeel"])
def test_on_a_contact_that_it_can_describe_a_model_beats_zoh(name: str) -> None:
    sample = made_up(duration_s=8.0)
    assert sample.force_n is not None
    late = arrivals(sample.time_s, DelayedLink(0.3))
    trace = replay(sample, late, METHODS[name](None))
    rows = (sample.time_s > 5.0) & trace.answered
    assert np.mean(rows[sample.time_s > 5.0]) > 0.95
    zoh_n = zoh_oracle(sample.time_s, sample.force_n, 0.3)
    error, zoh_error = trace.force_n - sample.force_n, zoh_n - sample.force_n
    assert np.std(error[rows]) < 0.4 * np.std(zoh_error[rows])


def test_late_forces_meet_the_motion_of_their_own_stamp() -> None:
    pairs = Pairs[str]()
    pairs.remember(1.0, "one")
    pairs.remember(2.0, "two")
    for stamp_s in 2.0, 1.5, 1.0:
        pairs.arrived(stamp_s, 10 * stamp_s)
    assert pairs.take() == [(1.0, "one", 10.0), (2.0, "two", 20.0)]
    assert pairs.take() == []
    pairs.remember(1.5 + LONGEST_LATENESS_S, "late")
    for stamp_s in 1.0, 2.0:
        pairs.arrived(stamp_s, 0.0)
    assert pairs.take() == [(2.0, "two", 0.0)]


LINK = DelayedLink(0.3)
SAMPLE = made_up(duration_s=6.0)


def test_when_nothing_arrives_nothing_is_scored() -> None:
    time_s = np.append(np.arange(3.0), 40.0)
    with pytest.raises(RecordingError, match="no force arrives before the end"):
        prepare(recording(time_s, time_s, time_s), DelayedLink(0.0, loss=0.999, seed=1))


def test_the_document_has_the_agreed_form_and_no_nan() -> None:
    link = DelayedLink(0.3, 0.01, 0.02, 5)
    evaluated = evaluate(prepare(SAMPLE, link), None)
    text = to_json(link, rules(link, None), {"one": evaluated}, {"two": "a reason"})
    document = json.loads(text, parse_constant=pytest.fail)
    keys = "schema", "delay_s", "jitter_s", "loss", "seed", "rules", "recordings", "skipped"
    assert tuple(document) == keys
    assert document["schema"] == "forefeel.evaluation/1"
    assert [document[name] for name in ("delay_s", "jitter_s", "loss", "seed")] == [0.3, 0.01, 0.02, 5]
    assert document["skipped"] == {"two": "a reason"}
    one = document["recordings"]["one"]
    keys = "samples", "duration_s", "rate_hz", "gaps", "notes", "methods", "regimes", "by_delay"
    assert tuple(one) == keys
    assert (one["samples"], one["gaps"]) == (600, 1)
    assert one["rate_hz"] == pytest.approx(100, rel=0.01)
    assert list(one["methods"]) == list(METHODS) == ["zoh", "paper", "mbk_bias", "forefeel"]
    error = ["rms_n", "p95_n", "max_n", "offset_s"]
    for name, method in one["methods"].items():
        band = ["coverage_95", "band_width_n", "leading_expert"] if name == "forefeel" else []
        assert list(method) == error + band
    assert list(one["regimes"]) == ["rest", "onset", "reversal", "cruise"]
    for regime in one["regimes"].values():
        assert list(regime) == ["share", "zoh_rms_n", "forefeel_rms_n"]
    rms_n = {name: method["rms_n"] for name, method in one["methods"].items()}
    assert one["by_delay"] == [{"delay_s": 0.3, "rms_n": rms_n}]
    assert one["methods"]["zoh"]["offset_s"] == pytest.approx(0.31, abs=0.01)  # and half a period, and jitter


def test_the_paper_overflows_on_a_long_pure_sine_at_1_khz_and_that_is_said() -> None:
    """At 1 kHz and lambda 0.96 the covariance leaves the range of floats after 17 s."""
    time_s = np.arange(0.0, 19.0, 1e-3)
    position_m = np.sin(time_s)
    sample = recording(time_s, position_m, position_m + 0.1 * np.cos(time_s))
    found = evaluate(prepare(sample, LINK), None).scores["paper"]
    assert found.diverged_at_s is not None
    assert 15.0 < found.diverged_at_s < 18.0
    assert found.size.rms_n is None


def test_what_is_said_at_several_delays_is_what_is_said_at_each_alone() -> None:
    links = delayed_links("60:300", 0.01, 0.02, 5)
    assert most_usual(links) == links[-1]
    found = evaluate(prepare(SAMPLE, links[-1]), None, links=links).by_delay
    assert list(found) == [0.06, 0.12, 0.25, 0.3]
    for link in links:
        assert found[link.delay_s] == evaluate(prepare(SAMPLE, link), None).scores
    zoh_n = [scores["zoh"].size.rms_n or 0.0 for scores in found.values()]
    assert zoh_n == sorted(zoh_n) and zoh_n[0] > 0.0


@pytest.mark.parametrize(
    ("text", "ms"),
    [("300", [300]), ("20:600", [20, 60, 120, 250, 300, 450, 600]), ("100:130.5", [100, 120, 130.5])],
)
def test_delays_are_one_or_a_range(text: str, ms: list[float]) -> None:
    assert [1e3 * link.delay_s for link in delayed_links(text, 0.0, 0.0, 0)] == pytest.approx(ms)


@pytest.mark.parametrize("text", ["", "x", "20:", "20:60:600", "600:20", "20:20", "nan", "-1", "20:31000"])
def test_other_delays_are_refused(text: str) -> None:
    with pytest.raises(ConfigurationError, match="delay"):
        delayed_links(text, 0.0, 0.0, 0)


def test_a_model_is_for_forefeel_alone_and_is_named() -> None:
    stiff = model(effect("mass_damper_spring"))
    own, given = (evaluate(prepare(SAMPLE, LINK), of).scores for of in (None, stiff))
    assert [name for name in METHODS if own[name] != given[name]] == ["forefeel"]
    with pytest.raises(ConfigurationError, match=r"m\.yaml: no linear parameter"):
        checked_model(model(effect("contact_loss")), "m.yaml")
