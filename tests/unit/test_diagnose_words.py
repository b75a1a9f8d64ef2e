"""Parameters, verdicts and flags in words."""

from dataclasses import replace
from string import Formatter

from forefeel.common.causes.catalogue import CANDIDATES, words
from forefeel.common.causes.registry import OWN
from forefeel.diagnose.words import FLAGS, answer, caution, equation, headline
from forefeel.diagnosis.diagnose.prediction import Across
from forefeel.diagnosis.diagnose.verdict import (
    Cause,
    Diagnosis,
    Evidence,
    ExpectedGain,
    HeldOut,
    Interval,
    ModelError,
)
from tests.unit.diagnosis_samples import made

FOUND = Diagnosis(
    "cause_found",
    (
        Cause(
            "coulomb_friction",
            1.0,
            {"force_n": Interval(0.08012, 0.0795, 0.0807)},
            Evidence("", 900.0, 0.9, 0.88, 0.91, "words"),
            0.04,
            0.05,
        ),
    ),
    (),
    None,
    ("motion_driven_by_force",),
    0.002,
    ModelError(0.05, {}, 75.0),
    ModelError(
        0.005,
        {"mass_kg": 0.02, "damping_n_s_m": 0.0, "stiffness_n_m": 60.0},
        97.4,
        {"mass_kg": Interval(0.02, -0.001, 0.041), "stiffness_n_m": Interval(60.0, 59.0, 61.0)},
    ),
    {"before_m": 2e-4, "after_m": 3e-5},
    HeldOut(0.05, 0.005, 0.9, 0.88, 0.91),
    ExpectedGain(0.85, 0.6, 0.93, 0.002, 0.034, 0.05),
)


def test_every_name_of_the_vocabulary_has_plain_words() -> None:
    for name in {name.partition(":")[0] for name in CANDIDATES}:
        assert words(name) == OWN[name].words != ""
    assert words("third_party_effect") == "third party effect"


def test_a_flag_is_a_sentence_and_an_unknown_one_is_still_readable() -> None:
    assert "trust mass, damping, delay and lag less" in caution("motion_driven_by_force")
    assert caution("something_new") == "something new"
    assert all(len(text) < 100 for text in FLAGS.values())


def test_the_answer_says_cause_size_gain_prediction_and_caution() -> None:
    lines = answer(made(5.0), FOUND, Across(0.3, 0.2, 0.05, 0.02))
    assert lines[0] == "made: 500 samples, 5.0 s, 100 Hz"
    text = "\n".join(lines)
    for said in (
        "Verdict     cause_found. The simulation leaves out",
        "Simulation  off by 50 mN rms; noise is 2 mN; fit 75 %",
        "Cause       coulomb_friction: force 80.1 mN (79.5 to 80.7)",
        "dry friction, 50 mN rms of the force",
        "Extended    off by 5 mN rms on stretches it was not fitted to, 90 % less (88 to 91 %); fit 97 %",
        "Elsewhere   expected of another motion: 85 % less (60 to 93 %) within 2 mm to 34 mm, up to 50 mm/s",
        "Model       f = 0.02 x'' + 60 x + 0.0801 sgn(x')",
        "mass 20 g (-1 to 41); stiffness 60.0 N/m (59.0 to 61.0)",
        "Caution     this motion does not tell the mass from zero; quicker motions may differ",
        "Predicted   300 ms ahead, rms: 50 mN before, 20 mN extended, 200 mN by a zero-order hold",
        "Forward     position from the force, rms: 200 µm before, 30 µm extended",
        "Caution     the motion answers the force, so trust mass, damping, delay and lag less",
    ):
        assert said in text
    assert lines[-1] == "Research software, not a medical device."
    assert max(map(len, lines)) < 120


def test_a_model_is_an_equation_with_what_is_done_to_motion_and_reading_behind_it() -> None:
    lag, play = (
        replace(FOUND.causes[0], name=name, parameters={key: Interval(value, value, value)})
        for name, key, value in (("sensor_lag", "time_constant_s", 0.012), ("backlash", "width_m", 3e-4))
    )
    said = equation(replace(FOUND, causes=(lag, play)))
    assert said == "f = 0.02 x'' + 60 x; f read through a lag of 0.012 s; x behind a play of 0.0003 m"
    bent, slow = (
        replace(FOUND.causes[0], name=name, parameters={k: Interval(v, v, v) for k, v in values.items()})
        for name, values in (
            ("asymmetric_damping", {"forward_n_s_m": 1.0, "backward_n_s_m": 2.0}),
            ("stress_relaxation", {"stiffness_n_m": 5.0, "time_constant_s": 0.1}),
        )
    )
    said = equation(replace(FOUND, causes=(bent, slow)))
    assert said == "f = 0.02 x'' + 60 x + 1 max(x', 0) + 2 min(x', 0) + 5 z; z' = x' - z/0.1"
    nothing = ModelError(0.05, {"stiffness_n_m": 60.0, "bias.force_n": -0.5}, 75.0)
    assert equation(replace(FOUND, verdict="unexplained", causes=(), baseline=nothing)) == "f = 60 x - 0.5"


def test_every_equation_is_made_of_parameters_that_its_cause_has() -> None:
    for name, kind in OWN.items():
        known = {p.name for p in kind.parameters} | set(kind.shorthands) | {"exponential_n", "length_m"}
        for text in kind.equation:
            assert {field for _, field, _, _ in Formatter().parse(text) if field} <= known, name


def test_a_gain_that_is_none_is_said_as_more_error() -> None:
    worse = replace(FOUND, held_out=HeldOut(0.05, 0.06, -0.2, -0.3, -0.1))
    assert any("20 % more (10 to 30 %)" in line for line in answer(made(5.0), worse, None))


def test_what_is_seen_on_the_readings_claims_no_gain_of_the_model() -> None:
    seen = replace(FOUND.causes[0], name="mains_hum", evidence=Evidence("", 0.0, 0.0, 0.0, 0.0, "a line"))
    lines = answer(made(5.0), replace(FOUND, causes=(seen,)), None)
    assert [line for line in lines if line.startswith("Extended")] == [
        "Extended    the readings were freed of it before the rest was compared"
    ]


def test_rivals_are_listed_and_not_named_as_a_cause() -> None:
    few = replace(
        FOUND,
        verdict="not_separable",
        causes=(),
        rivals=(("bias", "sensor_drift"),),
        suggested_motion="a hold",
    )
    lines = answer(made(5.0), few, None)
    assert "Rivals      bias: a constant offset of the load cell" in lines
    assert "            sensor_drift: a drift of the load cell" in lines
    assert "Record next a hold" in lines
    assert not any(line.startswith(("Cause", "Extended")) for line in lines)
    assert headline(few).endswith("a constant offset of the load cell or a drift of the load cell.")
    many = replace(few, rivals=(("bias", "sensor_drift", "backlash", "stiffening"),))
    assert headline(many).endswith("which of several causes it is.")
