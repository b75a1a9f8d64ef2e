"""The driver of the coil handle against the emulated device, in stepped time: what goes through, faults."""

from collections.abc import Callable
from dataclasses import replace
from math import cos, inf, nan, pi, sin
from typing import Literal

import pytest

from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.hardware.link import LinkState
from forefeel.common.messages import Grip, SafetyState
from forefeel.devices.coil.emulator import CoilDevice, CoilHardware
from forefeel.devices.coil.protocol import Flag
from forefeel.devices.emulation.wire import Wire
from forefeel.master.handle import Indication
from tests.devices.coil_rig import Bench, closed, opened
from tests.emulators.damage import DamagedWire, Faults

RETRY_MS = 500
WATCHDOG_MS = 20

# --- what goes through ---


@pytest.mark.parametrize("sign", [1, -1])
def test_position_velocity_and_buttons_come_through(sign: Literal[1, -1]) -> None:
    with opened(sign=sign, hardware=CoilHardware(sign=sign)) as bench:
        w = 2 * pi * 1.5
        bench.hand.course = lambda t: 0.02 * sin(w * t)
        bench.hand.pressed, bench.hand.grip = True, Grip.OPEN
        bench.run(3)
        for _ in range(700):
            bench.run(1)
            t_s = bench.time.t_s
            assert bench.reading.position_m == pytest.approx(0.02 * sin(w * t_s), abs=0.19 * 0.0012 + 2e-6)
            assert bench.reading.velocity_m_s == pytest.approx(
                0.02 * w * cos(w * t_s), abs=0.008
            )  # 4 ms of acceleration
        assert (bench.reading.deadman, bench.reading.gripper) == (True, Grip.OPEN)
        assert bench.counters["frames"] == pytest.approx(723, abs=12)
        assert bench.counters["frames_lost"] == 0
        assert bench.handle.link.exchanges == bench.counters["frames"]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_force_is_the_current_that_the_coil_makes_it_of(sign: Literal[1, -1]) -> None:
    with opened(sign=sign, hardware=CoilHardware(sign=sign)) as bench:
        for force_n, applied_n in ((1.2344, 1.234), (-0.5, -0.5), (9.0, 4.0), (-9.0, -4.0), (nan, 0.0)):
            bench.force_n = force_n
            bench.run(4)
            assert bench.applied_n == pytest.approx(applied_n, abs=1e-9)
            assert bench.hand.felt_n == pytest.approx(applied_n, abs=1e-9)
            assert bench.device.current_a == pytest.approx(sign * applied_n / 2.0, abs=1e-9)


def test_a_device_that_takes_less_current_than_asked_gives_the_force_that_is_said() -> None:
    with opened(hardware=CoilHardware(peak_a=0.8)) as bench:
        bench.force_n = 3.0
        bench.run(4)
        assert bench.device.current_a == pytest.approx(0.8)
        assert bench.applied_n == pytest.approx(bench.hand.felt_n) == pytest.approx(1.6)


def test_the_lamp_and_the_stages_position_reach_the_person_and_go_dark_with_the_host() -> None:
    with opened() as bench:
        assert bench.hand.sees == Indication(SafetyState.ARMED, 0.0123)
        bench.silent = True
        bench.run(30)
        assert bench.hand.sees == Indication(None, None)


def test_between_two_frames_the_reading_goes_on_for_five_milliseconds_and_no_longer() -> None:
    with opened() as bench:
        bench.hand.course = lambda t: 0.1 * t
        bench.run(50)
        bench.silent = True
        first = bench.reading
        found = [bench.run(1).reading for _ in range(12)]
        moved = [reading.position_m - first.position_m for reading in found]
        assert moved[:4] == pytest.approx([1e-4, 2e-4, 3e-4, 4e-4], abs=2e-6)
        assert moved[6:] == [moved[6]] * 6
        assert moved[6] <= 5.01e-4
        assert found[3].velocity_m_s == pytest.approx(0.1, rel=1e-3)
        assert found[8].velocity_m_s == 0.0


# --- the handshake ---


def hot(bench: Bench) -> None:
    bench.device.provoke("hot")
    bench.device._passes_s = inf


def silent(bench: Bench) -> None:
    bench.line.silent = True


@pytest.mark.parametrize(
    ("hardware", "before", "says"),
    [
        (CoilHardware(protocol=3), None, "protocol 3; expected 2"),
        (CoilHardware(period_us=4001), None, "a state each 4 ms; expected 5 within watchdog_s"),
        (CoilHardware(counts_per_m=2e6), None, "says 2000000 counts/m"),
        (CoilHardware(name="toaster"), None, "'toaster'"),
        (None, hot, "too hot"),
        (None, silent, "no answer"),
    ],
)
def test_device_that_is_not_fit_is_refused(
    hardware: CoilHardware | None, before: Callable[[Bench], None] | None, says: str
) -> None:
    with closed(hardware=hardware) as bench:
        if before is not None:
            before(bench)
        with pytest.raises(DeviceSetupError, match=says):
            bench.handle.open()
        assert bench.device.current_a == 0.0


def test_counts_have_to_be_known_to_device_or_settings() -> None:
    with (
        closed(hardware=CoilHardware(knows_counts=False), counts_per_m=None) as bench,
        pytest.raises(DeviceSetupError, match="says 0 counts/m"),
    ):
        bench.handle.open()


def test_force_that_is_later_than_passivity_allows_for_is_refused() -> None:
    with (
        closed(hardware=CoilHardware(period_us=10_000), watchdog_s=0.1) as bench,
        pytest.raises(DeviceSetupError, match=r"up to 20\.3 ms late; expected 20 ms at most"),
    ):
        bench.handle.open()


def test_rate_lateness_and_counts_are_those_of_the_device() -> None:
    """A slower device that counts otherwise; its states are carried on over five of its periods."""
    hardware = CoilHardware(period_us=3000, counts_per_m=4e5)
    with opened(hardware=hardware, counts_per_m=None, watchdog_s=0.05) as bench:
        wire_s = 16 * 10 / 500_000
        assert bench.handle.actuator_delay_s == pytest.approx(0.003 + wire_s + 0.003)
        assert bench.handle.link.identity.endswith(
            "firmware 2.0: a state each 3 ms, force up to 6.32 ms late, 400000 counts/m"
        )
        bench.hand.course = lambda t: 0.1 * t
        bench.run(600)
        assert bench.reading.position_m == pytest.approx(0.1 * bench.time.t_s, abs=0.1 * 0.0012 + 2.5e-6)
        assert bench.counters["frames"] == pytest.approx(200, abs=10)
        assert bench.counters["frames_lost"] == 0
        bench.silent = True
        first = bench.reading.position_m
        moved = [bench.run(1).reading.position_m - first for _ in range(25)]
        assert moved[9] == pytest.approx(1e-3, abs=1e-5)
        assert moved[-1] == moved[18] <= 1.51e-3


def test_device_that_says_other_than_before_is_not_taken_for_it() -> None:
    with opened() as bench:
        bench.line.plugged = False
        bench.run(30)
        bench.line.device = CoilDevice(CoilHardware(period_us=2000), bench.hand)
        bench.line.plugged = True
        bench.run(3 * RETRY_MS)
        assert bench.state is not LinkState.CONFIGURED
        assert bench.counters["faults"] >= 2


def test_lost_question_is_asked_again() -> None:
    with closed() as bench:
        whole, lossy = bench.line.to_device, DamagedWire(2_000_000, Faults(drop=1.0))
        bench.line.to_device = lossy

        def heal(now_ns: int) -> None:
            if bench.time.t_s >= 0.45:
                bench.line.to_device = whole

        bench.time.tick = heal
        bench.handle.open()
        assert lossy.counts["dropped"] == 5


def test_shorter_watchdog_of_the_device_is_taken() -> None:
    with opened(hardware=CoilHardware(longest_watchdog_ms=10)) as bench:
        bench.silent = True
        bench.force_n = 1.0
        bench.run(12)
        assert bench.device.counters["watchdog_trips"] == 1


# --- faults ---


def test_when_the_host_goes_silent_the_device_takes_the_current_away_in_its_watchdogs_time() -> None:
    with opened() as bench:
        bench.force_n = 3.0
        bench.run(30)
        assert bench.currents_a[-1] == 1.5
        bench.silent = True
        bench.run(60)
        held = bench.currents_a[-60:].index(0.0)
        assert WATCHDOG_MS - 1 <= held <= WATCHDOG_MS + 2
        assert set(bench.currents_a[-60 + held :]) == {0.0}
        bench.silent = False  # the thread wakes up; the device has told
        bench.run(50)
        assert "no state for" in bench.fallen()
        assert set(bench.currents_a[-50:]) == {0.0}


def test_a_haptic_loop_that_stands_still_is_a_fault_only_while_there_is_a_force() -> None:
    with opened() as bench:
        bench.haptic = False
        bench.run(200)
        assert bench.state is LinkState.READY
        bench.haptic = True
        bench.force_n = 2.0
        bench.run(20)
        assert bench.currents_a[-1] == 1.0
        bench.haptic = False
        bench.run(40)
        assert WATCHDOG_MS - 1 <= bench.currents_a[-40:].index(0.0) <= WATCHDOG_MS + 2
        bench.haptic = True
        bench.run(1)
        assert "the haptic loop stands still" in bench.fallen()


FAULTS = {
    "stuck": "no state for",
    "overrange": "lost its zero",
    "hot": "too hot",
    "drive_fault": "overcurrent",
}


def break_it(bench: Bench, fault: str) -> None:
    if fault == "unplug":
        bench.line.plugged = False
    else:
        bench.device.provoke(fault)


@pytest.mark.parametrize(("fault", "says"), [("unplug", "gone"), *FAULTS.items()])
def test_no_force_and_no_deadman_after_a_fault_until_the_deadman_is_pressed_anew_and_re_armed(
    fault: str, says: str
) -> None:
    with opened() as bench:
        bench.force_n = 3.0
        bench.press(True)
        assert (bench.reading.deadman, bench.currents_a[-1]) == (True, 1.5)
        break_it(bench, fault)
        bench.run(60)
        assert says in bench.fallen()
        if fault != "unplug":
            assert fault == "stuck" or bench.currents_a[-60:].index(0.0) <= 3
        bench.line.plugged = True
        bench.run(3 * RETRY_MS)
        assert bench.state is LinkState.CONFIGURED
        assert not bench.handle.pressed_anew  # it has been held all the time
        command = bench.device._command  # what the device is told, whatever it makes of it
        assert (command.current_ma, command.enabled) == (0, False)
        assert says in bench.fallen()
        assert not bench.press(False).handle.pressed_anew
        assert bench.press(True).handle.pressed_anew
        assert set(bench.currents_a[-3 * RETRY_MS :]) == {0.0}
        assert set(bench.readings[-3 * RETRY_MS :]) == {None}
        bench.handle.rearm()
        assert not bench.handle.pressed_anew
        bench.run(10)
        assert (bench.reading.deadman, bench.currents_a[-1]) == (True, 1.5)
        assert bench.counters["faults"] >= 1


def test_a_re_arming_alone_gives_no_force_before_the_next_rendering() -> None:
    with opened() as bench:
        bench.force_n = 3.0
        bench.run(10)
        bench.device.provoke("drive_fault")
        bench.run(10)
        with pytest.raises(DeviceError, match="overcurrent; the link is closed"):
            bench.handle.rearm()
        bench.run(2 * RETRY_MS)
        bench.press(False).press(True)
        bench.haptic = False
        bench.handle.rearm()
        bench.run(100)
        assert bench.state is LinkState.READY
        assert set(bench.currents_a[-100:]) == {0.0}


def test_another_device_on_the_same_port_is_not_taken_for_the_first() -> None:
    with opened() as bench:
        bench.line.plugged = False
        bench.run(30)
        bench.line.device = CoilDevice(replace(CoilHardware(), serial="B2"), bench.hand)
        bench.line.plugged = True
        bench.run(3 * RETRY_MS)
        assert bench.state is not LinkState.CONFIGURED
        assert bench.counters["faults"] >= 2


def test_a_device_that_starts_anew_within_the_watchdogs_time_is_noticed() -> None:
    with opened() as bench:
        bench.force_n = 1.0
        bench.run(10)
        bench.device._start(bench.device._next * 1e-3)
        bench.device._identified = True  # a firmware that talks unasked
        bench.device._watchdog_s = 1.0
        bench.run(5)
        assert "was reset" in bench.fallen()


# --- the wire ---


@pytest.mark.parametrize("faults", [Faults(corrupt=0.01), Faults(split=0.5), Faults(drop=0.1)])
def test_exactly_the_damaged_frames_are_lost_and_nothing_fails(faults: Faults) -> None:
    with opened(faults=faults) as bench:
        bench.hand.course = lambda t: 0.02 * sin(3 * t)
        bench.run(3000)
        commands, states = (wire.counts for wire in bench.wires)
        assert sum(states[name] for name in ("corrupted", "split", "dropped")) > 20
        under_way = 2 if faults.drop else 0
        lost = states["corrupted"] + states["dropped"]
        assert abs(bench.counters["frames_lost"] - lost) <= under_way
        lost = commands["corrupted"] + commands["dropped"]
        assert abs(bench.device.counters["commands_lost"] - lost) <= under_way
        assert bench.state is LinkState.READY and None not in bench.readings


def test_states_that_come_later_and_later_are_as_none_though_they_come_all_the_time() -> None:
    with opened() as bench:
        bench.line.to_host = Wire(220_000)  # 24 bytes in 1.09 ms
        bench.run(190)
        assert bench.state is LinkState.READY
        bench.run(60)  # 20 ms late after 220 ms
        assert "the line holds states back" in bench.fallen()


def test_closing_takes_the_current_away_at_once() -> None:
    with opened() as bench:
        bench.force_n = 3.0
        bench.run(10)
        bench.handle.close()
        bench.run(2)
        assert bench.device.current_a == 0.0
        assert Flag.WATCHDOG not in bench.device._flags
