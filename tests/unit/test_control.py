from typing import Any

import pytest

from forefeel.common.limiter import LimitHit
from forefeel.common.messages import SafetyState
from tests.clocks import compared
from tests.unit.control_rig import COMPARED, MS, START_M, Rig

S = SafetyState
HALTS: list[dict[str, Any]] = [{"estop": "pressed"}, {"fault": "drive"}]
STOPS: list[dict[str, Any]] = [*HALTS, {"shutdown": True}, {"session_live": False}, {"clock": None}]


# --- from idle to armed ---


def test_idle_holds_and_follows_nothing() -> None:
    rig = Rig(session_live=False)
    out = rig.tick(rig.command(START_M + 0.0005, True))
    assert (rig.state(), out.moving, out.executing, out.target_m) == (S.IDLE, False, None, START_M)


@pytest.mark.parametrize("changes", [{"session_live": False}, {"clock": None}])
def test_ready_needs_a_live_session_and_compared_clocks(changes: dict[str, Any]) -> None:
    rig = Rig(**changes)
    rig.released(5)
    assert rig.state() is S.IDLE


def test_a_release_a_press_and_the_ramp_lead_to_armed() -> None:
    rig = Rig()
    rig.released(2)
    assert rig.state() is S.READY
    rig.held()
    assert rig.state() is S.ENGAGING
    rig.held(199)
    assert rig.state() is S.ENGAGING
    rig.held(2)
    assert rig.state() is S.ARMED
    assert rig.events == ["session_opened", "engage", "engaged"]


def test_a_deadman_that_is_simply_held_never_engages() -> None:
    rig = Rig()
    rig.held(500)
    assert rig.state() is S.READY
    rig.released()
    rig.held()
    assert rig.state() is S.ENGAGING


def test_without_a_new_command_nothing_engages() -> None:
    rig = Rig()
    rig.released(3)
    pressed = rig.command(START_M, True)
    rig.clock = None
    rig.tick(pressed)
    rig.clock = COMPARED
    for _ in range(50):
        rig.tick()
    assert rig.state() is S.READY


@pytest.mark.parametrize("distance_m", [0.0011, -0.0011, 0.05])
def test_a_command_away_from_the_stage_does_not_engage_and_is_reported(distance_m: float) -> None:
    rig = Rig()
    rig.released(2)
    out = rig.tick(rig.command(START_M + distance_m, True))
    assert rig.state() is S.READY
    assert out.limits == [LimitHit("alignment", START_M + distance_m, START_M, "m")]
    rig.held(1, START_M + 0.0009)
    assert rig.state() is S.ENGAGING


def test_the_guard_compares_with_the_stage_and_not_with_an_old_setpoint() -> None:
    """The stage was moved by hand while it was held."""
    rig = Rig()
    rig.released(2)
    rig.stage_m = 0.05
    rig.held(1, START_M)
    assert rig.state() is S.READY
    rig.held(1, 0.05)
    assert rig.state() is S.ENGAGING
    assert rig.out.target_m == pytest.approx(0.05, abs=1e-6)
    for _ in range(300):
        before_m = rig.out.target_m
        rig.held(1, 0.05)
        assert abs(rig.out.target_m - before_m) <= 0.2e-3
    assert rig.state() is S.ARMED
    assert rig.out.target_m == pytest.approx(0.05, abs=1e-6)


def test_a_round_trip_beyond_the_limit_does_not_engage() -> None:
    rig = Rig(clock=compared(0, 350 * MS + 1))
    rig.released(2)
    out = rig.tick(rig.command(START_M, True))
    assert (rig.state(), [hit.rule for hit in out.limits]) == (S.READY, ["round_trip"])
    assert out.limits[0].requested > out.limits[0].applied == 0.7
    rig.clock = compared(0, 350 * MS)
    rig.held()
    assert rig.state() is S.ENGAGING


def test_the_permitted_speed_rises_while_engaging() -> None:
    rig = Rig()
    rig.released(2)
    rig.held(1, START_M + 0.0009)
    for tick in range(1, 200):
        rig.held(1, START_M + 0.0009)
        assert abs(rig.out.velocity_m_s) <= 0.2 * tick * 1e-3 / 0.2 + 1e-9


def test_a_command_that_runs_away_while_engaging_ends_it() -> None:
    rig = Rig().engaged()
    rig.held(1, START_M + 0.0049)
    assert rig.state() is S.ENGAGING
    rig.held(1, START_M + 0.02)
    assert rig.state() in (S.STOPPING, S.READY)
    assert "misaligned" in rig.events
    assert rig.control.stops == 1


def test_one_that_does_not_come_close_is_not_armed() -> None:
    rig = Rig().engaged()
    rig.follows = False
    position_m = START_M
    for _ in range(400):  # faster than the stage may move, for ever a little ahead
        position_m = rig.control.limiter.position_m + 0.003
        if position_m > 0.09:
            break
        rig.held(1, position_m)
    assert rig.state() is S.ENGAGING


# --- armed ---


def test_armed_the_setpoint_is_the_command() -> None:
    rig = Rig().armed()
    for i in range(1, 300):
        position_m = START_M + 1e-7 * i * i
        velocity_m_s = 2e-4 * i
        if velocity_m_s > 0.05:
            break
        rig.held(1, position_m, velocity_m_s=velocity_m_s)
        assert rig.out.target_m == pytest.approx(position_m, abs=1e-9)
        assert rig.out.executing is not None
        assert rig.out.executing.sequence == rig.sequence
    assert rig.rules == []


def test_between_two_commands_the_setpoint_goes_on_along_the_newest() -> None:
    rig = Rig().moving(0.1)
    before_m = rig.out.target_m
    for _ in range(20):
        rig.tick()
    assert rig.state() is S.ARMED
    assert rig.out.target_m - before_m == pytest.approx(20 * 0.1e-3, rel=1e-3)


def ripple_m(late_ms: list[int]) -> float:
    """How far the setpoint strays from a straight line while commands of one speed arrive with jitter."""
    rig = Rig().armed()
    speed_m_s, ticks = 0.02, 2500
    arrivals: dict[int, list[int]] = {}
    for sent in range(ticks):
        arrivals.setdefault(sent + 10 + late_ms[sent % len(late_ms)], []).append(sent)
    start_ns, targets_m, newest = rig.now_ns, list[float](), -1
    for tick in range(ticks):
        command = None
        for sent in arrivals.get(tick, []):
            if sent < newest:  # overtaken: the gate refuses it
                continue
            newest = sent
            position_m, stamp_ns = START_M + sent * 1e-3 * speed_m_s, start_ns + sent * MS
            fresh, _ = rig.command(position_m, True, velocity_m_s=speed_m_s)
            command = fresh.model_copy(update={"stamp_ns": stamp_ns}), rig.now_ns
        targets_m.append(rig.tick(command).target_m - tick * 1e-3 * speed_m_s)
    return max(targets_m[-200:]) - min(targets_m[-200:])


def test_jitter_of_the_network_is_no_jitter_of_the_stage() -> None:
    assert ripple_m([0]) < 1e-6
    assert ripple_m([0] * 50 + [8] * 50) < 0.1 * 0.008 * 0.02
