"""A contact that follows another axis of its cell, in the simulated world and in what the master predicts."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from forefeel.common.config import checked
from forefeel.common.errors import ConfigurationError
from forefeel.common.topics import FORCE, HAPTICS
from forefeel.master.settings import MasterSettings
from forefeel.slave.settings import SlaveSettings
from tests.simulation.pair import Pair

_WEIGHT_N, _RADIUS_M, _DELAY_S = 0.1, 1e-3, 0.1
_TURN = {"kind": "rotation", "workspace_m": (-0.05, 0.05)}
_QUIET = {"noise_n": 0.0, "bias_n": 0.0, "drift_n_s": 0.0}


def _model(*effects: dict[str, Any]) -> dict[str, Any]:
    return {"schema": "forefeel.model/1", "name": "holder", "effects": list(effects)}


_SPRING = {"effect": "mass_damper_spring", "parameters": {"stiffness_n_m": 5.0}}
_TURNED = {"sine_n": _WEIGHT_N, "radius_m": _RADIUS_M}
_HOLDER = {"effect": "with_column", "column": "rotation", "parameters": _TURNED}


def _cell(folder: Path) -> Pair:
    """Two axes that feel the holder's weight, and its rotation; the master knows of it at the first."""
    slave, master = [], []
    for name, effects in (("insertion", [_SPRING, _HOLDER]), ("other", [_SPRING])):
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(_model(*effects)))
        hidden = {"effects": _model(_HOLDER), "from_s": 0.3}
        world = {"contact": _model(_SPRING), "hidden": hidden, "load_cell": _QUIET}
        slave.append({"name": name, "simulation": world})
        master.append({"name": name, "prediction": {"model": str(folder / f"{name}.yaml")}})
    handle = {"driver": "operator", "depth_m": 0.006, "insert_s": 0.8, "dwell_s": 0.0, "seed": 1}
    slave.append({"name": "rotation", "limits": _TURN, "simulation": {"contact": _model()}})
    master.append({"name": "rotation", "limits": _TURN, "handle": handle})
    pair = Pair({"axes": slave}, {"axes": master})
    pair.to_slave.delay_s = pair.to_master.delay_s = 0.5 * _DELAY_S
    return pair


def test_the_master_predicts_with_the_stage_of_another_axis(tmp_path: Path) -> None:
    pair = _cell(tmp_path)
    pair.run(1.5)
    turned_m, force_n, inserted_m = (
        pair.traffic.column(FORCE, name, axis)
        for name, axis in (("position_m", "rotation"), ("force_n", "insertion"), ("position_m", "insertion"))
    )
    assert np.ptp(turned_m) > 2.0 * _RADIUS_M
    weight_n = _WEIGHT_N * np.sin(turned_m / _RADIUS_M)
    assert np.std(force_n - 5.0 * inserted_m - weight_n) < 0.1 * np.std(weight_n)
    error_n = {}
    for axis in ("insertion", "other"):
        answered = {m.answers_stamp_ns: m.force_n for m in pair.traffic.messages(FORCE, axis) if m.valid}
        error_n[axis] = [
            said.predicted_n - answered[said.stamp_ns]
            for said in pair.traffic.messages(HAPTICS, axis)
            if said.stamp_ns in answered and said.predicted_n is not None
        ]
    assert len(error_n["insertion"]) > 600
    assert np.std(error_n["insertion"]) < 0.25 * np.std(error_n["other"])


@pytest.mark.parametrize("settings", [MasterSettings, SlaveSettings])
@pytest.mark.parametrize(
    ("axes", "there"), [(["insertion"], "there is none"), (["insertion", "turn", "pull"], "turn, pull")]
)
def test_a_model_that_follows_what_is_no_axis_is_refused_at_the_start(
    tmp_path: Path, settings: type[MasterSettings | SlaveSettings], axes: list[str], there: str
) -> None:
    (tmp_path / "model.yaml").write_text(yaml.safe_dump(_model(_SPRING, _HOLDER)))
    path = str(tmp_path / "model.yaml")
    of = {MasterSettings: {"prediction": {"model": path}}, SlaveSettings: {"simulation": {"model": path}}}
    first, *others = axes
    mapping = {"axes": [{"name": first, **of[settings]}, *({"name": name} for name in others)]}
    with pytest.raises(ConfigurationError, match=f"axes: insertion: column = 'rotation' .*: {there}$"):
        checked(settings, mapping, "file")
