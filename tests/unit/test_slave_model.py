"""A slave axis to which anything happens in any order, beside a model that knows only what was done to it.

After every millisecond: the stage goes on only while commands are followed, or on a ramp to rest; within its
limits of speed and acceleration; on commands of the master alone, fresh, each in its turn; never after a halt
without a clearing, a release and a press; and 60 ms after the last of them at most.
"""

from math import inf, isfinite, nan
from random import Random

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    precondition,
    rule,
    run_state_machine_as_test,
)

from forefeel.common.codec import encode
from forefeel.common.messages import FOLLOWING, MOST_POSITION_M, MotionCommand, SafetyState
from forefeel.common.settings import AxisLimits
from forefeel.common.topics import COMMAND, EMERGENCY_STOP
from forefeel.slave.load_cell import LoadCellReading
from tests.messages import usual
from tests.unit.rigs import MS, SETTINGS, SlaveRig

S = SafetyState
LIMITS = AxisLimits()
RAMP_M_S = SETTINGS.gate.stop_deceleration_m_s2 * 1e-3
STEP_M_S = LIMITS.max_acceleration_m_s2 * 1e-3
WATCHDOG_NS, MAX_AGE_NS = 60 * MS, 100 * MS
HALTS = frozenset({S.FAULT, S.ESTOPPED})
TINY = 1e-9
FLAG, NUMBER = st.booleans(), st.integers(0, 2**62)
SOUND = LoadCellReading(0.1, 100, True)
Key = tuple[int, int, int]


class SlaveModel(RuleBasedStateMachine):
    """The rules are what people, networks, devices and strangers do."""

    def __init__(self) -> None:
        super().__init__()
        self.rig = SlaveRig()
        self.mine: dict[Key, MotionCommand] = {}
        self.sent: list[bytes] = []
        self.halted = self.released = False
        self.last_fresh_ns = 0
        self.executed: Key | None = None
        self.velocity_m_s, self.position_m = 0.0, self.rig.stage.position_m
        self.stranger = 0

    @initialize(armed=FLAG)
    def begin(self, armed: bool) -> None:
        self.rig.axis.open(self.rig.now_ns)
        assert self.rig.shake().accepted
        self._run(120)
        if armed:
            self._press()
            assert self.rig.axis.state is S.ARMED

    # --- what the master does ---

    @rule()
    def arm(self) -> None:
        self._press()

    def _press(self) -> None:
        self.rig.deadman, self.rig.fields = False, {}
        self.rig.position_m = self.rig.stage.position_m
        self._run(5)
        self.rig.position_m, self.rig.deadman = self.rig.stage.position_m, True
        self._run(30)

    @rule(deadman=FLAG)
    def hand(self, deadman: bool) -> None:
        self.rig.deadman = deadman

    @rule(by_m=st.floats(-0.003, 0.003), speed_m_s=st.floats(-0.3, 0.3), ticks=st.integers(1, 40))
    def move(self, by_m: float, speed_m_s: float, ticks: int) -> None:
        self.rig.fields = {"velocity_m_s": speed_m_s}
        for _ in range(ticks):
            self.rig.position_m = min(max(self.rig.position_m + by_m, -0.04), 0.15)
            self._tick(send=True)

    @rule(position_m=st.floats(-0.05, 0.17) | st.floats(-MOST_POSITION_M, MOST_POSITION_M))
    def jump(self, position_m: float) -> None:
        self.rig.position_m = position_m
        self._tick(send=True)

    @rule(session_id=st.integers(1, 2**62))
    def ask_for_a_session(self, session_id: int) -> None:
        if self.rig.shake(session_id).accepted:
            self.rig.session_id, self.executed = session_id, None
            self.released = False

    @rule(beating=FLAG)
    def heart(self, beating: bool) -> None:
        self.rig.beating = beating

    # --- what the network does ---

    @rule(ticks=st.integers(1, 150))
    def silence(self, ticks: int) -> None:
        for _ in range(ticks):
            self._tick(send=False)

    @rule(ticks=st.integers(2, 150), longer=st.integers(0, 200), lets_go=FLAG, mixer=st.none() | st.randoms())
    def stall(self, ticks: int, longer: int, lets_go: bool, mixer: Random | None) -> None:
        """What was sent meanwhile comes at once, later still, perhaps in another order; the hand may have let
        go and pressed again.
        """
        waiting = []
        for tick in range(ticks):
            if lets_go:
                self.rig.position_m, self.rig.deadman = self.rig.stage.position_m, tick > ticks // 2
            waiting.append(self.rig.next_command())
            self._tick(send=False)
        for _ in range(longer):
            self._tick(send=False)
        if mixer is not None:
            mixer.shuffle(waiting)
        for command in waiting:
            self._deliver(command)
        self._tick(send=False)

    # --- what strangers do ---

    @precondition(lambda self: self.sent)
    @rule(data=st.data(), times=st.integers(1, 3))
    def replay(self, data: st.DataObject, times: int) -> None:
        payload = data.draw(st.sampled_from(self.sent[-400:]))
        for _ in range(times):
            self.rig.put(COMMAND, payload)
        self._tick(send=False)

    # Two clocks that are compared once a second at least may have parted by 1 ms (1000 ppm).
    @rule(
        ahead_ms=st.integers(2, 10**7), stranger=st.none() | st.integers(0, 2**62), deadman=FLAG, armed=FLAG
    )
    def forge(self, ahead_ms: int, stranger: int | None, deadman: bool, armed: bool) -> None:
        """A command of the master's session from the future, or of another session from now."""
        if armed:
            self._press()
        session_id = self.rig.session_id if stranger is None else stranger
        if stranger == self.rig.session_id:
            return
        self.stranger += 1
        forged = usual(
            COMMAND, session_id=session_id, sequence=2**40 + self.stranger, deadman=deadman,
            stamp_ns=self.rig.now_ns + (ahead_ms * MS if stranger is None else 0),
            position_m=self.rig.stage.position_m, velocity_m_s=0.1,
        )  # fmt: skip
        self.rig.put(COMMAND, encode(forged))
        self._tick(send=False)

    @rule(payload=st.binary(max_size=80))
    def garbage(self, payload: bytes) -> None:
        self.rig.put(COMMAND, payload)
        self._tick(send=True)

    @rule(session_id=NUMBER)
    def another_master(self, session_id: int) -> None:
        """He gets a session only where nobody holds one, and then does nothing with it."""
        if session_id != self.rig.session_id and self.rig.shake(session_id).accepted:
            self.released = False

    # --- who stops, and who clears ---

    @rule(readable=FLAG, times=st.integers(1, 5))
    def emergency_stop(self, readable: bool, times: int) -> None:
        for _ in range(times):
            self.rig.put(EMERGENCY_STOP, encode(usual(EMERGENCY_STOP)) if readable else b"stop")
        self.halted = True
        self._tick(send=True)
        assert self.rig.axis.state is S.ESTOPPED

    @rule()
    def thread_fails(self) -> None:
        self.rig.axis.fail(RuntimeError("gone"))
        self.halted = True
        self._tick(send=True)
        assert self.rig.axis.state in HALTS

    @rule(force_n=st.floats(-5.0, 5.0) | st.sampled_from([nan, inf]), valid=FLAG)
    def force(self, force_n: float, valid: bool) -> None:
        self.rig.load_cell.reading = LoadCellReading(force_n, 0, valid)
        if isfinite(force_n):
            return
        self.halted = True
        self._tick(send=True)
        self.rig.load_cell.reading = SOUND
        self._tick(send=True)
        assert self.rig.axis.state in HALTS

    @rule()
    def clear(self) -> None:
        self.rig.load_cell.reading = SOUND
        self.rig.axis.clear()
        self.released &= not self.halted  # what is not halted is not cleared, and who let go has let go
        self.halted = False
        self._tick(send=True)

    # --- the model ---

    def _run(self, ticks: int) -> None:
        for _ in range(ticks):
            self._tick(send=True)

    def _deliver(self, command: MotionCommand) -> None:
        payload = encode(command)
        self.sent.append(payload)
        self.mine[command.session_id, command.sequence, command.stamp_ns] = command
        if self.rig.now_ns - command.stamp_ns <= MAX_AGE_NS:
            self.last_fresh_ns = self.rig.now_ns
            self.released |= not command.deadman
        self.rig.put(COMMAND, payload)

    def _tick(self, send: bool) -> None:
        before, commands = self.rig.axis.state, len(self.rig.stage.commands)
        self.rig.sends = False
        if send:
            self._deliver(self.rig.next_command())
        self.rig.step()
        self._check(before, self.rig.stage.commands[commands:])

    def _check(self, before: SafetyState, moved: list[tuple[int, float, float]]) -> None:
        following = self.rig.axis.state in FOLLOWING
        executing = self.rig.axis._executing
        assert (executing is not None) == following
        if before in FOLLOWING and not following:
            self.released = False
        if following and before not in FOLLOWING:
            assert before is S.READY
            assert self.released, "engages though nobody has let go since the last stop"
            self.velocity_m_s, self.position_m = 0.0, self.rig.axis._watch.stage.position_m
        self._check_motion(following, moved)
        if executing is not None:
            self._check_executed(executing)
            assert not self.halted, "follows after a halt"
            assert self.rig.now_ns - self.last_fresh_ns <= WATCHDOG_NS + MS, "the watchdog is late"
        if self.halted:
            assert self.rig.axis.state in HALTS
        if not self.halted and self.rig.axis.state in HALTS:
            self.halted = True  # blind for too long

    def _check_motion(self, following: bool, moved: list[tuple[int, float, float]]) -> None:
        assert len(moved) <= 1
        if not moved:
            assert not following
            assert abs(self.velocity_m_s) <= RAMP_M_S + TINY, "the stage stood at once"
            self.velocity_m_s = 0.0
            return
        _, position_m, velocity_m_s = moved[0]
        assert abs(velocity_m_s) <= LIMITS.max_velocity_m_s + TINY
        assert abs(position_m - self.position_m) <= LIMITS.max_velocity_m_s * 1e-3 + TINY
        if following:
            assert abs(velocity_m_s - self.velocity_m_s) <= STEP_M_S + TINY
        else:
            assert abs(velocity_m_s) <= max(0.0, abs(self.velocity_m_s) - RAMP_M_S) + TINY
            assert velocity_m_s * self.velocity_m_s >= 0.0
        self.velocity_m_s, self.position_m = velocity_m_s, position_m

    def _check_executed(self, command: MotionCommand) -> None:
        key = command.session_id, command.sequence, command.stamp_ns
        assert self.mine.get(key) == command, "a command that the master did not send"
        assert command.deadman
        if key == self.executed:
            return
        assert self.executed is None or key[1:] > self.executed[1:], "an old command after a newer one"
        assert self.rig.now_ns - command.stamp_ns <= MAX_AGE_NS + MS, "a stale command"
        self.executed = key


def test_whatever_happens_in_whatever_order_the_stage_moves_only_as_it_may() -> None:
    run_state_machine_as_test(
        SlaveModel, settings=settings(max_examples=20, stateful_step_count=25, deadline=None)
    )
