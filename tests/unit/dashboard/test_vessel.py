"""The vessel that the page draws."""

from pathlib import Path

import numpy as np
import pytest

from forefeel.loopback.plan import LoopbackOptions, make_plan
from forefeel.report.vessel import RECORDED, of_recording


def test_simulated_vessel_is_recorded() -> None:
    plan = make_plan(LoopbackOptions())
    vessel = of_recording({"run": plan.recorded()})
    assert vessel is not None
    assert vessel == plan.vessel()
    assert vessel.landmarks_mm == {"valve": 0.0, "contact": 8.0}
    assert of_recording({"run": {RECORDED: "{}"}}) is None


def test_vessel_of_mujoco_has_its_walls_by_position() -> None:
    vessel = make_plan(LoopbackOptions(world="coronary")).vessel()
    assert vessel is not None
    assert (vessel.tip_mm, min(vessel.walls_mm), max(vessel.walls_mm)) == (4.0, -30.0, 73.0)
    assert vessel.walls_mm[-30.0] == (36.0, 1.0, 36.0, -1.0)  # the guide, of 66 mm
    assert vessel.walls_mm[3.0] == (69.0, 1.5, 69.0, -1.5)
    for x0, y0, x1, y1 in (vessel.walls_mm[mm] for mm in range(73)):  # by turns of 75 and -80 degrees
        assert np.hypot(x1 - x0, y1 - y0) == pytest.approx(3.0, abs=0.02)
    (x0, y0, x1, y1), *_ = (vessel.walls_mm[mm] for mm in (40,))
    assert np.degrees(np.arctan2(x1 - x0, y0 - y1)) == pytest.approx(75.0, abs=0.5)
    assert of_recording({"run": {RECORDED: vessel.model_dump_json()}}) == vessel


def test_recorded_forces_have_no_vessel(tmp_path: Path) -> None:
    played = tmp_path / "run.csv"
    played.write_text("time_s,position_m,force_n\n0.0,0.0,0.1\n0.01,0.001,0.2\n0.02,0.002,0.3\n")
    assert RECORDED not in make_plan(LoopbackOptions(recording=played)).recorded()
