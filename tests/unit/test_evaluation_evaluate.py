import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from forefeel.common.causes.model import ContactModel
from forefeel.common.errors import ConfigurationError, RecordingError
from forefeel.diagnosis.evaluation.arrivals import DelayedLink
from forefeel.diagnosis.evaluation.evaluate import checked_model, evaluate, prepare, rules, to_json
from forefeel.diagnosis.evaluation.methods import METHODS
from forefeel.diagnosis.evaluation.score import BandScore
from tests.unit.evaluation_samples import hold_oracle, made_up, recording

LINK = DelayedLink(0.3)
SAMPLE = made_up(duration_s=6.0)


def no_number(name: str) -> None:
    raise AssertionError(f"{name} in JSON")


def test_the_hold_is_scored_as_numpy_does() -> None:
    assert SAMPLE.force_n is not None
    error = hold_oracle(SAMPLE.time_s, SAMPLE.force_n, 0.3) - SAMPLE.force_n
    error = error[SAMPLE.time_s - SAMPLE.time_s[0] >= 3.3]
    size = evaluate(prepare(SAMPLE, LINK), None).scores["zoh"].size
    assert size.rms_n == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-12)
    assert size.p95_n == pytest.approx(np.quantile(np.abs(error), 0.95), rel=1e-12)
    assert size.max_n == pytest.approx(np.max(np.abs(error)), rel=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda: recording(SAMPLE.time_s, SAMPLE.position_m, None), "made-up.csv: no force"),
        (lambda: made_up(duration_s=2.8, gap_s=0.0), r"2\.79 s long, expected at least 3\.3 s"),
        (lambda: recording(np.array([0.0, 10.0]), np.zeros(2), np.zeros(2)), None),
    ],
    ids=["no force", "short", "two samples"],
)
def test_what_can_not_be_scored_is_refused(change: Callable[[], object], words: str | None) -> None:
    sample = change()
    if words is None:  # few samples, but there is one to score
        assert prepare(sample, LINK).rows.sum() == 1  # type: ignore[arg-type]
        return
    with pytest.raises(RecordingError, match=words):
        prepare(sample, LINK)  # type: ignore[arg-type]


def test_when_nothing_arrives_nothing_is_scored() -> None:
    time_s = np.append(np.arange(3.0), 40.0)
    with pytest.raises(RecordingError, match="no force arrives before the end"):
        prepare(recording(time_s, time_s, time_s), DelayedLink(0.0, loss=0.999, seed=1))


def test_the_document_has_the_agreed_form_and_no_nan() -> None:
    link = DelayedLink(0.3, 0.01, 0.02, 5)
    evaluated = evaluate(prepare(SAMPLE, link), None)
    text = to_json(link, rules(link, None), {"one": evaluated}, {"two": "a reason"})
    document = json.loads(text, parse_constant=no_number)
    assert list(document) == [
        "schema", "delay_s", "jitter_s", "loss", "seed", "rules", "recordings", "skipped",
    ]  # fmt: skip
    assert document["schema"] == "forefeel.evaluation/1"
    assert [document[name] for name in ("delay_s", "jitter_s", "loss", "seed")] == [0.3, 0.01, 0.02, 5]
    assert document["skipped"] == {"two": "a reason"}
    one = document["recordings"]["one"]
    assert list(one) == ["samples", "duration_s", "rate_hz", "gaps", "notes", "methods"]
    assert (one["samples"], one["gaps"]) == (600, 1)
    assert one["rate_hz"] == pytest.approx(100, rel=0.01)
    assert list(one["methods"]) == list(METHODS) == ["zoh", "paper", "mbk_bias", "forefeel"]
    for name in "zoh", "paper", "mbk_bias":
        assert list(one["methods"][name]) == ["rms_n", "p95_n", "max_n"]
    assert list(one["methods"]["forefeel"]) == [
        "rms_n", "p95_n", "max_n", "coverage_95", "band_width_n", "leading_expert",
    ]  # fmt: skip
    assert any("2 % of them are lost" in rule for rule in document["rules"])


def test_a_method_that_diverged_says_when_and_has_null() -> None:
    evaluated = evaluate(prepare(SAMPLE, LINK), None)
    from forefeel.common.error_size import ErrorSize
    from forefeel.diagnosis.evaluation.score import Score

    scores = {**evaluated.scores, "paper": Score(ErrorSize(), 4.25, BandScore())}
    text = to_json(LINK, (), {"one": replace(evaluated, scores=scores)}, {})
    paper = json.loads(text)["recordings"]["one"]["methods"]["paper"]
    assert paper == {"rms_n": None, "p95_n": None, "max_n": None, "diverged_at_s": 4.25}


def test_the_paper_overflows_on_a_long_pure_sine_at_1_khz_and_that_is_said() -> None:
    """At 1 kHz and lambda 0.96 the covariance leaves the range of floats after 17 s."""
    time_s = np.arange(0.0, 19.0, 1e-3)
    position_m = np.sin(time_s)
    sample = recording(time_s, position_m, position_m + 0.1 * np.cos(time_s))
    found = evaluate(prepare(sample, LINK), None).scores["paper"]
    assert found.diverged_at_s is not None
    assert 15.0 < found.diverged_at_s < 18.0
    assert found.size.rms_n is None


@pytest.mark.parametrize("speed_m_s", [0.0, 1e-3])
def test_motion_that_tells_nothing_still_has_numbers(speed_m_s: float) -> None:
    time_s = np.arange(0.0, 8.0, 0.01)
    force_n = 0.1 + 0.01 * np.sin(7 * time_s)
    evaluated = evaluate(prepare(recording(time_s, speed_m_s * time_s, force_n), LINK), None)
    assert any("motion tells nothing, expect hold" in note for note in evaluated.notes)
    assert all(np.isfinite(evaluated.scores[name].size.rms_n or np.nan) for name in ("zoh", "mbk_bias"))


def test_jitter_and_loss_are_repeatable_and_change_the_score() -> None:
    links = [
        DelayedLink(0.3),
        DelayedLink(0.3, 0.05, 0.05, 1),
        DelayedLink(0.3, 0.05, 0.05, 1),
        DelayedLink(0.3, 0.05, 0.05, 2),
    ]
    plain, one, same, other = (evaluate(prepare(SAMPLE, link), None).scores for link in links)
    assert one == same
    assert all(one[name] != other[name] for name in METHODS)
    assert all(one[name] != plain[name] for name in METHODS)


def test_the_rules_say_what_was_done() -> None:
    plain, impaired = " ".join(rules(LINK, None)), " ".join(rules(DelayedLink(0.3, 0.05, 0.05, 9), None))
    assert "stamped <= t - 0.3 s" in plain
    assert "lost" not in plain
    for word in "0.05 s", "5 %", "Seed 9":
        assert word in impaired


def model(effects: list[object]) -> ContactModel:
    return ContactModel.from_mapping({"schema": "forefeel.model/1", "name": "mine", "effects": effects})


def test_a_model_is_for_forefeel_alone_and_is_named() -> None:
    stiff = model([{"effect": "mass_damper_spring"}])
    own, given = (evaluate(prepare(SAMPLE, LINK), of).scores for of in (None, stiff))
    assert [name for name in METHODS if own[name] != given[name]] == ["forefeel"]
    assert "model 'mine'" in " ".join(rules(LINK, stiff))
    with pytest.raises(ConfigurationError, match=r"m\.yaml: no linear parameter"):
        checked_model(model([{"effect": "contact_loss"}]), "m.yaml")
