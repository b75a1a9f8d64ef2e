"""Parameters, verdicts and flags in words."""

from dataclasses import replace

import pytest

from forefeel.common.effects.registry import OWN
from forefeel.diagnose.words import FLAGS, PLAIN, answer, caution, headline, plain
from forefeel.diagnosis.diagnose.parameters import NAMINGS
from forefeel.diagnosis.diagnose.prediction import Across
from forefeel.diagnosis.diagnose.verdict import Cause, Diagnosis, Evidence, HeldOut, Interval, ModelError
from forefeel.report.wording import plain_value, scale, shown, split_unit
from tests.unit.diagnosis_samples import made

UNITLESS = {"ratio", "damping_ratio"}
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
    ModelError(0.05, {}),
    ModelError(0.005, {}),
    {"before_m": 2e-4, "after_m": 3e-5},
    HeldOut(0.05, 0.005, 0.9, 0.88, 0.91),
)


@pytest.mark.parametrize(
    ("name", "interval", "text"),
    [
        ("force_n", Interval(19.876, 19.603, 20.143), "force 19.88 N (19.60 to 20.14)"),
        ("force_n", Interval(0.0601, 0.0592, 0.061), "force 60.1 mN (59.2 to 61.0)"),
        ("width_m", Interval(0.00203, 0.0019, 0.0021), "width 2.03 mm (1.90 to 2.10)"),
        ("stribeck_velocity_m_s", Interval(4e-4, 1e-4, 9e-4), "stribeck velocity 400 µm/s (100 to 900)"),
        ("forward_n_s_m", Interval(168.76, 164.62, 172.96), "forward 168.8 N s/m (164.6 to 173.0)"),
        ("drag_n_s2_m2", Interval(12.0, 11.0, 13.0), "drag 12.0 N s²/m² (11.0 to 13.0)"),
        ("damping_ratio", Interval(0.0512, 0.04, 0.06), "damping ratio 0.051 (0.040 to 0.060)"),
        ("cubic_n_m3", Interval(3.412e6, 3.3e6, 3.5e6), "cubic 3.41e+06 N/m³ (3.3e+06 to 3.5e+06)"),
        ("stiffness_n_m", Interval(0.84, -3.0, 4.7), "stiffness 0.84 N/m (-3.00 to 4.70)"),
        ("force_n", Interval(0.0, 0.0, 0.0), "force 0.00 N (0.00 to 0.00)"),
        ("ratio", Interval(float("inf"), 1.0, 2.0), "ratio unknown (1 to 2)"),
    ],
)
def test_a_parameter_has_its_unit_and_as_many_digits_as_its_interval(
    name: str, interval: Interval, text: str
) -> None:
    assert str(shown(name, interval)) == text


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("mass_kg", 0.02, "20 g"),
        ("mass_kg", 95.06, "95.1 kg"),
        ("time_constant_s", 0.8, "800 ms"),
        ("rate_hz", 0.5, "0.5 Hz"),
    ],
)
def test_a_value_without_interval_is_short(name: str, value: float, text: str) -> None:
    assert plain_value(name, value) == text


def test_every_parameter_of_the_vocabulary_has_a_unit() -> None:
    names = {p.name for name in PLAIN for p in OWN[name].parameters if p.unit}
    assert {name for name in names if not split_unit(name)[1]} == set()
    assert split_unit("damping_ratio") == ("damping ratio", "")


def test_the_unit_of_a_name_is_that_of_the_effect() -> None:
    for name in PLAIN:
        for parameter in OWN[name].parameters:
            if parameter.name not in UNITLESS and parameter.unit:
                said = split_unit(parameter.name)[1].replace("²", "^2").replace("³", "^3")
                assert said == parameter.unit, parameter.name


def test_a_prefix_is_a_power_of_a_thousand() -> None:
    for largest, factor, unit in ((0.5, 1e3, "mN"), (5.0, 1.0, "N"), (5e-5, 1e6, "µN"), (5e4, 1.0, "N")):
        found, prefixed = scale("N", largest)
        assert found == pytest.approx(factor)
        assert prefixed == unit
    assert scale("N/m", 1e-3) == (1.0, "N/m")


def test_every_name_of_the_vocabulary_has_plain_words() -> None:
    assert {name.partition(":")[0] for name in NAMINGS} <= set(PLAIN)
    assert len(PLAIN) == 22
    assert plain("third_party_effect") == "third party effect"


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
        "Simulation  off by 50 mN rms; noise is 2 mN",
        "Cause       coulomb_friction: force 80.1 mN (79.5 to 80.7)",
        "dry friction, 50 mN rms of the force",
        "Extended    off by 5 mN rms on stretches it was not fitted to, 90 % less (88 to 91 %)",
        "Predicted   300 ms ahead, rms: 50 mN before, 20 mN extended, 200 mN held",
        "Forward     position from the force, rms: 200 µm before, 30 µm extended",
        "Caution     the motion answers the force, so trust mass, damping, delay and lag less",
    ):
        assert said in text
    assert lines[-1] == "Research software, not a medical device."
    assert max(map(len, lines)) < 120


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
