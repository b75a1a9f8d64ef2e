"""The control loop: force, grip, and whatever happens."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.messages import Grip, SafetyState
from forefeel.slave.settings import GateSettings
from tests.unit.control_rig import MS, START_M, Rig

S = SafetyState
HALTS: list[dict[str, Any]] = [{"estop": "pressed"}, {"fault": "drive"}]
STOPS: list[dict[str, Any]] = [*HALTS, {"shutdown": True}, {"session_live": False}, {"clock": None}]


# --- force ---


def test_a_load_cell_that_stays_invalid_while_the_stage_follows_is_a_fault() -> None:
    rig = Rig().armed()
    rig.force_valid = False
    rig.held(200)
    assert rig.state() is S.ARMED
    rig.held(2)
    assert (rig.state(), rig.reason) == (S.FAULT, "load cell invalid for more than 0.2 s")


def test_a_single_valid_force_starts_the_timeout_anew() -> None:
    rig = Rig().armed()
    for _ in range(5):
        rig.force_valid = False
        rig.held(190)
        rig.force_valid = True
        rig.held()
    assert rig.state() is S.ARMED


def test_an_invalid_load_cell_is_no_fault_while_nothing_follows_nor_when_it_is_not_asked_for() -> None:
    rig = Rig(force_valid=False)
    rig.released(1000)
    assert rig.state() is S.READY
    rig = Rig(gate=GateSettings(force_timeout_s=None)).armed()
    rig.force_valid = False
    rig.held(1000)
    assert rig.state() is S.ARMED


def test_above_the_force_limit_the_stage_does_not_go_on_and_says_so() -> None:
    rig = Rig().armed()
    rig.force_n = 3.2
    rig.held(100, START_M + 0.005)
    assert rig.out.target_m == pytest.approx(START_M, abs=1e-6)
    assert set(rig.rules) == {"force"}
    rig.force_n = 2.9
    rig.held(200, START_M + 0.005)
    assert rig.out.target_m == pytest.approx(START_M + 0.005, abs=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("seen_n", "blind_n"),
    [(3.5, 9.9), (3.5, 0.0), (2.75, 0.0), (0.1, 4.9), (2.75, -1.0)],
    ids=[
        "saturated above the limit",
        "lost above it",
        "lost near it",
        "saturated at once",
        "nonsense near it",
    ],
)
def test_a_blind_load_cell_lifts_no_force_limit_and_lets_the_stage_relieve(
    seen_n: float, blind_n: float, sign: int
) -> None:
    rig = Rig().armed()
    rig.force_n = sign * seen_n
    rig.held(20)
    rig.force_n, rig.force_valid = sign * blind_n, False
    rig.held(90, START_M + sign * 0.01)
    assert rig.out.target_m == pytest.approx(START_M, abs=1e-6)
    assert set(rig.rules) == {"force"}
    rig.held(90, START_M - sign * 0.002)
    assert rig.out.target_m == pytest.approx(START_M - sign * 0.002, abs=1e-6)
    assert rig.state() is S.ARMED


def test_what_a_saturated_load_cell_said_outlasts_its_silence_until_a_force_is_valid_again() -> None:
    rig = Rig().armed()
    rig.force_n, rig.force_valid = 4.9, False
    rig.held(5, START_M + 0.002)
    rig.force_n = 0.0
    rig.held(100, START_M + 0.002)
    assert rig.out.target_m == pytest.approx(START_M, abs=1e-6)
    rig.force_n, rig.force_valid = 0.1, True
    rig.held(100, START_M + 0.002)
    assert rig.out.target_m == pytest.approx(START_M + 0.002, abs=1e-6)


@pytest.mark.parametrize(("timeout_s", "seen_n"), [(0.2, 0.1), (None, 3.5)])
def test_blind_the_stage_follows_far_from_the_limit_or_where_no_force_is_asked_for(
    timeout_s: float | None, seen_n: float
) -> None:
    rig = Rig(gate=GateSettings(force_timeout_s=timeout_s)).armed()
    rig.force_n = seen_n
    rig.held(2)
    rig.force_n, rig.force_valid = 0.0, False
    rig.held(100, START_M + 0.002)
    assert rig.out.target_m == pytest.approx(START_M + 0.002, abs=1e-6)


# --- grip ---


def test_the_grip_changes_only_while_commands_are_followed() -> None:
    rig = Rig()
    rig.tick(rig.command(START_M, False, gripper=Grip.OPEN))
    rig.tick(rig.command(START_M + 0.01, True, gripper=Grip.OPEN))
    assert (rig.state(), rig.out.grip) == (S.READY, Grip.CLOSED)
    rig.armed()
    rig.held(1, gripper=Grip.OPEN)
    assert rig.out.grip is Grip.OPEN
    rig.tick(rig.command(START_M, False, gripper=Grip.CLOSED))
    assert (rig.state(), rig.out.grip) == (S.READY, Grip.OPEN)


@pytest.mark.parametrize("stop", STOPS, ids=str)
def test_a_stop_leaves_the_grip_as_it_is(stop: dict[str, Any]) -> None:
    rig = Rig().armed()
    rig.tick(rig.command(START_M, True, gripper=Grip.OPEN), **stop)
    assert rig.out.grip is Grip.CLOSED


def test_a_late_tick_moves_the_setpoint_by_ten_milliseconds_at_most() -> None:
    rig = Rig().moving(0.1)
    before_m = rig.out.target_m
    rig.now_ns += 40 * MS
    rig.tick()
    assert abs(rig.out.target_m - before_m) <= 0.2 * 0.010


# --- whatever happens ---

STEP = st.tuples(
    st.sampled_from(["held", "released", "silent", "held away", "nothing"]),
    st.integers(1, 50),
    st.floats(-0.02, 0.11),
    st.sampled_from(
        [{}, {}, {}, *HALTS, {"shutdown": True}, {"session_live": False}, {"clear": True}, {"clock": None}]
    ),
    st.floats(-4.0, 4.0),
)


@given(st.lists(STEP, min_size=1, max_size=15), st.booleans())
def test_the_stage_moves_only_while_engaging_armed_or_ramping_to_rest(
    steps: list[tuple[str, int, float, dict[str, Any], float]], begins_armed: bool
) -> None:
    rig = Rig(gate=GateSettings(engage_ramp_s=0.02, watchdog_s=0.02))
    if begins_armed:
        rig.moving()
    halted = False
    for act, ticks, position_m, changes, force_n in steps:
        rig.force_n = force_n
        for tick in range(ticks):
            before, before_m, before_m_s = rig.state(), rig.out.target_m, rig.out.velocity_m_s
            command = None
            if act in ("held", "released"):
                command = rig.command(rig.stage_m, act == "held", velocity_m_s=0.02)
            elif act == "held away":
                command = rig.command(position_m, True)
            out = rig.tick(command, **(changes if tick == 0 else {}))
            if rig.control.machine.following:
                assert not halted, "follows after a halt that nobody cleared"
                assert out.executing is not None
                assert out.executing.deadman
            else:
                assert abs(out.velocity_m_s) <= max(0.0, abs(before_m_s) - 4.0e-3) + 1e-12
                assert out.executing is None
                if before_m_s == 0.0:
                    assert (out.target_m, out.moving) == (before_m, False)
            if not (rig.control.machine.following and before is S.READY):  # engaging starts at the stage
                assert abs(out.target_m - before_m) <= 0.2e-3 + 1e-12
            if tick == 0:
                halted = (halted or bool({"estop", "fault"} & set(changes))) and "clear" not in changes
