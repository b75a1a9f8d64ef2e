"""The control loop: stops."""

from itertools import pairwise
from typing import Any

import pytest

from forefeel.common.messages import SafetyState
from forefeel.slave.settings import GateSettings
from tests.clocks import compared
from tests.unit.control_rig import COMPARED, MS, SESSION, START_M, Rig

S = SafetyState
HALTS: list[dict[str, Any]] = [{"estop": "pressed"}, {"fault": "drive"}]
STOPS: list[dict[str, Any]] = [*HALTS, {"shutdown": True}, {"session_live": False}, {"clock": None}]


# --- stops ---


def test_a_round_trip_that_grows_beyond_the_limit_stops() -> None:
    rig = Rig().moving()
    rig.clock = compared(0, 350 * MS)
    rig.held(1, rig.stage_m)
    assert rig.state() is S.ARMED
    rig.clock = compared(0, 350 * MS + 1)
    rig.held(1, rig.stage_m)
    assert (rig.state(), rig.events) == (S.STOPPING, ["round_trip"])
    assert rig.reason == "round trip 700 ms, limit 700 ms"
    assert rig.control.stops == 1


def test_a_release_stops_at_the_configured_deceleration_and_is_no_stop_of_the_machine() -> None:
    rig = Rig().moving(0.1)
    start_m, speed_m_s = rig.stage_m, rig.out.velocity_m_s
    rig.released()
    assert rig.state() is S.STOPPING
    assert rig.out.velocity_m_s == pytest.approx(speed_m_s - 4.0e-3)
    rest_m = rig.at_rest_m()
    assert rig.state() is S.READY
    assert rest_m - start_m == pytest.approx(speed_m_s**2 / 8.0, rel=0.05)
    assert (rig.events, rig.control.stops) == (["release", "at_rest"], 0)


@pytest.mark.parametrize("away_m", [0.0, 0.03])
def test_a_release_stops_though_a_press_came_in_the_same_tick(away_m: float) -> None:
    rig = Rig().moving(0.1)
    before_m = rig.stage_m
    rig.tick(rig.command(rig.stage_m + away_m, True), released=True)
    assert (rig.state(), rig.events) == (S.STOPPING, ["release"])
    rig.held(300, before_m + away_m)  # a press that nobody let go of since
    assert rig.state() is S.READY
    assert rig.stage_m - before_m < 0.1**2 / 8.0 + 1e-4
    assert rig.control.stops == 0


def test_a_release_and_an_aligned_press_in_one_tick_engage() -> None:
    rig = Rig()
    rig.held(5)
    rig.tick(rig.command(rig.stage_m, True), released=True)
    assert rig.state() is S.ENGAGING


def test_the_watchdog_fires_in_the_first_tick_beyond_60_ms() -> None:
    rig = Rig().moving()
    for silent_ms in range(1, 61):
        rig.tick()
        assert rig.state() is S.ARMED, silent_ms
    rig.tick()
    assert rig.state() is S.STOPPING
    assert rig.reason == "no valid command for 61 ms"
    assert rig.control.stops == 1


@pytest.mark.parametrize("watchdog_s", [0.02, 0.3])
def test_the_watchdog_is_configurable(watchdog_s: float) -> None:
    rig = Rig(gate=GateSettings(watchdog_s=watchdog_s)).moving()
    for _ in range(round(watchdog_s * 1000)):
        rig.tick()
    assert rig.state() is S.ARMED
    rig.tick()
    assert rig.state() is S.STOPPING


@pytest.mark.parametrize("deadman", [True, False])
def test_a_control_loop_that_stood_still_stops_where_the_stage_is_though_a_fresh_command_waits(
    deadman: bool,
) -> None:
    rig = Rig().moving()
    rig.follows = False
    rested_m = rig.stage_m = rig.stage_m + 0.003  # where the drive's own watchdog has left it
    rig.now_ns += 60 * MS
    out = rig.tick(rig.command(rested_m + 0.01, deadman, velocity_m_s=0.1))
    assert "watchdog" in rig.events
    assert rig.reason in ("the control loop stood still for 61 ms", "stage at rest")
    assert not out.moving and out.velocity_m_s == 0.0
    assert out.target_m == rested_m
    rig.held(50, rested_m + 0.01)
    assert rig.state() is S.READY
    assert rig.out.target_m == rested_m


def test_a_tick_that_is_late_by_less_than_the_watchdog_stops_nothing() -> None:
    rig = Rig().moving()
    rig.now_ns += 58 * MS
    rig.tick(rig.command(rig.stage_m, True, velocity_m_s=0.1))
    assert rig.state() is S.ARMED


def test_without_a_watchdog_a_simulation_goes_on() -> None:
    rig = Rig(gate=GateSettings(watchdog_s=0.0)).armed()
    for _ in range(2000):
        rig.tick()
    assert rig.state() is S.ARMED


@pytest.mark.parametrize("stop", [*STOPS, {"watchdog": True}], ids=str)
def test_no_stop_resumes_by_itself(stop: dict[str, Any]) -> None:
    rig = Rig().moving()
    if "watchdog" in stop:
        for _ in range(70):
            rig.tick()
    else:
        rig.tick(rig.command(rig.stage_m, True), **stop)
    assert not rig.control.machine.following
    rig.at_rest_m()
    rest_m = rig.stage_m
    if stop in HALTS:
        rig.tick(clear=True)
    rig.held(500)  # the hand never let go
    assert not rig.control.machine.following
    assert rig.stage_m == rest_m
    rig.released(2)
    rig.held()
    assert rig.state() is S.ENGAGING


@pytest.mark.parametrize("stop", STOPS, ids=str)
def test_every_stop_acts_in_the_tick_in_which_it_comes(stop: dict[str, Any]) -> None:
    rig = Rig().moving(0.1)
    out = rig.tick(rig.command(rig.stage_m + 0.001, True, velocity_m_s=0.1), **stop)
    assert not rig.control.machine.following
    assert out.executing is None
    assert out.velocity_m_s == pytest.approx(0.1 - 4.0e-3, abs=1e-4)
    assert rig.control.stops == 1


@pytest.mark.parametrize("halt", HALTS, ids=str)
@pytest.mark.parametrize("start", ["idle", "ready", "engaging", "armed", "stopping"])
def test_a_halt_is_latched_from_every_state_until_it_is_cleared(halt: dict[str, Any], start: str) -> None:
    rig = Rig(session_live=start != "idle")
    match start:
        case "engaging":
            rig.engaged()
        case "armed":
            rig.moving()
        case "stopping":
            rig.moving()
            rig.released()
        case _:
            rig.released(2)
    assert rig.state().value == start
    rig.tick(**halt)
    halted = S.ESTOPPED if "estop" in halt else S.FAULT
    rig.released(50)
    rig.held(50)
    assert rig.state() is halted
    assert not rig.out.moving
    rig.session_live = True
    rig.tick(clear=True)
    assert rig.state() is S.READY


def test_a_stop_that_comes_with_the_clearing_of_another_one_holds() -> None:
    rig = Rig().armed()
    rig.tick(estop="first")
    rig.tick(estop="second", clear=True)
    assert (rig.state(), rig.reason) == (S.ESTOPPED, "second")
    rig.tick(clear=True)
    assert rig.state() is S.READY


def test_a_stop_while_armed_is_not_lost_to_a_clearing_in_the_same_tick() -> None:
    rig = Rig().moving()
    rig.tick(estop="now", clear=True)
    assert rig.state() is S.ESTOPPED


def test_a_clearing_that_clears_nothing_changes_nothing() -> None:
    rig = Rig().armed()
    rig.tick(rig.command(START_M, True), clear=True)
    assert (rig.state(), rig.events) == (S.ARMED, [])


def test_an_emergency_stop_outranks_a_fault_in_the_same_tick() -> None:
    rig = Rig().armed()
    rig.tick(estop="pressed", fault="drive")
    assert rig.state() is S.ESTOPPED
    assert rig.events == ["estop"]


def test_a_shutdown_stops_and_nothing_arms_after_it() -> None:
    rig = Rig().moving()
    rig.tick(rig.command(rig.stage_m, True), shutdown=True)
    assert rig.state() is S.STOPPING
    for _ in range(100):
        rig.tick(rig.command(rig.stage_m, False), shutdown=True)
    for _ in range(100):
        rig.tick(rig.command(rig.stage_m, True), shutdown=True)
    assert (rig.state(), rig.out.moving) == (S.READY, False)


def test_nothing_engages_while_the_setpoint_still_moves() -> None:
    """A fault cleared in the middle of its ramp."""
    rig = Rig().moving(0.15)
    rig.tick(fault="drive")
    rig.tick(clear=True)
    assert rig.state() is S.READY
    rig.released()
    speeds = [rig.out.velocity_m_s]
    for _ in range(60):
        rig.held()
        speeds.append(rig.out.velocity_m_s)
        if rig.state() is S.ENGAGING:
            break
    assert rig.state() is S.ENGAGING
    assert all(before - after <= 4.0e-3 + 1e-9 for before, after in pairwise(speeds))


def test_a_session_that_takes_over_between_two_ticks_does_not_inherit_the_release() -> None:
    rig = Rig()
    rig.released(3)
    rig.session_id, rig.clock = SESSION + 1, None
    rig.held()
    rig.clock = COMPARED
    rig.held(20)
    assert rig.state() is S.READY
    rig.released()
    rig.held()
    assert rig.state() is S.ENGAGING
