"""What a cycle decides, in virtual time: supervision and setpoints."""

from math import copysign
from random import Random

import pytest

from forefeel.common.errors import DeviceError
from forefeel.devices.cia402 import protocol as cia402
from forefeel.devices.cia402.driver import DriveCycle, Readback, Tracker
from forefeel.devices.cia402.protocol import DriveState, Phase
from forefeel.devices.shared.stage import Setpoint, Wanted

PERIOD_S = 0.004
PERIOD_NS = 4_000_000
WORDS = {state: bits for state, (_, bits) in cia402.PATTERNS.items()}


class Rig:
    """A cycle, and a drive that goes where it is sent one cycle later."""

    def __init__(self, start_m: float = 0.01) -> None:
        setpoint = Setpoint(PERIOD_S, (0.0, 0.1), 0.2, 4.0)
        setpoint.restart(0.0)
        self.cycle = DriveCycle(PERIOD_S, 0.02, setpoint)
        self.position_m = start_m
        self.state = DriveState.DISABLED
        self.now_ns = 0
        self.answers = self.beats = True
        self.emergency: int | None = None

    def step(self, wanted_m: float | None = None) -> int:
        self.now_ns += PERIOD_NS
        heard = Readback(self.now_ns, WORDS[self.state], self.position_m, 0.0) if self.answers else None
        wanted = None if wanted_m is None else Wanted(wanted_m, 0.0, self.now_ns)
        word = self.cycle.step(heard, self.beats, self.emergency, wanted, self.now_ns)
        self._obey(word)
        return word

    def _obey(self, word: int) -> None:
        after = {0x06: DriveState.READY, 0x07: DriveState.SWITCHED_ON, 0x0F: DriveState.ENABLED}
        if word == cia402.QUICK_STOP and self.state is DriveState.ENABLED:
            self.state = DriveState.QUICK_STOP
        elif word == cia402.FAULT_RESET:
            self.state = DriveState.DISABLED
        elif self.state is not DriveState.FAULT:
            self.state = after.get(word, self.state)
        if self.state is DriveState.ENABLED:
            self.position_m = self.cycle.setpoint.position_m

    def follow(self) -> "Rig":
        self.step()
        self.cycle.machine.enable()
        for _ in range(5):
            self.step()
        assert self.cycle.machine.phase is Phase.FOLLOWING
        return self


def test_the_target_is_the_actual_position_until_it_follows() -> None:
    rig = Rig(start_m=0.037)
    rig.step(0.09)
    rig.cycle.machine.enable()
    for _ in range(4):
        rig.step(0.09)
        assert rig.cycle.setpoint.position_m == 0.037
    rig.step(0.09)
    assert rig.cycle.setpoint.position_m == pytest.approx(0.037 + 0.2 * PERIOD_S)


@pytest.mark.parametrize(("period_s", "periods"), [(0.02, 3), (0.01, 5), (0.004, 12), (0.002, 25)])
def test_nothing_is_heard(period_s: float, periods: int) -> None:
    cycle = DriveCycle(period_s, 0.5, Setpoint(period_s, (0.0, 0.1), 0.2, 4.0))
    cycle.step(Readback(0, WORDS[DriveState.DISABLED], 0.01, 0.0), True, None, None, 0)
    for _ in range(periods):
        cycle.step(None, True, None, None, 0)
    with pytest.raises(DeviceError, match=f"no TPDO of the drive for {periods} SYNC periods"):
        cycle.step(None, True, None, None, 0)


def test_heartbeat_is_missed() -> None:
    rig = Rig().follow()
    rig.beats = False
    with pytest.raises(DeviceError, match="no heartbeat"):
        for _ in range(17):
            rig.step()
    assert rig.now_ns <= (6 + 17) * PERIOD_NS


def test_emergency_is_a_fault_unless_it_stands_already() -> None:
    rig = Rig()
    rig.emergency = 0x8130
    rig.step()
    rig.emergency = None
    rig.follow()
    rig.emergency = 0x2310
    with pytest.raises(DeviceError, match="emergency 2310"):
        rig.step()


@pytest.mark.parametrize("state", [s for s in DriveState if s is not DriveState.ENABLED])
def test_the_drive_leaves_operation(state: DriveState) -> None:
    rig = Rig().follow()
    rig.state = state
    with pytest.raises(DeviceError, match=state.value):
        rig.step()
    before_m = rig.cycle.setpoint.position_m
    for _ in range(20):
        assert rig.step(0.09) == cia402.QUICK_STOP
    assert rig.position_m == before_m


def test_stream_that_ends_is_held() -> None:
    rig = Rig().follow()
    rig.step(0.1)
    stale = Wanted(0.1, 0.0, rig.now_ns)
    for _ in range(50):
        rig.now_ns += PERIOD_NS
        heard = Readback(rig.now_ns, WORDS[DriveState.ENABLED], rig.position_m, 0.0)
        rig.cycle.step(heard, True, None, stale, rig.now_ns)
        rig.position_m = rig.cycle.setpoint.position_m
    assert rig.cycle.setpoint.velocity_m_s == 0.0
    assert rig.position_m < 0.01 + 0.2 * 0.064 + 0.2**2 / (2 * 4.0) + 1e-9


@pytest.mark.parametrize("seed", range(30))
def test_setpoint_never_jumps_and_never_goes_further_out(seed: int) -> None:
    random = Random(seed)
    start_m = random.uniform(-0.05, 0.15)
    setpoints_m = [random.choice([None, random.uniform(-0.3, 0.3)]) for _ in range(200)]
    setpoint = Setpoint(PERIOD_S, (0.0, 0.1), 0.2, 4.0)
    setpoint.restart(start_m)
    for wanted_m in setpoints_m:
        before_m, before_m_s = setpoint.position_m, setpoint.velocity_m_s
        if wanted_m is None:
            setpoint.hold()
            assert abs(setpoint.velocity_m_s) <= max(0.0, abs(before_m_s) - 4.0 * PERIOD_S) + 1e-12
        else:
            setpoint.follow(wanted_m)
        assert abs(setpoint.position_m - before_m) <= 0.2 * PERIOD_S + 1e-12
        assert min(start_m, 0.0) - 1e-12 <= setpoint.position_m <= max(start_m, 0.1) + 1e-12


def test_hold_brakes_to_a_stop() -> None:
    setpoint = Setpoint(PERIOD_S, (0.0, 0.1), 0.2, 4.0)
    setpoint.restart(0.02)
    setpoint.follow(0.1)
    for _ in range(13):
        setpoint.hold()
    assert setpoint.velocity_m_s == 0.0
    assert 0.0 < setpoint.position_m - 0.0208 <= 0.2**2 / (2 * 4.0)


def test_velocity_spans_a_lost_frame() -> None:
    tracker = Tracker(PERIOD_S, 0.2, 0.002)
    tracker.take(0, 0x27, 0.010)
    found = tracker.take(2 * PERIOD_NS + 300_000, 0x27, 0.0108)
    assert found is not None
    assert found.velocity_m_s == pytest.approx(0.1)


@pytest.mark.parametrize("wrong_m", [1.0, -0.5, 0.02])
def test_a_position_that_can_not_be_is_not_received(wrong_m: float) -> None:
    tracker = Tracker(PERIOD_S, 0.2, 0.002)
    tracker.take(0, 0x27, 0.010)
    assert tracker.take(PERIOD_NS, 0x27, wrong_m) is None
    found = tracker.take(2 * PERIOD_NS, 0x27, 0.010 + copysign(1e-4, wrong_m))
    assert found is not None
    assert abs(found.velocity_m_s) == pytest.approx(0.0125)
