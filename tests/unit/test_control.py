"""The control loop: engaging, following, stops, force, grip."""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from forefeel.common.clock_offset import OffsetEstimate
from forefeel.common.limiter import PROMPT, LimitHit
from forefeel.common.messages import Grip, MotionCommand, SafetyState
from forefeel.common.settings import AxisLimits
from forefeel.common.topics import COMMAND
from forefeel.slave.control import AxisControl, ControlInputs, ControlOutputs
from forefeel.slave.settings import GateSettings
from tests.clocks import compared
from tests.messages import usual

MS = 1_000_000
START_M = 0.02
SESSION = 5
LIMITS = AxisLimits(workspace_m=(-0.01, 0.1), stiffest_wall_n_m=1.0)  # no contact slows it
GATE = GateSettings()
COMPARED = compared(0, 5 * MS)
S = SafetyState
HALTS: list[dict[str, Any]] = [{"estop": "pressed"}, {"fault": "drive"}]
STOPS: list[dict[str, Any]] = [*HALTS, {"shutdown": True}, {"session_live": False}, {"clock": None}]


@dataclass
class Rig:
    """One tick per call of `tick`; a perfect stage follows the setpoint unless `stage_m` is set."""

    gate: GateSettings = GATE
    now_ns: int = 1000 * MS
    stage_m: float = START_M
    follows: bool = True
    force_n: float = 0.0
    force_valid: bool = True
    force_age_s: float = 0.0
    session_live: bool = True
    session_id: int = SESSION
    clock: OffsetEstimate | None = COMPARED
    sequence: int = 0
    events: list[str] = field(default_factory=list)
    rules: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.control = AxisControl(LIMITS, self.gate, PROMPT, self.stage_m)
        self.out = ControlOutputs(self.stage_m, 0.0, False, Grip.CLOSED, None)

    def state(self) -> SafetyState:
        return self.control.machine.state

    @property
    def reason(self) -> str:
        return self.control.machine.reason

    def command(self, position_m: float, deadman: bool, **changes: Any) -> tuple[MotionCommand, int]:  # noqa: ANN401
        self.sequence += 1
        header = {"session_id": self.session_id, "sequence": self.sequence, "stamp_ns": self.now_ns}
        fields = {**header, "position_m": position_m, "deadman": deadman, **changes}
        return usual(COMMAND, **fields), self.now_ns

    def tick(self, command: tuple[MotionCommand, int] | None = None, **changes: Any) -> ControlOutputs:  # noqa: ANN401
        inputs = ControlInputs(
            command=command,
            position_m=self.stage_m,
            force_n=self.force_n,
            force_valid=self.force_valid,
            force_age_s=self.force_age_s,
            session_live=self.session_live,
            clock=self.clock,
        )
        self.out = self.control.tick(self.now_ns, inputs._replace(**changes))
        self.events += [event.value for _, event, _, _ in self.out.transitions]
        self.rules += [hit.rule for hit in self.out.limits]
        if self.follows and self.out.moving:
            self.stage_m = self.out.target_m
        self.now_ns += MS
        return self.out

    def released(self, ticks: int = 1) -> None:
        for _ in range(ticks):
            self.tick(self.command(self.stage_m, False))

    def held(self, ticks: int = 1, position_m: float | None = None, **changes: Any) -> None:  # noqa: ANN401
        """Deadman pressed, on the spot or at a position."""
        for _ in range(ticks):
            self.tick(self.command(self.stage_m if position_m is None else position_m, True, **changes))

    def engaged(self) -> "Rig":
        """Ready, released, pressed: ENGAGING."""
        self.released(3)
        self.held()
        assert self.state() is SafetyState.ENGAGING, self.reason
        return self

    def armed(self) -> "Rig":
        """Through the ramp: ARMED at rest."""
        self.engaged()
        self.held(round(self.gate.engage_ramp_s * 1000) + 1)
        assert self.state() is SafetyState.ARMED, self.reason
        self.events.clear()
        self.rules.clear()
        return self

    def moving(self, velocity_m_s: float = 0.1) -> "Rig":
        self.armed()
        position_m = self.stage_m
        for _ in range(100):
            position_m += velocity_m_s * 1e-3
            self.held(1, position_m, velocity_m_s=velocity_m_s)
        assert abs(self.out.velocity_m_s - velocity_m_s) < 0.01
        return self

    def at_rest_m(self, most_ticks: int = 200) -> float:
        """Ticks without input until nothing moves; where that is."""
        for _ in range(most_ticks):
            if not self.out.moving:
                break
            self.tick()
        assert not self.out.moving
        return self.stage_m


def test_a_release_a_press_and_the_ramp_lead_to_armed() -> None:
    """And a deadman that is simply held does not."""
    rig = Rig()
    rig.held(500)
    assert rig.state() is S.READY
    rig.released(1)
    rig.held(200)
    assert rig.state() is S.ENGAGING
    rig.held(2)
    assert rig.state() is S.ARMED
    assert rig.events == ["session_opened", "engage", "engaged"]


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


def ripple_m(late_ms: list[int]) -> tuple[float, float]:
    """How far the setpoint strays from a straight line while commands of one speed arrive with jitter, and
    from where the motion that it is said to follow was.
    """
    rig = Rig().armed()
    speed_m_s, ticks = 0.02, 2500
    arrivals: dict[int, list[int]] = {}
    for sent in range(ticks):
        arrivals.setdefault(sent + 10 + late_ms[sent % len(late_ms)], []).append(sent)
    start_ns, targets_m, behind_m, newest = rig.now_ns, list[float](), list[float](), -1
    for tick in range(ticks):
        command = None
        for sent in arrivals.get(tick, []):
            if sent < newest:  # overtaken: the gate refuses it
                continue
            newest = sent
            position_m, stamp_ns = START_M + sent * 1e-3 * speed_m_s, start_ns + sent * MS
            fresh, _ = rig.command(position_m, True, velocity_m_s=speed_m_s)
            command = fresh.model_copy(update={"stamp_ns": stamp_ns}), rig.now_ns
        ran_ns, out = rig.now_ns - start_ns, rig.tick(command)
        targets_m.append(out.target_m - tick * 1e-3 * speed_m_s)
        behind_m.append(out.target_m - START_M - (ran_ns - out.behind_ns) * 1e-9 * speed_m_s)
    return float(np.ptp(targets_m[-200:])), float(np.max(np.abs(behind_m[-200:])))


def test_jitter_of_the_network_is_no_jitter_of_the_stage() -> None:
    assert max(ripple_m([0])) < 1e-6
    strays_m, said_m = ripple_m([0] * 50 + [8] * 50)
    assert strays_m < 0.1 * 0.008 * 0.02
    assert said_m < 1e-6


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


def test_a_stop_that_comes_with_the_clearing_of_another_one_holds() -> None:
    rig = Rig().armed()
    rig.tick(estop="first")
    rig.tick(estop="second", clear=True)
    assert (rig.state(), rig.reason) == (S.ESTOPPED, "second")
    assert rig.control.stops == 0  # somebody chose them
    rig.tick(clear=True)
    assert rig.state() is S.READY


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


def test_stopping_lasts_until_the_stage_itself_rests() -> None:
    rig = Rig().moving(0.1)
    rig.released()
    for _ in range(300):
        rig.tick(stage_rests=False)
    assert (rig.state(), rig.out.moving) == (S.STOPPING, False)
    rig.tick()
    assert rig.state() is S.READY


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


@pytest.mark.parametrize(("timeout_s", "after"), [(0.2, S.FAULT), (None, S.ARMED)])
def test_a_load_cell_that_stays_invalid_is_a_fault_if_it_is_asked_for_while_the_stage_follows(
    timeout_s: float | None, after: SafetyState
) -> None:
    rig = Rig(gate=GateSettings(force_timeout_s=timeout_s), force_valid=False)
    rig.released(1000)
    assert rig.state() is S.READY
    rig.force_valid = True
    rig.armed().force_valid = False
    rig.held(200)
    assert rig.state() is S.ARMED
    rig.held(2)
    assert rig.state() is after


def test_a_load_cell_does_not_arm_before_a_valid_force_which_counts_as_zero_at_once() -> None:
    rig = Rig(force_valid=False)
    rig.released(300)
    rig.held(300)
    assert (rig.state(), set(rig.rules), rig.control.zeroed) == (S.READY, {"no_force"}, False)
    rig.force_n, rig.force_valid = 1.5, True
    rig.held(300)
    assert (rig.state(), rig.rules[300]) == (S.READY, "zero")
    rig.force_n = 0.0
    rig.released(1000)
    rig.held()
    assert (rig.state(), rig.control.zeroed) == (S.ENGAGING, True)
    rig = Rig(gate=GateSettings(force_timeout_s=None), force_valid=False)  # a recording may begin with a gap
    rig.engaged()


@pytest.mark.parametrize(("force_n", "arms"), [(0.14, True), (-0.14, True), (0.16, False), (-0.16, False)])
def test_first_arming_of_a_session_wants_a_zero_and_those_that_go_on_with_it_do_not(
    force_n: float, arms: bool
) -> None:
    """5 % of 3 N; a session within ten minutes of the last goes on."""
    rig = Rig(force_n=force_n)
    rig.released(300)
    rig.held(300)
    assert (rig.state() is S.ARMED) == arms
    assert ("zero" in rig.rules) == (not arms)
    for pause_s, armed in ((599.0, True), (601.0, False)):
        rig = Rig().armed()
        rig.force_n = 0.3
        rig.released()
        rig.tick(session_live=False)
        rig.now_ns += round(pause_s * 1000) * MS
        rig.released(400)
        rig.held(300)
        assert (rig.state() is S.ARMED) == armed


def test_force_above_limit_is_reported_in_every_state_and_is_the_fault_of_a_saturated_cell() -> None:
    rig = Rig()
    for force_n, over in ((3.1, False), (3.2, True), (-3.2, True)):
        rig.rules.clear()
        rig.force_n = force_n
        rig.tick(session_live=False)
        assert (rig.state(), "over_limit" in rig.rules) == (S.IDLE, over)
    rig = Rig().armed()
    rig.force_n, rig.force_valid = 4.9, False
    rig.held(300)
    assert rig.state() is S.FAULT
    assert rig.reason.startswith("force above limit")
    rig.rules.clear()
    rig.held()
    assert "over_limit" in rig.rules


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("seen_n", "blind_n"),
    [(3.1, 9.9), (3.1, 0.0), (2.75, 0.0), (0.1, 4.9), (2.75, -1.0)],
    ids=["saturated above it", "lost above it", "lost near it", "saturated at once", "nonsense near it"],
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
    assert {"force"} <= set(rig.rules) <= {"force", "over_limit"}
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
