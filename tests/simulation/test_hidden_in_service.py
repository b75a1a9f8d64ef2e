"""Hidden in the running service: an effect that the master does not know is named from the recording of the
run, and the extended model, loaded, makes the next run's live prediction better. Virtual time, the paper's
network.
"""

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from forefeel.__main__ import main
from forefeel.common.causes.model import SCHEMA
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.topics import FORCE
from forefeel.common.yaml_file import dump_mapping
from forefeel.diagnosis.diagnose import diagnose
from forefeel.diagnosis.extended_model import extended_model
from forefeel.loopback.plan import LoopbackOptions, make_plan
from forefeel.loopback.virtual import VirtualLoopback
from forefeel.report.summary import summarise

DURATION_S = 6.0
WALL = {"mass_damper_spring": {"mass_kg": 0.02, "damping_n_s_m": 0.6, "stiffness_n_m": 12.0}}
OF_THE_LOAD_CELL = "bias"
"""The simulated load cell has an offset of 10 mN; to name it is right."""

HIDDEN = {
    "hunt_crossley_damping": ({"damping_n_s_m2": 150.0}, 0.5),
    "stiffening": ({"quadratic_n_m2": 0.0, "cubic_n_m3": 9000.0}, 0.5),
    "presliding_hysteresis": ({"force_n": 0.12, "stiffness_n_m": 60.0}, 0.5),
    "coulomb_friction": ({"force_n": 0.12}, 0.95),
}
"""Parameters, and the most that the second run's rms may be of the first's. Dry friction that turns at once
is as uncertain as the instant of each reversal, which the network's jitter moves by 4.5 ms."""


def write_model(path: Path, effects: dict[str, dict[str, float]]) -> Path:
    entries = [{"effect": name, "parameters": values} for name, values in effects.items()]
    path.write_text(yaml.safe_dump({"schema": SCHEMA, "name": path.stem, "effects": entries}))
    return path


def run_of(path: Path, **options: Any) -> Run:  # noqa: ANN401 - the fields of LoopbackOptions
    loop = VirtualLoopback(
        make_plan(LoopbackOptions(seed=1, impairment="paper", duration_s=DURATION_S, **options)), 1
    )
    loop.run(lambda _done_s: None)
    loop.write(path)
    return Run(path)


def live_rms_n(run: Run) -> float:
    rms_n = summarise(run).prediction.rms_n
    assert rms_n is not None
    return rms_n


@pytest.mark.parametrize(
    "effect",
    [
        "coulomb_friction",
        pytest.param("stiffening", marks=pytest.mark.soak),
        pytest.param("hunt_crossley_damping", marks=pytest.mark.soak),
    ],
)
def test_what_is_hidden_in_a_run_is_named_and_the_next_run_predicts_better(
    tmp_path: Path, effect: str
) -> None:
    parameters, most = HIDDEN[effect]
    world = write_model(tmp_path / "world.yaml", WALL)
    hide = write_model(tmp_path / "hidden.yaml", {effect: parameters})
    before = run_of(tmp_path / "before.mcap", slave_model=world, hide=hide)
    diagnosed = diagnose(before.to_recording())
    assert diagnosed.diagnosis.names_causes
    assert {cause.name for cause in diagnosed.diagnosis.causes} - {OF_THE_LOAD_CELL} == {effect}
    found = tmp_path / "found.yaml"
    found.write_text(dump_mapping(extended_model(diagnosed.analysis, "found").to_mapping()))
    after = run_of(tmp_path / "after.mcap", slave_model=world, hide=hide, master_model=found)
    assert live_rms_n(after) < most * live_rms_n(before)


@pytest.mark.soak
def test_the_same_with_commands_and_files(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    write_model(tmp_path / "world.yaml", WALL)
    write_model(tmp_path / "hidden.yaml", {"quadratic_drag": {"drag_n_s2_m2": 120.0}})
    forefeel = commands(monkeypatch, capsys)
    world = "--slave-model world.yaml --hide hidden.yaml --hide-at 1 --impairment paper --seed 1"
    service = f"loopback {world} --virtual-time --duration {DURATION_S:g}"
    first = forefeel(f"{service} --out before")
    answer = forefeel("diagnose before/recording.mcap --out diagnosis")
    assert "quadratic_drag" in answer
    second = forefeel(f"{service} --master-model diagnosis/model.yaml --out after")
    document = json.loads((tmp_path / "diagnosis" / "diagnosis.json").read_text())
    assert {cause["name"] for cause in document["causes"]} - {OF_THE_LOAD_CELL} == {"quadratic_drag"}
    assert prediction_mn(second) < 0.6 * prediction_mn(first)
    reports = [json.loads((tmp_path / name / "report.json").read_text()) for name in ("before", "after")]
    assert reports[1]["metadata"]["run"]["master_model"] == "model.yaml"
    assert reports[1]["metadata"]["run"]["hidden"] == "hidden.yaml from 1 s on"
    assert reports[1]["prediction"]["rms_n"] < 0.6 * reports[0]["prediction"]["rms_n"]


def commands(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[[str], str]:
    """Runs the command line in this process as the installed script does; what it prints."""

    def run(line: str) -> str:
        monkeypatch.setattr(sys, "argv", ["forefeel", *line.split()])
        with pytest.raises(SystemExit) as ended:
            main()
        assert not ended.value.code, line
        return capsys.readouterr().out

    return run


def prediction_mn(ten_lines: str) -> float:
    found = re.search(r"^Prediction ([0-9.]+) mN rms", ten_lines, re.MULTILINE)
    assert found is not None, ten_lines
    return float(found.group(1))


def test_an_effect_is_switched_on_during_the_run_and_changes_nothing_before(tmp_path: Path) -> None:
    """A bias of 0.2 N from 1 s of the world's time on: equal to the bit before, off by 0.2 N from then on."""
    world = write_model(tmp_path / "world.yaml", WALL)
    hide = write_model(tmp_path / "hidden.yaml", {"bias": {"force_n": 0.2}})
    options = {"seed": 1, "slave_model": world, "duration_s": 2.0}
    forces: list[Any] = []
    for hidden in ({}, {"hide": hide, "hide_at_s": 1.0}):
        loop = VirtualLoopback(make_plan(LoopbackOptions(**options, **hidden)), 1)  # type: ignore[arg-type]
        loop.run(lambda _done_s: None)
        path = tmp_path / f"{len(forces)}.mcap"
        loop.write(path)
        forces.append(Run(path).column("insertion", FORCE, "force_n"))
    count = min(map(len, forces))
    differs = np.abs(forces[1][:count] - forces[0][:count])
    switched = np.flatnonzero(differs > 1e-9)[0]
    assert switched == pytest.approx(1000, abs=60)
    assert differs[switched + 5 : switched + 50] == pytest.approx(0.2, abs=0.02)
