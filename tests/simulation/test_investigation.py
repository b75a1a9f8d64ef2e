"""A question, a motion and a verdict on a simulated cell."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from forefeel.common.recording.recording import Recording
from forefeel.daemon_settings import load_daemon
from forefeel.investigation.bench import SimulatedBench
from forefeel.slave.settings import SlaveSettings
from tests.unit.asked_bench import stroke

CELL = """
role: slave
cell: simulated
axes:
  - name: insertion
    limits: {workspace_m: [0.0, 0.02], max_velocity_m_s: 0.05, max_acceleration_m_s2: 1.0, max_force_n: 3.0}
    simulation:
      contact:
        schema: forefeel.model/1
        name: a spring that rubs
        effects:
          - {effect: mass_damper_spring, parameters: {mass_kg: 0.02, damping_n_s_m: 0.8, stiffness_n_m: 20.0}}
          - {effect: presliding_hysteresis, parameters: {force_n: 0.12, stiffness_n_m: 300.0}}
"""


def test_simulated_cell_names_only_what_is_in_its_world(
    run: Callable[[Sequence[str]], int], tmp_path: Path
) -> None:
    (tmp_path / "slave.yaml").write_text(CELL)
    settings = load_daemon(tmp_path / "slave.yaml", "slave")
    assert isinstance(settings, SlaveSettings)
    path = stroke()
    motion = Recording("stroke", np.arange(len(path)) / 1e3, path, None, "stroke")
    SimulatedBench(settings, None).play(motion, tmp_path / "question.mcap")
    out = tmp_path / "out"
    line = f"investigate {tmp_path}/question.mcap --config {tmp_path}/slave.yaml --virtual-time --seconds 10"
    assert run([*line.split(), "--out", str(out)]) == 0
    answer = json.loads((out / "answer.json").read_text())
    first, *more = answer["answer"]["causes"]
    assert first["name"] == "presliding_hysteresis"
    # half a millinewton that the chain of cell and stage leaves may have a name, below the noise
    noise_n = answer["answer"]["noise_floor_n"]
    assert all(cause["name"] == "bias" or cause["explained_n"] < noise_n < 1e-3 for cause in more)
    assert answer["confirmation"]["verdict"] == "confirmed"
    assert {path.name for path in out.iterdir()} >= {"answer-1.mcap", "question.html", "answer.html"}
