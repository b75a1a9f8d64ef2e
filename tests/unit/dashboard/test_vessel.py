"""The vessel that the page draws."""

from pathlib import Path

from forefeel.loopback.plan import LoopbackOptions, make_plan
from forefeel.report.vessel import RECORDED, of_recording


def test_simulated_vessel_is_recorded() -> None:
    plan = make_plan(LoopbackOptions())
    vessel = of_recording({"run": plan.recorded()})
    assert vessel is not None
    assert vessel == plan.vessel()
    assert vessel.landmarks_mm == {"valve": 0.0, "contact": 8.0}
    assert of_recording({"run": {RECORDED: "{}"}}) is None


def test_recorded_forces_have_no_vessel(tmp_path: Path) -> None:
    played = tmp_path / "run.csv"
    played.write_text("time_s,position_m,force_n\n0.0,0.0,0.1\n0.01,0.001,0.2\n0.02,0.002,0.3\n")
    assert RECORDED not in make_plan(LoopbackOptions(recording=played)).recorded()
