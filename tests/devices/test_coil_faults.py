"""Faults of the coil handle, of its host and of the wire between them, in virtual time."""

from dataclasses import replace
from math import sin

import pytest

from forefeel.common.errors import DeviceError
from forefeel.common.hardware.link import LinkState
from forefeel.devices.coil.emulator import CoilDevice, CoilHardware
from forefeel.devices.coil.protocol import Flag
from forefeel.devices.emulation.wire import Faults, Wire
from tests.devices.coil_rig import RETRY_NS, Bench, fallen, opened, state

RETRY_MS = RETRY_NS // 1_000_000
WATCHDOG_MS = 20


# --- faults ---


def test_when_the_host_goes_silent_the_device_takes_the_current_away_in_its_watchdogs_time() -> None:
    bench = opened()
    bench.force_n = 3.0
    bench.run(30)
    assert bench.currents_a[-1] == 1.5
    bench.handle.silent = True
    bench.run(60)
    held = bench.currents_a[-60:].index(0.0)
    assert WATCHDOG_MS - 1 <= held <= WATCHDOG_MS + 2
    assert set(bench.currents_a[-60 + held :]) == {0.0}
    bench.handle.silent = False  # the thread wakes up; the device has told
    bench.run(50)
    assert "no state for" in fallen(bench)
    assert set(bench.currents_a[-50:]) == {0.0}


def test_a_haptic_loop_that_stands_still_is_a_fault_only_while_there_is_a_force() -> None:
    bench = opened()
    bench.haptic = False
    bench.run(200)
    assert state(bench) is LinkState.READY
    bench.haptic = True
    bench.force_n = 2.0
    bench.run(20)
    assert bench.currents_a[-1] == 1.0
    bench.haptic = False
    bench.run(40)
    assert WATCHDOG_MS - 1 <= bench.currents_a[-40:].index(0.0) <= WATCHDOG_MS + 2
    bench.haptic = True
    bench.run(1)
    assert "the haptic loop stands still" in fallen(bench)


FAULTS = {"stuck": "no state for", "overrange": "lost its zero", "drive_fault": "overcurrent"}


def break_it(bench: Bench, fault: str) -> None:
    if fault == "unplug":
        bench.line.plugged = False
    else:
        bench.device.provoke(fault)


@pytest.mark.parametrize(("fault", "says"), [("unplug", "gone"), *FAULTS.items()])
def test_no_force_and_no_deadman_after_a_fault_until_the_deadman_is_pressed_anew_and_re_armed(
    fault: str, says: str
) -> None:
    bench = opened()
    bench.force_n = 3.0
    bench.press(True)
    assert (bench.reading.deadman, bench.currents_a[-1]) == (True, 1.5)
    break_it(bench, fault)
    bench.run(60)
    assert says in fallen(bench)
    if fault != "unplug":
        assert fault == "stuck" or bench.currents_a[-60:].index(0.0) <= 3
    bench.line.plugged = True
    bench.run(3 * RETRY_MS)
    assert state(bench) is LinkState.CONFIGURED
    assert not bench.handle.pressed_anew  # it has been held all the time
    command = bench.device._command  # what the device is told, whatever it makes of it
    assert (command.current_ma, command.enabled) == (0, False)
    assert says in fallen(bench)
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
    bench = opened()
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
    assert state(bench) is LinkState.READY
    assert set(bench.currents_a[-100:]) == {0.0}


def test_a_coil_that_gets_too_hot_is_a_fault_and_waits_until_it_is_cool() -> None:
    hardware = CoilHardware(continuous_a=1.0, thermal_s=0.5)
    bench = opened(hardware=hardware)
    bench.force_n = 4.0
    bench.run(300)  # 4 A2 warms to 1 A2 in 0.14 s
    assert "too hot" in fallen(bench)
    hot_ms = bench.currents_a.index(0.0, bench.currents_a.index(2.0)) - bench.currents_a.index(2.0)
    assert hot_ms == pytest.approx(500 * 0.2877, abs=4)
    assert state(bench.run(2 * RETRY_MS)) is LinkState.CONFIGURED
    assert set(bench.currents_a[-2 * RETRY_MS :]) == {0.0}


def test_another_device_on_the_same_port_is_not_taken_for_the_first() -> None:
    bench = opened()
    bench.line.plugged = False
    bench.run(30)
    bench.line.device = CoilDevice(replace(CoilHardware(), serial="B2"), bench.hand)
    bench.line.plugged = True
    bench.run(3 * RETRY_MS)
    assert state(bench) is not LinkState.CONFIGURED
    assert bench.counters["faults"] >= 2


def test_a_device_that_starts_anew_within_the_watchdogs_time_is_noticed() -> None:
    bench = opened()
    bench.force_n = 1.0
    bench.run(10)
    bench.device._start(bench.device._next * 1e-3)
    bench.device._identified = True  # a firmware that talks unasked
    bench.device._watchdog_s = 1.0
    bench.run(5)
    assert "began anew" in fallen(bench)


# --- the wire ---


def test_of_frames_with_a_wrong_byte_exactly_those_are_lost_and_nothing_fails() -> None:
    bench = opened(faults=Faults(corrupt=0.01))
    bench.hand.course = lambda t: 0.02 * sin(3 * t)
    bench.run(5000)
    befallen = bench.line.to_host.counts["corrupted"]
    assert befallen > 30
    assert bench.counters["frames_lost"] == befallen
    assert state(bench) is LinkState.READY
    assert bench.device.counters["commands_lost"] == bench.line.to_device.counts["corrupted"] > 30
    assert None not in bench.readings


def test_frames_that_come_in_parts_lose_nothing() -> None:
    bench = opened(faults=Faults(split=0.5))
    bench.run(1000)
    assert bench.line.to_host.counts["split"] > 400
    assert (bench.counters["frames_lost"], bench.device.counters["commands_lost"]) == (0, 0)


def test_a_wire_that_drops_for_less_than_the_watchdogs_time_goes_on_and_counts() -> None:
    bench = opened(faults=Faults(drop=0.1))
    bench.run(3000)
    lost = bench.line.to_host.counts["dropped"]
    assert lost > 200
    assert bench.counters["frames_lost"] == pytest.approx(lost, abs=2)
    assert state(bench) is LinkState.READY


def test_states_that_come_later_and_later_are_as_none_though_they_come_all_the_time() -> None:
    bench = opened()
    bench.line.to_host = Wire(220_000, Faults(), "")  # 24 bytes in 1.09 ms
    bench.run(190)
    assert state(bench) is LinkState.READY
    bench.run(60)  # 20 ms late after 220 ms
    assert "no state for" in fallen(bench)


def test_a_wire_that_stands_still_for_the_watchdogs_time_is_a_fault() -> None:
    bench = opened(faults=Faults(delay=0.02))
    bench.run(100)
    fallen(bench)


def test_closing_takes_the_current_away_at_once() -> None:
    bench = opened()
    bench.force_n = 3.0
    bench.run(10)
    bench.handle.close()
    now_s = bench.clock.now_ns() * 1e-9 + bench.line.ahead_s
    bench.line.live(now_s + 0.001)
    bench.line.live(now_s + 0.002)
    assert bench.device.current_a == 0.0
    assert Flag.WATCHDOG not in bench.device._flags


def test_a_port_that_is_not_there_is_the_reason() -> None:
    bench = Bench()
    bench.line.plugged = False
    bench.handle.open()
    assert bench.handle.link.inhibited == "memory: no such port"
