"""Measured recordings with an answer in the literature, and long ones in which something is rare."""

import os
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from forefeel.common.recording.loading import load_recording
from forefeel.diagnosis.diagnose import diagnose
from forefeel.diagnosis.long_recording import liveliest
from forefeel.diagnosis.verdict import Diagnosis
from tests.unit.test_diagnosis_long_recording import SECONDS, recording, strokes

FRICTION = {"coulomb_friction", "stribeck_friction", "presliding_hysteresis", "position_dependent_friction"}


@cache
def diagnosed(name: str, start: float = 0.0, end: float = 1.0) -> Diagnosis:
    if "FOREFEEL_DATA" not in os.environ:
        pytest.skip("FOREFEEL_DATA names no folder with recordings")
    whole = load_recording(Path(os.environ["FOREFEEL_DATA"]) / f"{name}.csv")
    assert whole.force_n is not None
    cut = slice(round(start * len(whole)), round(end * len(whole)))
    part = replace(
        whole, time_s=whole.time_s[cut], position_m=whole.position_m[cut], force_n=whole.force_n[cut]
    )
    return diagnose(part).diagnosis


def names(name: str, end: float = 1.0) -> set[str]:
    found = diagnosed(name, end=end)
    assert found.names_causes
    assert found.held_out.gain_low > 0.0
    return {cause.name for cause in found.causes}


@pytest.mark.soak
def test_motor_axis_has_dry_friction() -> None:
    """Janot, Gautier and Brunot, 2019: Coulomb friction of 20.39 N and an offset; no Stribeck effect."""
    assert names("emps_train") <= {"coulomb_friction", "asymmetric_damping", "bias"}
    causes = {cause.name: cause for cause in diagnosed("emps_train").causes}
    assert causes["coulomb_friction"].parameters["force_n"].value == pytest.approx(20.39, rel=0.05)
    assert diagnosed("emps_train").causes[0].name == "coulomb_friction"


@pytest.mark.soak
def test_a_seal_rubs_in_all_of_the_recording_and_in_each_half() -> None:
    """A damper that comes late, as a relaxing or lagging one without a spring, describes its strokes, too."""
    for part in ((0.0, 1.0), (0.0, 0.5), (0.5, 1.0)):
        causes = [cause.name for cause in diagnosed("seal_o_ring_1bar", *part).causes]
        assert causes[0] in FRICTION
        assert not {"stress_relaxation", "sensor_lag"} & set(causes)


@pytest.mark.soak
def test_a_slack_tendon_pulls_where_it_is_pulled_at() -> None:
    """Of a slow sine a mass of 35 t in the other direction tells more than its spring."""
    found = diagnosed("tendon_sine").look
    assert found is not None
    assert found.sense == 1.0


def test_short_strokes_show_friction_that_builds_up_with_distance() -> None:
    """The first half: the quick tests see one measured recording."""
    assert names("presliding_friction", 0.5) == {"presliding_hysteresis"}


@pytest.mark.soak
def test_an_electronic_spring_stiffens() -> None:
    """Wigren and Schoukens, 2013: a cubic stiffness; both ends of it have an electrical offset."""
    assert names("silverbox_train") <= {"stiffening", "bias"}
    causes = {cause.name: cause for cause in diagnosed("silverbox_train").causes}
    assert causes["stiffening"].parameters["cubic_n_m3"].value == pytest.approx(3.9, rel=0.05)


@pytest.mark.soak
def test_puncture_and_drift_of_long_recording_are_found() -> None:
    t, x, _, force = strokes(2)
    lively = liveliest(recording(t, x, force), 60.0)
    at_s = 150.3 if t[lively.start] < 60.0 else 30.3
    changed = recording(t, x, force - 0.4 * 25.0 * x * (t > at_s), start_s=50.0)
    (cause,) = diagnose(changed).diagnosis.causes
    assert cause.name == "stiffness_change"
    assert cause.parameters["time_s"].value == pytest.approx(50.0 + at_s, abs=0.1)
    assert cause.parameters["ratio"].value == pytest.approx(0.6, abs=0.01)
    (cause,) = diagnose(recording(t, x, force + 0.1 * t / SECONDS)).diagnosis.causes
    assert cause.name == "sensor_drift"
    assert cause.parameters["rate_n_s"].value == pytest.approx(0.1 / SECONDS, rel=0.02)
