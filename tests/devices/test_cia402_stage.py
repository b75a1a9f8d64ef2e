"""The stage driver against the emulated drive on a bus of this process."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml

from forefeel.common.errors import DeviceError, DeviceSetupError, InputError
from forefeel.common.hardware.link import LinkState
from forefeel.devices.canopen import cia301
from forefeel.devices.cia402 import protocol as cia402
from forefeel.devices.cia402.driver import Cia402Stage
from forefeel.devices.cia402.emulator import SERIAL, Drive402
from forefeel.devices.cia402.protocol import DriveState
from tests.devices.can_rig import (
    COUNTS_PER_M,
    DRIVE,
    START_M,
    cell_on,
    drive_on,
    new_channel,
    running,
    stage_settings,
    virtual_bus,
)
from tests.waiting import wait_until


class Rig:
    """A drive that lives, and every controlword that it was given."""

    def __init__(self, drive: Drive402, stage: Cia402Stage) -> None:
        self.drive, self.stage = drive, stage
        self.words: list[int] = []
        control = drive.model.control

        def noted(word: int) -> None:
            self.words.append(word)
            control(word)

        drive.model.control = noted  # type: ignore[method-assign]

    def go(self, to_m: float, seconds: float) -> None:
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            self.stage.command(to_m, 0.0, time.monotonic_ns())
            time.sleep(0.002)

    @property
    def position_m(self) -> float:
        return self.drive.model.position_m

    def faulted(self, by: str) -> str:
        self.drive.provoke(by)
        wait_until(lambda: self.stage.link.inhibited is not None)
        return str(self.stage.link.inhibited)


@contextmanager
def rig(start_m: float = START_M, opened: bool = True, **changed: object) -> Iterator[Rig]:
    bus = new_channel()
    drive = drive_on(virtual_bus(bus), start_m)
    found = Rig(drive, Cia402Stage(stage_settings(bus, **changed)))
    try:
        with running(drive):
            try:
                if opened:
                    found.stage.open()
                yield found
            finally:
                found.stage.close()
    finally:
        drive.close()


def test_the_handshake_writes_what_safety_depends_on() -> None:
    with rig() as r:
        value = r.drive.value
        assert r.stage.link.state is LinkState.READY
        assert f"serial {SERIAL:08X}" in r.stage.link.identity
        assert value(cia402.ABORT_OPTION) == cia402.ABORT_QUICK_STOP
        assert value(cia402.QUICK_STOP_OPTION) == cia402.STAY_IN_QUICK_STOP
        assert value(cia301.HEARTBEAT_CONSUMER) == 127 << 16 | 150
        assert (value(cia402.SOFT_LIMIT_LOW), value(cia402.SOFT_LIMIT_HIGH)) == (-2000, 120_000)
        assert (value(cia402.PERIOD_VALUE), value(cia402.PERIOD_EXPONENT)) == (20, -3)
        assert r.drive.model.state is DriveState.ENABLED
        assert cia402.FAULT_RESET not in r.words
        assert r.position_m == pytest.approx(START_M, abs=2e-6)


def test_it_follows_within_travel_and_velocity_and_stops_at_the_end() -> None:
    with rig(max_velocity_m_s=0.1) as r:
        began_s = time.monotonic()
        assert r.stage.command(0.2, 0.0, time.monotonic_ns()) == 0.12
        r.go(0.03, 0.4)
        elapsed_s = time.monotonic() - began_s
        assert 0.011 < r.position_m <= START_M + 0.11 * elapsed_s
        now_ns = time.monotonic_ns()
        reading = r.stage.read(now_ns)
        assert reading.position_m == pytest.approx(r.position_m, abs=0.004)
        r.stage.hold(now_ns)
        wait_until(lambda: abs(r.drive.model.velocity_m_s) < 1e-5)
        r.stage.close()
        wait_until(lambda: r.drive.model.state is DriveState.QUICK_STOP)


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        ("drive_fault", "emergency 2310|'fault"),
        pytest.param("stuck", "following error|emergency 8611", marks=pytest.mark.soak),
    ],
)
def test_no_motion_after_a_fault_until_rearmed(fault: str, says: str) -> None:
    with rig() as r:
        r.go(0.02, 0.1)
        r.drive.provoke(fault)
        with pytest.raises(DeviceError, match=says):
            r.go(0.12, 2.0)
        wait_until(lambda: r.stage.link.state is LinkState.CONFIGURED)
        r.drive.provoke("free")
        assert r.stage.link.counters["faults"] >= 1
        assert fault != "drive_fault" or r.stage.link.counters["emergencies"] >= 1
        there_m = r.position_m
        words = len(r.words)
        for call in (lambda: r.stage.command(0.1, 0.0, 0), lambda: r.stage.read(0), lambda: r.stage.hold(0)):
            with pytest.raises(DeviceError, match=says):
                call()
        time.sleep(0.2)
        assert set(r.words[words:]) == {cia402.QUICK_STOP}
        assert r.position_m == there_m
        r.stage.rearm()
        wait_until(lambda: r.drive.model.state is DriveState.ENABLED)
        time.sleep(0.1)
        assert r.position_m == pytest.approx(there_m, abs=1e-5)
        r.go(there_m + 0.002, 0.3)
        assert r.position_m == pytest.approx(there_m + 0.002, abs=5e-4)


def test_a_cut_bus_stops_the_drive_by_itself_and_the_host_notices() -> None:
    with rig() as r:
        r.go(0.03, 0.1)
        assert "no TPDO" in r.faulted("unplug")
        with pytest.raises(DeviceError, match=r"link is closed|no TPDO"):
            r.stage.rearm()
        wait_until(lambda: r.drive.model.state is DriveState.QUICK_STOP)
        wait_until(lambda: r.drive.model.velocity_m_s == 0.0)
        r.drive.provoke("plug")
        wait_until(lambda: r.stage.link.state is LinkState.CONFIGURED)
        r.stage.rearm()
        wait_until(lambda: r.drive.model.state is DriveState.ENABLED)
        assert cia402.FAULT_RESET not in r.words


def test_a_drive_that_stays_faulty_is_a_new_fault() -> None:
    with rig() as r:
        r.faulted("drive_fault")
        wait_until(lambda: r.stage.link.state is LinkState.CONFIGURED)
        r.drive.model.fail(0x5400, broken=True)
        r.stage.rearm()
        wait_until(lambda: r.stage.link.inhibited is not None)
        assert "stays in 'fault'" in str(r.stage.link.inhibited)


def test_a_drive_in_a_fault_is_refused_at_the_start() -> None:
    with rig(opened=False) as r:
        r.drive.model.fail(0x2310)
        with pytest.raises(DeviceError, match="in a fault; expected none at the start"):
            r.stage.open()
        assert cia402.FAULT_RESET not in r.words


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"node_id": 9}, "node 9 on virtual .*: no answer; expected a CiA 402 device"),
        ({"node_id": 127}, "127 is our own heartbeat"),
        ({"sync_hz": 300}, "tenths of a millisecond"),
        ({"heartbeat_s": 0.01}, "at least 1 / sync_hz"),
        ({"travel_m": (0.05, 0.1)}, "it is at 0.01 m, expected within travel_m"),
        ({"counts_per_m": 1e12, "travel_m": (0.0, 0.1)}, "does not fit"),
    ],
)
def test_what_is_not_the_drive_of_the_settings_is_one_line(changed: dict[str, Any], says: str) -> None:
    with rig(opened=False, **changed) as r:
        with pytest.raises(DeviceSetupError, match=says) as caught:
            r.stage.open()
        assert "\n" not in str(caught.value)
        assert r.position_m == START_M
        assert cia402.ENABLE not in r.words


def test_another_device_behind_the_node() -> None:
    bus = new_channel()
    cell = cell_on(virtual_bus(bus))
    stage = Cia402Stage(stage_settings(bus, node_id=6))
    with running(cell), pytest.raises(DeviceSetupError, match="a CiA 404 device, expected CiA 402"):
        stage.open()
    cell.close()


def test_a_calibration_of_another_serial_number(tmp_path: Path) -> None:
    file = tmp_path / "stage.yaml"
    values = {
        "format": "forefeel.stage_calibration/1",
        "driver": "cia402",
        "serial": f"{SERIAL:08X}",
        "date": "2026-01-01",
        "valid_days": 3650,
        "zero": 5000.0,
        "native_per_m": COUNTS_PER_M,
        "travel_m": [-0.002, 0.12],
        "repeatability_m": 1e-5,
    }
    file.write_text(yaml.safe_dump({**values, "serial": "00000001"}))
    with rig(opened=False, calibration=file) as r, pytest.raises(InputError, match="serial = '00000001'"):
        r.stage.open()
    file.write_text(yaml.safe_dump(values))
    with rig(calibration=file) as r:
        assert r.stage.read(time.monotonic_ns()).position_m == pytest.approx(START_M - 0.005, abs=1e-5)


def test_two_drivers_of_one_node_are_refused() -> None:
    with rig() as r:
        second = Cia402Stage(r.stage._settings)
        with pytest.raises(DeviceSetupError, match=f"node {DRIVE} .*one driver for each node"):
            second.open()
        assert r.stage.link.state is LinkState.READY
