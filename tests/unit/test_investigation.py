"""A motion that is asked for, cut at the force limit, and the verdict on its answer."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from forefeel.common.errors import ConfigurationError
from forefeel.common.recording.loading import load_recording
from forefeel.common.recording.recording import Column, Recording
from forefeel.common.topics import FORCE
from forefeel.diagnosis.excitation import ForceLimitMet, Limits, excitation, play_excitation
from forefeel.diagnosis.investigation import Judged, investigate, judge
from forefeel.investigation.bench import ForceLimitWatch
from forefeel.results.investigation import answer_lines, question_lines, question_texts
from forefeel.results.verdict_text import answer as diagnosis_lines
from tests.messages import usual
from tests.network import S
from tests.unit.asked_bench import LIMITS, recorded, stroke


@pytest.mark.parametrize("inward", [True, False])
def test_range_ends_before_the_force_limit_and_the_rest_is_played(inward: bool) -> None:
    met_at = ForceLimitMet(5.1, 0.01, inward)
    played: list[tuple[Recording, Limits]] = []

    def play(motion: Recording, limits: Limits) -> ForceLimitMet | None:
        played.append((motion, limits))
        return met_at if len(played) == 1 else None

    play_excitation(LIMITS, 20.0, 100.0, play)
    (first, whole), (second, less) = played
    assert whole == LIMITS
    assert (first.duration_s, second.duration_s) == pytest.approx((20.0, 15.0), abs=0.1)
    assert (less.low_m, less.high_m) == pytest.approx((0.0, 0.0095) if inward else (0.0105, 0.02))
    assert less.low_m <= second.position_m.min() < second.position_m.max() <= less.high_m


@pytest.mark.parametrize("duration_s", [10.0, 30.0])
def test_limit_that_is_always_met_ends_it_after_four_motions(duration_s: float) -> None:
    spans_m = []

    def play(motion: Recording, limits: Limits) -> ForceLimitMet:
        spans_m.append(limits.span_m)
        return ForceLimitMet(duration_s, limits.home_m, True)  # at the last sample

    play_excitation(LIMITS, duration_s, 100.0, play)
    assert spans_m == pytest.approx([0.02 * (0.95 * 0.3) ** n for n in range(4)])


def test_slowed_for_half_a_second_near_the_limit_or_beyond_it_is_met() -> None:
    watch = ForceLimitWatch(1.0)

    def taken(at_s: float, limited: bool, force_n: float = -0.9) -> ForceLimitMet | None:
        stamps: dict[str, float] = {"stamp_ns": round(at_s * S), "recording_time_s": at_s}
        watch.take(usual(FORCE, **stamps, force_limited=limited, force_n=force_n))
        return watch.met

    for at_s in (0.0, 0.6, 0.9):  # slower towards a contact, far from the limit
        assert taken(at_s, True, -0.5) is None

    for at_s, limited in ((1.0, True), (1.4, True), (1.45, False), (1.5, True), (2.0, True)):
        assert taken(at_s, limited) is None
    met = taken(2.01, True)
    assert met is not None
    assert (met.position_m, met.inward) == (0.0099, False)
    assert met.time_s == pytest.approx(1.51)
    assert taken(5.0, True) == met
    watch = ForceLimitWatch(1.0)
    met = taken(7.0, False, 1.01)
    assert met is not None and met.inward and met.time_s == 7.0


def asked_and_judged(friction_n: float, question: Recording) -> Judged:
    asked = investigate(question, asdict(LIMITS), 10.0)
    assert asked.diagnosed is not None and asked.diagnosed.diagnosis.causes == ()
    answer = recorded(asked.motion.position_m, friction_n, seed=2)
    return judge(asked, answer)


def test_name_that_does_not_hold_on_the_question_is_refused() -> None:
    judged = asked_and_judged(0.08, recorded(stroke(), stiffness_n_m=80.0))
    diagnosis = judged.diagnosed.diagnosis
    assert (diagnosis.verdict, diagnosis.causes) == ("unexplained", ())
    assert diagnosis.suspected == ("coulomb_friction",)
    assert judged.refused is not None and judged.refused.verdict == "cause_found"
    labels = [line.split()[0] for line in answer_lines(judged)]
    assert "Refused" in labels and "Nearest" not in labels
    assert "Nearest" in [
        line.split()[0] for line in diagnosis_lines(judged.diagnosed.recording, diagnosis, None)
    ]


def test_nothing_hidden_names_nothing() -> None:
    judged = asked_and_judged(0.0, recorded(stroke(), 0.0))
    assert judged.diagnosed.diagnosis.verdict in {"nothing_found", "nothing_missing"}
    assert judged.replay is None


def test_model_of_the_question_stands_where_it_holds_on_an_answer_that_names_nothing() -> None:
    """A third of the range, 2 s there and 2 s back."""
    asked = investigate(recorded(excitation(LIMITS, 10.0).position_m), asdict(LIMITS), 10.0)
    there = 0.3 * stroke()[::2]
    there_and_back = np.concatenate([there, there[::-1]])
    judged = judge(asked, recorded(there_and_back, seed=2))
    assert (judged.of, judged.refused) == ("question", None)
    assert any(line.startswith("Question ") for line in answer_lines(judged))
    assert [cause.name for cause in judged.diagnosed.diagnosis.causes] == ["coulomb_friction"]
    for other in (recorded(there_and_back, 0.0, seed=2), recorded(0.3 * stroke())):  # without it; one way
        judged = judge(asked, other)
        assert (judged.of, judged.diagnosed.diagnosis.causes) == ("answer", ())


def test_question_of_a_lower_rate_than_its_answer_confirms_it() -> None:
    asked = investigate(recorded(stroke()).cut(slice(None, None, 2)), asdict(LIMITS), 10.0)
    judged = judge(asked, recorded(asked.motion.position_m, seed=2))
    assert [cause.name for cause in judged.diagnosed.diagnosis.causes] == ["coulomb_friction"]
    assert judged.replay is not None and judged.replay.confirmation.verdict == "confirmed"


def test_column_that_one_of_two_recordings_lacks_leaves_the_verdict_on_the_answer() -> None:
    def beside(recording: Recording) -> Recording:
        other_m = 0.01 * np.sin(2.3 * recording.time_s + 1.0) + 4e-3 * np.sin(5.7 * recording.time_s)
        force_n = np.asarray(recording.force_n) + 20.0 * other_m
        return replace(recording, force_n=force_n, further=(Column("other_m", "m", other_m),))

    moved = excitation(LIMITS, 10.0).position_m
    asked = investigate(beside(recorded(moved, 0.0)), asdict(LIMITS), 10.0)
    assert asked.diagnosed is not None and asked.diagnosed.diagnosis.causes[0].name == "with_column"
    judged = judge(asked, recorded(moved, 0.0, seed=2))
    assert (judged.of, judged.diagnosed.diagnosis.causes) == ("answer", ())
    plain = investigate(recorded(stroke(), 0.0), asdict(LIMITS), 10.0)
    judged = judge(plain, beside(recorded(moved, 0.0, seed=2)))
    assert (judged.replay, judged.diagnosed.diagnosis.causes[0].name) == (None, "with_column")
    assert any(line.startswith("Not told ") for line in answer_lines(judged))


def test_rotation_is_asked_for_in_radians(tmp_path: Path) -> None:
    turned = replace(recorded(stroke()), columns={"position": "rad:angle", "force": "Nm:torque"})
    asked = investigate(turned, asdict(LIMITS), 10.0)
    assert any("rad/s and 1 rad/s²" in line for line in question_lines(asked))
    file = tmp_path / "motion.csv"
    file.write_text(question_texts(asked)["motion.csv"], encoding="utf-8")
    motion = load_recording(file)
    assert motion.rotary
    np.testing.assert_allclose(motion.position_m, asked.motion.position_m, rtol=1e-8)


def test_flat_question_leaves_all_open_and_gets_a_motion() -> None:
    question = recorded(stroke())
    flat = replace(question, force_n=np.random.default_rng(3).normal(0.2, 4e-3, len(question)))
    asked = investigate(flat, {"speed_m_s": 0.05, "acceleration_m_s2": 1.0}, 10.0)
    assert (asked.diagnosed, asked.forecasts) == (None, ())
    assert np.ptp(asked.motion.position_m) > 0.4 * np.ptp(question.position_m)


@pytest.mark.parametrize("wrong", [{"high_m": 0.0}, {"speed_m_s": 0.0}, {"force_n": -1.0}])
def test_limits_without_room_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ConfigurationError, match="expected a range"):
        replace(LIMITS, **wrong)
