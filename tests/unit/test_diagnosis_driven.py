"""Cause and effect: bodies that a force drives are told from motions that are imposed."""

import os
from pathlib import Path

import numpy as np
import pytest

from forefeel.common.causes.candidate import Model
from forefeel.common.causes.catalogue import CANDIDATES
from forefeel.common.recording.recording import Recording
from forefeel.common.recording.tabular import load_recording
from forefeel.diagnosis.diagnose import diagnose
from forefeel.diagnosis.diagnose.band import cutoff_hz, speed_band_m_s
from forefeel.diagnosis.diagnose.driven import FLAG, force_driven_excitation, lowered_trust
from forefeel.diagnosis.diagnose.faults import clean
from forefeel.diagnosis.diagnose.regression import RecordingRegression
from forefeel.diagnosis.diagnose.signals import Signals
from tests.hidden_effects.generator import VOCABULARY, draw
from tests.second_forms import forms
from tests.unit.driven_samples import Body, broad_force, driven, held_in_place

RICHER: Model = {"bias": (), "coulomb_friction": (), "stiffening": (), "quadratic_drag": ()}
measured = pytest.mark.skipif(
    "FOREFEEL_DATA" not in os.environ, reason="FOREFEEL_DATA names no folder with recordings"
)


def _signs(recording: Recording, model: Model) -> tuple[str, ...]:
    """With these causes named."""
    cleaned = clean(recording)
    cutoff = cutoff_hz(recording, cleaned.force_n)
    signals = Signals(recording, cleaned.force_n, cutoff, cleaned.clipped)
    reach_hz = min(2.0 * cutoff, signals.motion_reach_hz)
    regression = RecordingRegression(signals, speed_band_m_s(signals.even_m, signals.even_hz, reach_hz))
    return force_driven_excitation(recording, cleaned.force_n, regression, regression.fit(model))


def _late(parameters: dict[str, dict[str, float]]) -> Model:
    """What lets the force come late, as it was hidden; where it is a mode of the fixture, too."""
    named: dict[str, tuple[float, ...]] = {}
    for name, key in (("time_delay", "delay_s"), ("sensor_lag", "time_constant_s")):
        if name in parameters:
            named[name] = (parameters[name][key],)
    return named


@pytest.mark.parametrize("kind", forms(["nothing", *VOCABULARY], quick=["nothing", *VOCABULARY[::3]]))
def test_no_imposed_motion_is_taken_for_a_driven_one(kind: str) -> None:
    for seed in range(1000, 1003):
        hidden = draw(kind, seed, longest_s=15.0, fastest_hz=400.0)
        recording = Recording("hidden", hidden.time_s, hidden.position_m, hidden.force_n, "test")
        model = {**RICHER, **_late(hidden.truth.parameters)}
        if "fixture" in hidden.truth.labels:
            values = hidden.truth.parameters["unmodelled_resonance"]
            model["unmodelled_resonance:fixture"] = (values["frequency_hz"], values["damping_ratio"])
        assert set(model) <= set(CANDIDATES)
        assert _signs(recording, model) == (), (kind, seed, hidden.truth.motion)


@pytest.mark.parametrize("friction_n", [0.0, 0.06])
@pytest.mark.parametrize("zeta", forms([0.05, 0.2, 0.6], quick=[0.05]))
def test_a_broad_force_is_seen_to_drive(zeta: float, friction_n: float) -> None:
    for seed, top_hz in enumerate((25.0, 60.0)):
        rng = np.random.default_rng(seed)
        mass, frequency_hz = rng.uniform(0.03, 0.12), rng.uniform(2.0, 6.0)
        w = 2.0 * np.pi * frequency_hz
        body = Body(mass, 2.0 * zeta * mass * w, mass * w * w, friction_n)
        force = broad_force(rng, 12.0, top_hz, 0.3)
        assert _signs(driven(body, force, 500.0, seed), RICHER)


def test_a_slow_force_is_seen_to_drive_where_dry_friction_lets_the_acceleration_jump() -> None:
    force = broad_force(np.random.default_rng(3), 20.0, 5.0, 0.3)
    signs = _signs(driven(Body(0.08, 0.7, 40.0, 0.09), force, 500.0, 3), RICHER)
    assert ["reversals" in words for words in signs] == [True]
    assert signs[0] in lowered_trust(signs)[0]
    assert lowered_trust(()) == ()


def test_a_controller_that_holds_against_disturbances_is_seen() -> None:
    body = Body(0.08, 0.7, 30.0)
    rng = np.random.default_rng(4)
    (words,) = _signs(held_in_place(body, broad_force(rng, 20.0, 12.0, 0.03), 500.0), RICHER)
    assert "controller" in words


def test_a_stretch_that_is_too_short_says_nothing() -> None:
    force = broad_force(np.random.default_rng(5), 5.0, 40.0, 0.3)
    assert _signs(driven(Body(0.08, 0.7, 40.0), force, 100.0, 5), {}) == ()


@measured
@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("silverbox_train", "resonance near 71 Hz"),
        ("silverbox_test_arrow", "resonance near 71 Hz"),
        ("emps_train", "controller"),
        ("seal_o_ring_1bar", None),
        ("seal_o_ring_3bar", None),
        ("presliding_friction", None),
    ],
)
def test_measured_recordings(name: str, says: str | None) -> None:
    recording = load_recording(Path(os.environ["FOREFEEL_DATA"]) / f"{name}.csv")
    found = " ".join(_signs(recording, RICHER))
    assert (says in found) if says else found == ""


def test_the_diagnosis_says_so_and_simulates_forward() -> None:
    body, rng = Body(0.06, 0.25, 45.0), np.random.default_rng(6)
    found = diagnose(driven(body, broad_force(rng, 12.0, 25.0, 0.3), 250.0, 6)).diagnosis
    assert FLAG in found.flags
    assert any("driven by the force" in words for words in found.words)
    before = found.forward_rmse["before_m"]
    assert before is not None
    assert before < 2e-4  # of 15 mm
    imposed = draw("nothing", 1000, longest_s=12.0, fastest_hz=250.0)
    quiet = diagnose(
        Recording("hidden", imposed.time_s, imposed.position_m, imposed.force_n, "test")
    ).diagnosis
    assert FLAG not in quiet.flags
    assert quiet.forward_rmse == {"before_m": None, "after_m": None}
