"""The driver of the coil handle against the emulated device, in virtual time."""

from math import cos, nan, pi, sin
from typing import Literal

import pytest

from forefeel.common.errors import DeviceError
from forefeel.common.hardware.link import LinkState
from forefeel.common.messages import Grip, SafetyState
from forefeel.devices.coil.emulator import CoilDevice, CoilHardware
from forefeel.devices.emulation.wire import Faults, Wire
from forefeel.master.handle import Indication
from tests.devices.coil_rig import Bench, Hand, fallen, opened, state

# --- what goes through ---


@pytest.mark.parametrize("sign", [1, -1])
def test_position_velocity_and_buttons_come_through(sign: Literal[1, -1]) -> None:
    bench = opened(sign=sign, hardware=CoilHardware(sign=sign))
    w = 2 * pi * 1.5
    bench.hand.course = lambda t: 0.02 * sin(w * t)
    bench.hand.pressed, bench.hand.grip = True, Grip.OPEN
    bench.run(3)
    for _ in range(700):
        bench.run(1)
        t_s = bench.clock.now_ns() * 1e-9 + bench.line.ahead_s
        assert bench.reading.position_m == pytest.approx(0.02 * sin(w * t_s), abs=0.19 * 0.0012 + 2e-6)
        assert bench.reading.velocity_m_s == pytest.approx(0.02 * w * cos(w * t_s), abs=0.006)
    assert (bench.reading.deadman, bench.reading.gripper) == (True, Grip.OPEN)
    assert bench.counters["frames"] == pytest.approx(723, abs=12)
    assert bench.counters["frames_lost"] == 0
    assert bench.handle.link.exchanges == bench.counters["frames"]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_force_is_the_current_that_the_coil_makes_it_of(sign: Literal[1, -1]) -> None:
    bench = opened(sign=sign, hardware=CoilHardware(sign=sign))
    for force_n, applied_n in ((1.2344, 1.234), (-0.5, -0.5), (9.0, 4.0), (-9.0, -4.0), (nan, 0.0)):
        bench.force_n = force_n
        bench.run(4)
        assert bench.applied_n == pytest.approx(applied_n, abs=1e-9)
        assert bench.hand.felt_n == pytest.approx(applied_n, abs=1e-9)
        assert bench.device.current_a == pytest.approx(sign * applied_n / 2.0, abs=1e-9)


def test_the_lamp_and_the_stages_position_reach_the_person_and_go_dark_with_the_host() -> None:
    bench = opened()
    assert bench.hand.sees == Indication(SafetyState.ARMED, 0.0123)
    bench.handle.silent = True
    bench.run(30)
    assert bench.hand.sees == Indication(None, None)


def test_between_two_frames_the_reading_goes_on_for_five_milliseconds_and_no_longer() -> None:
    bench = opened()
    bench.hand.course = lambda t: 0.1 * t
    bench.run(50)
    bench.handle.silent = True
    first = bench.reading
    found = [bench.run(1).reading for _ in range(12)]
    moved = [reading.position_m - first.position_m for reading in found]
    assert moved[:4] == pytest.approx([1e-4, 2e-4, 3e-4, 4e-4], abs=2e-6)
    assert moved[6:] == [moved[6]] * 6
    assert moved[6] <= 5.01e-4
    assert found[3].velocity_m_s == pytest.approx(0.1, rel=1e-3)
    assert found[8].velocity_m_s == 0.0


# --- the handshake ---


@pytest.mark.parametrize(
    ("hardware", "says"),
    [
        (CoilHardware(protocol=2), r"^memory: firmware 1.0 speaks protocol 2; expected 1$"),
        (
            CoilHardware(name="toaster"),
            r"^memory: 'toaster' answers; expected 'forefeel-coil', a coil handle$",
        ),
    ],
)
def test_another_device_or_version_is_refused(hardware: CoilHardware, says: str) -> None:
    bench = Bench(hardware=hardware)
    bench.handle.open()
    assert state(bench) is LinkState.CLOSED
    with pytest.raises(DeviceError, match=says.strip("^$")):
        bench.handle.read(bench.clock.now_ns())
    bench.run(100)
    assert set(bench.currents_a) == {0.0}


class Mute(CoilDevice):
    """Sends the same bytes, whatever it hears."""

    def __init__(self, says: bytes) -> None:
        super().__init__(person=Hand())
        self._says = says

    def advance(self, t_s: float) -> bytes:
        super().advance(t_s)
        return self._says


@pytest.mark.parametrize(
    ("says", "reason"),
    [
        (b"", "memory: no answer at 2000000 baud; expected a coil handle (wrong port, baud?)"),
        (b"\x80\x00", " bytes, no answer among them at 2000000 baud; expected a coil handle"),
    ],
)
def test_silence_and_noise_are_told_apart(says: bytes, reason: str) -> None:
    bench = Bench()
    bench.line.device = Mute(says)
    bench.handle.open()
    bench.run(1001)
    assert reason in fallen(bench)


def test_a_lost_question_is_asked_again() -> None:
    bench = Bench()
    whole, bench.line.to_device = bench.line.to_device, Wire(2_000_000, Faults(drop=1.0), "")
    bench.handle.open()
    bench.run(450)
    assert state(bench) is LinkState.OPEN
    assert bench.line.to_device.counts["dropped"] == 5
    bench.line.to_device = whole
    bench.run(100)
    assert state(bench) is LinkState.READY


def test_a_device_that_holds_its_watchdog_shorter_is_taken_and_a_hot_one_is_not() -> None:
    bench = opened(hardware=CoilHardware(longest_watchdog_ms=10))
    bench.handle.silent = True
    bench.force_n = 1.0
    bench.run(12)
    assert bench.device.counters["watchdog_trips"] == 1
    hot = Bench()
    hot.device._heat = 100.0
    hot.handle.open()
    hot.run(1001)
    assert hot.handle.link.inhibited == "memory: the coil is too hot; expected a handle without a fault"
