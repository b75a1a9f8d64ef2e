"""The slave's axis when devices fail, and what its limits do."""

from itertools import pairwise
from math import inf, nan

import pytest

from forefeel.common.errors import DeviceError
from forefeel.common.messages import SafetyState
from forefeel.slave.load_cell import LoadCellReading
from tests.unit.slave_rig import MS, START_M, SlaveRig

S = SafetyState


# --- devices that fail ---


@pytest.mark.parametrize("call", ["read", "command"])
def test_a_stage_that_fails_is_a_fault_and_is_told_to_hold(call: str) -> None:
    rig = SlaveRig().armed()
    rig.stage.broken = {call}
    rig.step(2)
    assert (rig.state(), rig.states[-1].reason) == (S.FAULT, f"stage: {call} refused")
    rig.stage.broken = set()
    rig.step(100)
    assert rig.state() is S.FAULT
    assert rig.stage.holds[-1] == rig.now_ns
    rig.axis.clear()
    rig.step(2)
    assert rig.state() is S.READY


def test_a_stage_that_can_not_even_hold_is_a_fault_and_the_loop_goes_on() -> None:
    rig = SlaveRig().armed()
    rig.stage.broken = {"read", "command", "hold"}
    rig.step(20)
    assert rig.state() is S.FAULT
    assert len(rig.forces) == len(rig.load_cell.asked) + 20
    assert {force.valid for force in rig.forces[-19:]} == {False}


def test_a_gripper_or_load_cell_that_fails_is_a_fault() -> None:
    rig = SlaveRig().armed()
    rig.gripper.broken = True
    rig.step(2)
    assert (rig.state(), rig.states[-1].reason) == (S.FAULT, "gripper: jammed")
    rig = SlaveRig().armed()
    rig.load_cell.error = DeviceError("load cell: unplugged")
    rig.step()
    assert (rig.state(), rig.states[-1].reason) == (S.FAULT, "load cell: unplugged")
    assert (rig.forces[-1].valid, rig.forces[-1].force_n) == (False, 0.0)


@pytest.mark.parametrize("force_n", [nan, inf, -inf, 5.01, -1e300])
def test_a_force_beyond_the_full_scale_is_a_fault_and_never_published(force_n: float) -> None:
    rig = SlaveRig().armed()
    rig.load_cell.reading = LoadCellReading(force_n, 0, True)
    rig.step()
    assert rig.state() is S.FAULT
    assert rig.states[-1].reason == f"load cell = {force_n:g} N: expected at most its full scale, 5 N"
    assert (rig.forces[-1].valid, rig.forces[-1].force_n) == (False, 0.0)
    assert rig.stage.holds[-1] == rig.now_ns


@pytest.mark.parametrize("value", [nan, 1001.0])
@pytest.mark.parametrize("field", ["position_m", "velocity_m_s"])
def test_a_readback_that_is_none_is_a_fault_and_the_last_one_stays(field: str, value: float) -> None:
    rig = SlaveRig().armed()
    rig.deadman = False
    rig.step(5)
    setattr(rig.stage, field, value)
    rig.step()
    assert rig.state() is S.FAULT
    assert "expected at most 10 m and 1000 m/s" in rig.states[-1].reason
    assert rig.forces[-1].position_m == pytest.approx(START_M)


def test_an_axis_does_not_open_on_a_stage_that_does_not_say_where_it_is() -> None:
    rig = SlaveRig()
    rig.stage.position_m = nan
    with pytest.raises(DeviceError, match="expected at most 10 m and 1000 m/s"):
        rig.axis.open(rig.now_ns)
    rig.stage.position_m, rig.stage.broken = START_M, {"open"}
    with pytest.raises(DeviceError, match="open refused"):
        rig.axis.open(rig.now_ns)


def test_a_fault_of_any_thread_holds_the_stage_at_once_and_is_a_fault_at_the_next_tick() -> None:
    rig = SlaveRig().armed()
    holds = len(rig.stage.holds)
    rig.axis.fail(ValueError("torn cable"))
    assert len(rig.stage.holds) == holds + 1
    rig.step()
    assert (rig.state(), rig.states[-1].reason) == (S.FAULT, "ValueError: torn cable")


# --- interventions ---


def total(rig: SlaveRig, rule: str) -> int:
    return sum(event.count for event in rig.limits if event.rule == rule)


def test_interventions_are_gathered_in_at_most_ten_events_a_second_and_all_counted() -> None:
    rig = SlaveRig().armed()
    rig.position_m = 0.5 * START_M
    rig.fields = {"velocity_m_s": -3.0}  # beyond all reason: refused
    before = rig.counters().get("refused_range", 0)
    rig.sends = True
    for _ in range(55):  # not so many that the watchdog fires
        rig.step()
    rig.fields = {}
    rig.position_m = rig.stage.position_m
    rig.step(300)
    refused = rig.counters()["refused_range"] - before
    assert refused == 55
    assert total(rig, "range") == 55
    assert len([event for event in rig.limits if event.rule == "range"]) == 2
    event = next(event for event in rig.limits if event.rule == "range")
    assert (event.requested, event.applied, event.unit) == (-3.0, 2.0, "m/s")


def test_every_intervention_of_the_loop_is_counted_once() -> None:
    rig = SlaveRig().armed()
    rig.position_m = 0.18  # beyond reason, which ends 50 mm outside of the workspace
    rig.step(20)
    rig.position_m = 0.16  # outside of the workspace only
    rig.step(700)
    rig.deadman = False
    rig.step(300)
    published = {rule: total(rig, rule) for rule in {event.rule for event in rig.limits}}
    assert published["range"] == 20
    assert published["workspace"] == 700
    assert sum(published.values()) == rig.counters()["limit_interventions"]
    times_ns = [event.stamp_ns for event in rig.limits if event.rule == "workspace"]
    assert all(later - earlier >= 100 * MS for earlier, later in pairwise(times_ns))
    assert rig.stage.position_m <= 0.12 + 1e-12


def test_a_drive_that_does_not_go_where_it_is_told_is_an_intervention() -> None:
    rig = SlaveRig().armed()
    rig.stage.travel_m = (0.0, START_M + 0.001)
    rig.position_m = START_M + 0.002
    rig.step(40)
    assert total(rig, "travel") > 0
    event = next(event for event in rig.limits if event.rule == "travel")
    assert (event.applied, event.unit) == (START_M + 0.001, "m")
    assert event.requested > event.applied
