"""The Zaber driver as it ships, in its own thread, on a pseudo terminal; homing for the calibration."""

import time
from dataclasses import replace
from pathlib import Path

import pytest

from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.hardware.link import LinkState
from forefeel.devices.zaber.driver import ZaberStage
from forefeel.devices.zaber.emulator import ZaberDevice
from forefeel.devices.zaber.homing import ZaberHoming
from tests.devices.pty_thread import PtyThread
from tests.devices.zaber_rig import MODEL, Rig, settings
from tests.waiting import wait_until


def test_it_moves_holds_and_closes_at_rest(tmp_path: Path) -> None:
    device = ZaberDevice(MODEL)
    with PtyThread(device, tmp_path) as port:
        stage = ZaberStage(settings(port=port.path))
        stage.open()
        try:
            assert stage.read(time.monotonic_ns()).position_m == pytest.approx(0.01)
            assert stage.command(0.012, 0.0, time.monotonic_ns()) == 0.012
            wait_until(lambda: stage.read(time.monotonic_ns()).position_m == pytest.approx(0.012, abs=1e-6))
            stage.command(0.09, 0.0, time.monotonic_ns())
            wait_until(lambda: stage.read(time.monotonic_ns()).velocity_m_s > 0.02)
            stage.hold(0)
            wait_until(lambda: stage.read(time.monotonic_ns()).velocity_m_s == 0.0)
            assert device.motion()[1] == 0.0
        finally:
            stage.close()
        assert stage.link.counters["faults"] == 0 and stage.link.state is LinkState.CLOSED
        stage.open()  # and again
        stage.close()


def test_unplugged_and_plugged_it_waits_to_be_re_armed(tmp_path: Path) -> None:
    device = ZaberDevice(MODEL)
    with PtyThread(device, tmp_path) as port:
        stage = ZaberStage(settings(port=port.path))
        stage.open()
        try:
            stage.command(0.05, 0.0, time.monotonic_ns())
            wait_until(lambda: device.motion()[1] > 0.02)
            port.do(port.pty.unplug)
            wait_until(lambda: stage.link.state is not LinkState.READY)
            with pytest.raises(DeviceError, match=r"gone while|no such port"):
                stage.read(time.monotonic_ns())
            port.do(port.pty.plug)
            wait_until(lambda: stage.link.state is LinkState.CONFIGURED)
            rests_m = device.motion()[0]
            assert device.motion()[1] == 0.0 and rests_m < 0.04
            moves = device.counts["moves"]
            with pytest.raises(DeviceError):
                stage.command(0.05, 0.0, time.monotonic_ns())
            stage.rearm()
            wait_until(lambda: stage.read(time.monotonic_ns()).position_m == pytest.approx(rests_m, abs=1e-6))
            assert device.counts["moves"] == moves
            stage.command(rests_m + 0.001, 0.0, time.monotonic_ns())
            wait_until(lambda: device.motion()[0] == pytest.approx(rests_m + 0.001, abs=1e-6))
        finally:
            stage.close()


def test_no_port_and_a_busy_port(tmp_path: Path) -> None:
    stage = ZaberStage(settings(port=str(tmp_path / "none")))
    with pytest.raises(DeviceSetupError, match="no such port; expected one that `forefeel devices` lists"):
        stage.open()
    with PtyThread(ZaberDevice(MODEL), tmp_path) as port:
        first, second = ZaberStage(settings(port=port.path)), ZaberStage(settings(port=port.path))
        first.open()
        try:
            with pytest.raises(DeviceSetupError, match="busy, another process holds it"):
                second.open()
        finally:
            first.close()
        second.open()  # the first failure is not held against it
        second.close()


def homing(rig: Rig) -> ZaberHoming:
    return ZaberHoming(rig.settings, rig.clock, rig.open_stream)


def test_homing_and_travel_of_a_stage_that_does_not_know_where_it_is() -> None:
    rig = Rig(replace(MODEL, homed=False, start_m=0.03), sign=-1)
    with homing(rig) as found:
        assert found.link.serial == "73451" and found.native_per_m == 1e7
        assert found.home() == (0.0, None) and rig.x_m == pytest.approx(0.0, abs=1e-9)
        began_s = rig.t_s
        assert found.travel_ends(0.05) == (-50_000.0, 1_000_000.0)
        assert rig.t_s - began_s > (0.1 + 0.105) / 0.05
    assert rig.opened == 0 and rig.at_rest()


def test_a_homing_that_takes_too_long_or_is_blocked_or_interrupted_ends_with_a_stop() -> None:
    rig = Rig(replace(MODEL, homed=False, start_m=0.09))
    with homing(rig) as found:
        with pytest.raises(DeviceError, match="'home' takes too long; the stage has been stopped"):
            found.home(timeout_s=0.3)
        rig.rest(0.1)
        assert rig.at_rest()
        rig.device.provoke("stuck")
        with pytest.raises(DeviceError, match=r"FS \(stalled and stopped\) during 'home'"):
            found.home()
    rig.device.provoke("free")
    with pytest.raises(KeyboardInterrupt), homing(rig) as found:
        rig.device.receive(b"/1 1 move vel 100000\n", rig.t_s)
        rig.rest(0.1)
        assert not rig.at_rest()
        raise KeyboardInterrupt
    rig.rest(0.2)
    assert rig.at_rest() and rig.opened == 0
