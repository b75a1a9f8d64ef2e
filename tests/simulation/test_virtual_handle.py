"""The whole system in virtual time with a coil handle at the level of its bytes, and when that fails."""

import numpy as np
import pytest

from forefeel.common.clock import Clock
from forefeel.common.topics import COMMAND, FORCE, HAPTICS, MASTER_STATE, SLAVE_STATE
from forefeel.devices.coil.driver import CoilHandle
from forefeel.devices.coil.emulator import CoilDevice
from forefeel.devices.coil.settings import CoilSettings
from forefeel.devices.emulation.wire import Wire
from forefeel.devices.shared.conversation import Conversation
from forefeel.master.passivity import late_ticks
from tests.devices.coil_rig import coil_settings
from tests.simulation.pair import Pair, S

MS, TICK_S = 1_000_000, 0.001


class Line:
    """A stream whose time is the runtime's, and `ahead_s`: what passed while that stood at the handshake."""

    def __init__(self, device: CoilDevice, clock: Clock) -> None:
        self.ahead_s = 0.0
        self._device, self._clock = device, clock
        self._to_device, self._to_host = Wire(2_000_000), Wire(2_000_000)

    def read(self) -> bytes:
        t_s = self._clock.now_ns() * 1e-9 + self.ahead_s
        self._to_host.send(self._device.advance(t_s), t_s)
        arrived = self._to_device.arrived(t_s)
        if arrived:
            self._device.receive(arrived, t_s)
        return self._to_host.arrived(t_s)

    def write(self, data: bytes) -> None:
        self._to_device.send(data, self._clock.now_ns() * 1e-9 + self.ahead_s)

    def close(self) -> None:
        pass


class Rig:
    """A pair whose master's handle is emulated, in the hand of the synthetic operator."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.device = CoilDevice()

        def stepped(settings: CoilSettings, clock: Clock) -> CoilHandle:
            self.line = Line(self.device, clock)
            self.handle = CoilHandle(settings, clock)
            return self.handle

        monkeypatch.setattr("forefeel.devices.coil.driver.SerialStream", lambda *_: self.line)
        monkeypatch.setattr("forefeel.devices.coil.driver.CoilHandle", stepped)
        monkeypatch.setattr(Conversation, "_begin", lambda talks, timeout_s: self._shake_hands(talks))
        self.pair = Pair(master={"axes": [{"handle": coil_settings().model_dump()}]})
        self.currents_a = list[float]()
        self._again_ns = 0
        self.pair.runtime.loop("wire", MS, self._step)

    def _shake_hands(self, talks: Conversation) -> None:
        self._talks = talks
        self.line.read()
        while not talks.settled:
            self.line.ahead_s += 0.001
            talks.step()

    def _step(self, now_ns: int) -> None:
        if now_ns < self._again_ns:
            self.line.read()  # the device goes on, and nobody listens
        else:
            self._again_ns = now_ns + round(1e9 * (self._talks.step() or 0.0))
        self.currents_a.append(self.device.current_a)


@pytest.fixture(scope="module")
def broken() -> tuple[Rig, float]:
    """A run of a few strokes' time with an amplifier that trips amid the first."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        rig = Rig(monkeypatch)
        rig.pair.run(2.2)
        rig.device.provoke("drive_fault")
        fault_s = rig.pair.runtime.clock.now_ns() / S
        rig.pair.run(2.6)
    return rig, fault_s


def test_the_operators_hand_moves_the_stage_and_feels_it(broken: tuple[Rig, float]) -> None:
    rig, fault_s = broken
    traffic = rig.pair.traffic
    stage_m, hand_m = traffic.column(FORCE, "position_m"), traffic.column(HAPTICS, "handle_position_m")
    assert stage_m.max() > 0.015
    assert hand_m.max() == pytest.approx(stage_m.max(), abs=0.003)
    rendered_n = traffic.column(HAPTICS, "rendered_n")
    assert rendered_n.max() > 0.05
    before = traffic.column(HAPTICS, "stamp_ns") / S < fault_s
    # 2 N/A, to the milliampere, a millisecond later
    assert max(rig.currents_a) == pytest.approx(rendered_n[before].max() / 2.0, abs=0.002)
    assert rig.handle.counters["frames_lost"] == 0


def test_the_force_counts_as_late_as_the_device_says(broken: tuple[Rig, float]) -> None:
    rig, _ = broken
    said_s = rig.handle.actuator_delay_s
    assert said_s == pytest.approx(0.00232)  # a period, 16 bytes at 500 kbaud, a period
    renderer = rig.pair.master.axes[0]._loop._renderer
    assert renderer._passivity._pending == late_ticks(said_s) + 2 == 5
    assert renderer._observer._forces_n.maxlen == 4


def test_a_handle_that_fails_stops_the_stage_until_it_is_armed_anew_and_says_why(
    broken: tuple[Rig, float],
) -> None:
    rig, fault_s = broken
    traffic = rig.pair.traffic
    (release_s,) = traffic.times("release")
    assert fault_s < release_s < fault_s + 0.010 + 5 * TICK_S  # the cable's delay, the frame, two ticks
    commands = [m for m in traffic.messages(COMMAND) if m.stamp_ns / S > fault_s + 4 * TICK_S]
    engaged_s = next(time_s for time_s in traffic.times("engage") if time_s > release_s)
    assert not any(m.deadman for m in commands if m.stamp_ns / S < engaged_s - 0.010 - 2 * TICK_S)
    time_s, position_m = traffic.column(FORCE, "stamp_ns") / S, traffic.column(FORCE, "position_m")
    resting = (time_s > next(t for t in traffic.times("at_rest") if t > fault_s) + 0.1) & (time_s < engaged_s)
    assert resting.sum() > 200
    assert np.ptp(position_m[resting]) <= 1e-6
    starting = (time_s > engaged_s) & (time_s < engaged_s + 0.05)
    assert np.abs(traffic.column(FORCE, "velocity_m_s")[starting]).max() < 0.05  # no jump
    told = [m for m in traffic.messages(MASTER_STATE) if m.indication == "handle_fault"]
    assert told[0].stamp_ns / S < fault_s + 0.1 + 3 * TICK_S
    assert "overcurrent" in told[0].reason
    notices = rig.pair.master.axes[0].events.notices.drain()
    failed, rearmed = (line for line in notices if line.startswith("handle "))
    assert "overcurrent" in failed and "re-armed" in rearmed


def test_there_is_no_force_until_the_operator_has_pressed_the_deadman_anew(broken: tuple[Rig, float]) -> None:
    rig, fault_s = broken
    traffic = rig.pair.traffic
    fault = round((fault_s - 1.0) / TICK_S)
    again_s = next(time_s for time_s in traffic.times("engage") if time_s > fault_s)
    pressed = round((again_s - 1.0 - 0.010) / TICK_S)
    assert max(rig.currents_a[fault - 50 : fault]) > 0.02
    assert pressed - fault > 500
    assert set(rig.currents_a[fault + 3 : pressed - 3]) == {0.0}
    assert traffic.messages(SLAVE_STATE)[-1].state.value == "armed"
    assert max(rig.currents_a[pressed:]) > 0.02
    steps_n = 2.0 * np.abs(np.diff(rig.currents_a[pressed - 10 :]))
    assert steps_n.max() <= 80.0 * TICK_S + 0.002 + 1e-9  # the slew limit, to the milliampere
