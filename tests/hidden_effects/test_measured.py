"""Measured recordings with an answer in the literature, and long ones in which something is rare."""

from dataclasses import replace
from pathlib import Path

import pytest

from forefeel.common.recording.loading import load_recording
from forefeel.diagnosis.diagnose import diagnose
from forefeel.diagnosis.long_recording import liveliest
from forefeel.diagnosis.verdict import Diagnosis
from tests.unit.test_diagnosis_long_recording import SECONDS, recording, strokes

FRICTION = {"coulomb_friction", "stribeck_friction", "presliding_hysteresis", "position_dependent_friction"}


def diagnosed(path: Path, start: float = 0.0, end: float = 1.0) -> Diagnosis:
    """Of the part of the recording between two shares of its samples."""
    whole = load_recording(path)
    assert whole.force_n is not None
    cut = slice(round(start * len(whole)), round(end * len(whole)))
    columns = {name: getattr(whole, name)[cut] for name in ("time_s", "position_m", "force_n")}
    return diagnose(replace(whole, **columns)).diagnosis


@pytest.mark.soak
@pytest.mark.parametrize(
    ("name", "first", "parameter", "value", "others"),
    [
        # Janot, Gautier and Brunot, 2019: Coulomb friction of 20.39 N and an offset; no Stribeck effect
        ("emps_train", "coulomb_friction", "force_n", 20.39, {"asymmetric_damping", "bias"}),
        # Wigren and Schoukens, 2013: a cubic stiffness; both ends of it have an electrical offset
        ("silverbox_train", "stiffening", "cubic_n_m3", 3.9, {"bias"}),
    ],
)
def test_what_the_literature_says_of_a_machine_is_found(
    data_dir: Path, name: str, first: str, parameter: str, value: float, others: set[str]
) -> None:
    found = diagnosed(data_dir / f"{name}.csv")
    assert found.names_causes
    assert found.held_out.gain_low > 0.0
    largest, *more = found.causes
    assert largest.name == first
    assert largest.parameters[parameter].value == pytest.approx(value, rel=0.05)
    assert {cause.name for cause in more} <= others


@pytest.mark.soak
@pytest.mark.parametrize("part", [(0.0, 1.0), (0.0, 0.5), (0.5, 1.0)])
def test_a_seal_rubs_in_all_of_the_recording_and_in_each_half(
    data_dir: Path, part: tuple[float, float]
) -> None:
    """A damper that comes late, as a relaxing or lagging one without a spring, describes its strokes, too."""
    causes = [cause.name for cause in diagnosed(data_dir / "seal_o_ring_1bar.csv", *part).causes]
    assert causes[0] in FRICTION
    assert not {"stress_relaxation", "sensor_lag"} & set(causes)


@pytest.mark.soak
def test_a_slack_tendon_pulls_where_it_is_pulled_at(data_dir: Path) -> None:
    """Of a slow sine a mass of 35 t in the other direction tells more than its spring."""
    look = diagnosed(data_dir / "tendon_sine.csv").look
    assert look is not None
    assert look.sense == 1.0


def test_short_strokes_show_friction_that_builds_up_with_distance(data_dir: Path) -> None:
    """The first half: the quick tests see one measured recording."""
    found = diagnosed(data_dir / "presliding_friction.csv", 0.0, 0.5)
    assert found.names_causes
    assert found.held_out.gain_low > 0.0
    assert {cause.name for cause in found.causes} == {"presliding_hysteresis"}


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
