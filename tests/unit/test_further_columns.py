"""Columns beside time, position and force: kept with their units, and named where the force follows one."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from forefeel.common.causes.column import WithColumn
from forefeel.common.causes.model import ContactModel
from forefeel.common.causes.motion import Motion, MotionSample
from forefeel.common.errors import ConfigurationError, RecordingError
from forefeel.common.estimation.predictor import Predictor
from forefeel.common.recording.loading import load_recording
from forefeel.common.recording.recording import Column, Recording
from forefeel.diagnosis.confirmation import confirm
from forefeel.diagnosis.diagnose import Diagnosed, diagnose
from forefeel.diagnosis.evaluation.arrivals import DelayedLink
from forefeel.diagnosis.evaluation.evaluate import prepare
from forefeel.diagnosis.evaluation.methods import replay
from forefeel.diagnosis.evaluation.score import completed
from forefeel.diagnosis.extended_model import extended_model, simulated_n
from forefeel.results.verdict_text import answer
from tests.unit.diagnosis_samples import made
from tests.unit.model_samples import effect, model

Floats = NDArray[np.float64]
_T_S = np.arange(200) / 50.0
_ROLL_RAD = 2.0 * np.sin(1.7 * _T_S)
_WEIGHT_N = 3.0


def _file(folder: Path, header: str, *columns: Floats) -> Recording:
    path = folder / "run.csv"
    table = np.column_stack([_T_S, 1e-2 * np.sin(5.0 * _T_S), np.cos(5.0 * _T_S), *columns])
    np.savetxt(path, table, "%.9g", delimiter=",", header=f"time_s,position_m,force_n,{header}", comments="")
    return load_recording(path)


@pytest.mark.parametrize(
    ("name", "unit", "factor"),
    [
        ("roll_deg", "rad", np.pi / 180.0),
        ("Y (mm)", "m", 1e-3),
        ("tip_mN", "N", 1e-3),
        ("tip (Nm)", "N m", 1.0),
        ("torque_nm", "N m", 1.0),
        ("gap (nm)", "m", 1e-9),
        ("T [°C]", "degC", 1.0),
    ],
)
def test_a_further_column_is_kept_in_si(tmp_path: Path, name: str, unit: str, factor: float) -> None:
    recording = _file(tmp_path, name, _ROLL_RAD)
    (column,) = recording.further
    assert (column.name, column.unit) == (name, unit)
    np.testing.assert_allclose(column.values, factor * _ROLL_RAD, atol=1e-8)
    assert recording.taken.endswith(f"beside {name}")
    assert recording.cut(slice(5, 9)).further[0].values.tolist() == column.values[5:9].tolist()


@pytest.mark.parametrize("name", ["velocity_mm", "current_A", "roll"])
def test_what_states_no_such_unit_or_is_a_derivative_is_left_out(tmp_path: Path, name: str) -> None:
    assert _file(tmp_path, name, _ROLL_RAD).further == ()


def test_a_column_with_holes_costs_no_row(tmp_path: Path) -> None:
    holes, few = np.where(_T_S < 0.1, np.nan, _ROLL_RAD), np.where(_T_S < 3.0, np.nan, _ROLL_RAD)
    recording = _file(tmp_path, "roll_rad,pitch_rad,still_rad", holes, few, np.ones_like(few))
    assert len(recording) == len(_T_S)
    assert [column.name for column in recording.further] == ["roll_rad"]
    assert np.isfinite(recording.further[0].values).all()


def test_its_force_is_its_closed_form_step_by_step_and_over_a_recording() -> None:
    effect = WithColumn(sine_n=0.2, cosine_n=-0.1, slope=0.3, friction_n=0.05, radius_m=2.0, breakaway=1e-4)
    effect.column = "roll"
    motion = replace(Motion.of(_T_S, _T_S, _T_S, _T_S), further={"roll": _ROLL_RAD})
    over = effect.columns(motion) @ np.array(effect.linear_values)
    way = np.sign(np.diff(_ROLL_RAD))
    expected = 0.2 * np.sin(_ROLL_RAD / 2) - 0.1 * np.cos(_ROLL_RAD / 2) + 0.3 * _ROLL_RAD
    np.testing.assert_allclose(over[1:], expected[1:] + 0.05 * way, atol=1e-12)
    sample, stepped = MotionSample(0.0, 0.0, 0.0, 0.0, 0.02), []
    for roll_rad in _ROLL_RAD.tolist():
        sample.further = {"roll": roll_rad}
        stepped.append(float(np.dot(effect.linear_values, effect.regressors(sample))))
    np.testing.assert_allclose(stepped, over, atol=1e-12)
    effect.column = "pitch"
    assert not effect.columns(motion).any()


def _rolled(recording: Recording) -> Floats:
    t = recording.time_s
    return np.asarray(2.2 * np.sin(0.83 * t) + 1.1 * np.sin(2.1 * t + 0.4))


def _with_roll(recording: Recording, weight_n: float) -> Recording:
    """The recording with the weight of a holder; beside the roll stand a setpoint and a raw reading."""
    roll = _rolled(recording)
    assert recording.force_n is not None
    force_n = recording.force_n + weight_n * np.sin(roll + 0.5)
    further = Column("set_m", "m", recording.position_m + 1e-6), Column("raw_N", "N", 2.0 * force_n + 1.0)
    return replace(recording, force_n=force_n, further=(*further, Column("roll_rad", "rad", roll)))


@cache
def _weighed() -> Diagnosed:
    return diagnose(_with_roll(made(), _WEIGHT_N))


def test_the_weight_of_a_holder_is_named_by_the_column_that_it_follows() -> None:
    diagnosis = _weighed().diagnosis
    (cause,) = (cause for cause in diagnosis.causes if cause.name != "bias")
    assert (diagnosis.verdict, cause.name, cause.column) == ("cause_found", "with_column", "roll_rad")
    for name, true_n in (("sine_n", _WEIGHT_N * np.cos(0.5)), ("cosine_n", _WEIGHT_N * np.sin(0.5))):
        assert cause.parameters[name].low < true_n < cause.parameters[name].high
    text = "\n".join(answer(_weighed().recording, diagnosis, None))
    assert "Cause       with roll_rad: sine" in text
    assert "a force that goes with roll_rad" in text


def test_a_column_that_does_nothing_is_not_named() -> None:
    diagnosis = diagnose(_with_roll(made(), 0.0)).diagnosis
    assert {cause.name for cause in diagnosis.causes} <= {"bias"}


def test_its_model_needs_the_column() -> None:
    rolls = extended_model(_weighed().analysis, "roll")
    assert rolls.columns == ("roll_rad",)
    assert ContactModel.from_mapping(rolls.to_mapping()) == rolls
    bare, plain = made(), ContactModel("plain", tuple(e for e in rolls.effects if not e.column))
    gained = simulated_n(rolls, _with_roll(bare, 0.0)) - simulated_n(plain, bare)
    assert np.std(gained - _WEIGHT_N * np.sin(_rolled(bare) + 0.5)) < 3e-3
    with pytest.raises(ConfigurationError, match=r"no column 'roll_rad', expected the one that model 'roll'"):
        simulated_n(rolls, bare)
    with pytest.raises(RecordingError, match=r"no column 'roll_rad', expected the one that the"):
        confirm(_weighed(), bare)


@pytest.mark.parametrize("entry", [{"effect": "bias", "column": "roll"}, {"effect": "with_column"}])
def test_a_model_says_which_column_and_only_where_there_is_one(entry: dict[str, str]) -> None:
    with pytest.raises(ValueError, match=r"effects\[0\].column = .*: expected"):
        model(entry)


def test_the_predictor_follows_the_column_of_its_model_and_learns_its_size() -> None:
    sine_n, cosine_n = _WEIGHT_N * np.cos(0.5), _WEIGHT_N * np.sin(0.5)
    holder = {"sine_n": 0.8 * sine_n, "cosine_n": 0.8 * cosine_n}
    wall = effect("mass_damper_spring", damping_n_s_m=0.8, stiffness_n_m=40.0)
    models = model(wall, {**effect("with_column", **holder), "column": "roll_rad"}), model(wall)
    rolled, link, error_n, predictors = _with_roll(made(), _WEIGHT_N), DelayedLink(0.3), [], []
    for known in models:
        prepared, predictor = prepare(rolled, link, known), Predictor(known)
        predicted_n = completed(replay(rolled, prepared.arrivals, predictor), prepared.zoh)
        error_n.append(np.std((predicted_n - prepared.force_n)[prepared.rows]))
        predictors.append(predictor)
    assert error_n[0] < 0.1 * error_n[1]
    learned = predictors[0].learner.learned
    assert learned is not None
    values = dict(zip(learned.names, learned.values, strict=True))
    assert values["with_column.sine_n"] == pytest.approx(sine_n, rel=0.02)
    assert values["with_column.cosine_n"] == pytest.approx(cosine_n, rel=0.02)
    with pytest.raises(RecordingError, match="no column 'roll_rad', expected the one that the model follows"):
        prepare(made(), link, models[0])
    with pytest.raises(ValueError, match="no 'roll_rad'; expected the columns that the model follows"):
        Predictor(models[0]).move(0.0, 0.0, {"pitch_rad": 0.0})


def test_columns_that_never_change_take_no_place_of_one_that_does(tmp_path: Path) -> None:
    still = [f"still{number}_rad" for number in range(8)]
    recording = _file(tmp_path, ",".join([*still, "roll_rad"]), *np.zeros((8, len(_T_S))), _ROLL_RAD)
    assert [column.name for column in recording.further] == ["roll_rad"]
