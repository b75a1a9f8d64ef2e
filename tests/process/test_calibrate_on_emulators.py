"""`forefeel calibrate` on emulated devices: the file says what they were made with, the driver uses it."""

import sys
import time
from collections.abc import Callable, Sequence
from datetime import date
from pathlib import Path
from typing import Any

import pytest
import yaml

from forefeel.common.clock import MonotonicClock
from forefeel.common.hardware.calibration import (
    CellScale,
    StageCalibration,
    load_cell_calibration,
    stage_calibration,
)
from forefeel.daemon_settings import load_daemon
from forefeel.devices.ascii_line.emulator import EmulatedHx711
from forefeel.devices.canopen.settings import CanSettings
from forefeel.devices.cia402.emulator import SERIAL as DRIVE_SERIAL
from forefeel.devices.cia402.emulator import Drive402
from forefeel.devices.cia402.protocol import DriveState
from forefeel.devices.cia404.emulator import SERIAL as CELL_SERIAL
from forefeel.devices.emulation.bench import Load
from forefeel.devices.emulation.sensing import Sensing
from forefeel.devices.zaber.emulator import ZaberDevice, ZaberModel
from forefeel.probe.configured import configured
from forefeel.slave.load_cell import LoadCell, LoadCellReading
from tests.devices.calibrate_bench import CELL, STAGE
from tests.devices.can_rig import (
    COUNTS_PER_M,
    cell_on,
    drive_on,
    new_channel,
    running,
    virtual_bus,
)
from tests.devices.pty_thread import PtyThread
from tests.waiting import wait_until

pytestmark = pytest.mark.usefixtures("ahead_of_other_work")
Run = Callable[[Sequence[str]], int]
QUICK = ["--forces", "4", "--settle", "0.1"]
WALK = [0.0, 4.0, 0.0]


@pytest.fixture(autouse=True)
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


class Person:
    """stdin: at each line the next thing is done."""

    def __init__(self, *deeds: Callable[[], object]) -> None:
        self._deeds = list(deeds)

    def readline(self) -> str:
        self._deeds.pop(0)()
        return "\n"


def hangs(load: Load, force_n: float) -> Callable[[], None]:
    return lambda: setattr(load, "force_n", force_n)


def the_stage(driver: str, serial: str, native_per_m: float) -> StageCalibration:
    """What `forefeel calibrate stage` has left."""
    return stage_calibration(Path("stage.yaml"), driver, serial, date.today(), (0.0, 0.01), native_per_m)


def write(slot: str, section: dict[str, object]) -> None:
    axis = {slot: section, "limits": {"workspace_m": [0.001, 0.009]}}
    Path("slave.yaml").write_text(yaml.safe_dump({"role": "slave", "axes": [axis]}))


def made(slot: str, **changed: object) -> Any:  # noqa: ANN401 - the port of its slot
    """The driver that the slave would make of the file, changed like that."""
    text = yaml.safe_load(Path("slave.yaml").read_text())
    text["axes"][0][slot].update(changed)
    Path("slave.yaml").write_text(yaml.safe_dump(text))
    (found,) = [each for each in configured(load_daemon(Path("slave.yaml"))) if each.driver.slot == slot]
    return found.driver.make(found.settings, MonotonicClock())


def force_of(cell: LoadCell) -> float:
    """The mean of the next few readings, all of them valid."""
    found: list[LoadCellReading] = []

    def enough() -> bool:
        found.extend(cell.read(time.monotonic_ns(), None))
        return len(found) >= 8

    cell.open()
    try:
        wait_until(enough)
    finally:
        cell.close()
    assert all(reading.valid for reading in found)
    return sum(reading.force_n for reading in found) / len(found)


# --- load cells ---


def hx711(load: Load) -> EmulatedHx711:
    return EmulatedHx711(lambda _: -load.force_n, Sensing(80.0), counts_per_n=150_000.0, zero_counts=33_000)


def counts_of(port: str) -> dict[str, object]:
    section = {"driver": "ascii_line", "port": port, "baud": 115_200, "unit": "counts"}
    return {**section, "full_scale_n": 10.0, "full_scale_native": 1_500_000, "sign": -1, "serial": "SG-5"}


@pytest.mark.soak
def test_an_hx711(run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load = Load()
    with PtyThread(hx711(load), folder) as port:
        write("load_cell", counts_of(port.path))
        monkeypatch.setattr(sys, "stdin", Person(*(hangs(load, force_n) for force_n in WALK)))
        assert run([*CELL, *QUICK]) == 0
        found = load_cell_calibration(
            Path("cell.yaml"), "ascii_line", "SG-5", date.today(), CellScale(10 / 1_500_000, 10.0)
        )
        assert found.gain_n == pytest.approx(1 / 150_000, rel=1e-3)
        assert found.zero == pytest.approx(33_000, abs=300)  # 2 mN
        load.force_n = 2.5
        assert force_of(made("load_cell", calibration="cell.yaml")) == pytest.approx(2.5, abs=0.01)


@pytest.mark.soak
def test_a_cia404_transducer(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    bus, load = new_channel(), Load()
    cell = cell_on(virtual_bus(bus), lambda _: 0.4 + 1.25 * load.force_n)
    with running(cell):
        write("load_cell", node(bus, "cia404", 6, full_scale_n=10.0, rate_hz=50))
        monkeypatch.setattr(sys, "stdin", Person(*(hangs(load, force_n) for force_n in WALK)))
        assert run([*CELL, *QUICK]) == 0
        about = "cia404", f"{CELL_SERIAL:08X}", date.today(), CellScale(1.0, 10.0)
        found = load_cell_calibration(Path("cell.yaml"), *about)
        assert (found.gain_n, found.zero) == pytest.approx((0.8, 0.4), rel=1e-6)
        load.force_n = 2.5
        assert force_of(made("load_cell", calibration="cell.yaml")) == pytest.approx(2.5, abs=1e-6)
    cell.close()


@pytest.mark.soak
def test_a_cell_that_is_unplugged_meanwhile_leaves_nothing_behind(
    run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    load = Load()
    with PtyThread(hx711(load), folder) as port:
        write("load_cell", counts_of(port.path))
        monkeypatch.setattr(sys, "stdin", Person(lambda: None, lambda: port.do(port.pty.unplug)))
        assert run([*CELL, *QUICK]) == 1
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith(f"forefeel: load cell ascii_line on {port.path}: ")
    assert not Path("cell.yaml").exists()


def test_a_cell_without_any_serial_number_says_what_to_write(
    run: Run, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with PtyThread(hx711(Load()), folder) as port:
        section = counts_of(port.path)
        del section["serial"]
        write("load_cell", section)
        assert run([*CELL, *QUICK, "--yes"]) == 2
    assert capsys.readouterr().err.endswith("write load_cell.serial, the number on its label\n")


# --- stages ---


def node(bus: CanSettings, kind: str, number: int, **more: object) -> dict[str, object]:
    can = {"interface": "virtual", "channel": bus.channel}
    return {"driver": kind, "can": can, "node_id": number, **more}


def drive_section(bus: CanSettings, method: int = 17, **more: object) -> dict[str, object]:
    """Slow cycles, for a busy machine; the switch is 1 mm before the travel."""
    homing = {"method": method, "home_m": -0.001, "search_velocity_m_s": 0.05}
    homing.update(zero_velocity_m_s=0.004, acceleration_m_s2=5.0)
    scale = {"counts_per_m": COUNTS_PER_M, "travel_m": [0.0, 0.01]}
    return node(bus, "cia402", 5, **scale, sync_hz=50, heartbeat_s=0.05, homing={**homing, **more})


def moved_drive(bus: CanSettings) -> Drive402:
    """Its count begins anywhere, and again at 12,345 when it is homed; switches 11.5 mm apart."""
    drive = drive_on(virtual_bus(bus), start_m=0.03)
    drive.model.homing.switches_m, drive.model.origin_m = (0.026, 0.0375), 0.0123
    drive._node.set_data(0x607C, 0, (12_345).to_bytes(4, "little"))
    return drive


@pytest.mark.soak
def test_a_cia402_drive(run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    sign, method, zero_m = -1, 18, 0.0365
    bus = new_channel()
    drive = moved_drive(bus)
    with running(drive):
        write("stage", {**drive_section(bus, method), "sign": sign})
        assert run([*STAGE, "--yes", "--velocity", "0.05"]) == 0
        found = the_stage("cia402", f"{DRIVE_SERIAL:08X}", COUNTS_PER_M)
        assert found.zero == pytest.approx(12_345 + sign * 1000)
        assert found.native_per_m == COUNTS_PER_M
        assert found.travel_m == pytest.approx((0.0, 0.01), abs=41e-6)
        assert found.travel_m[0] <= 0.0 and found.travel_m[1] >= 0.01
        assert found.repeatability_m is None
        assert "not told by the device" in capsys.readouterr().out
        assert drive.model.state is DriveState.QUICK_STOP
        stage = made("stage", calibration="stage.yaml")
        stage.open()
        try:
            x_m = stage.read(time.monotonic_ns()).position_m
        finally:
            stage.close()
        assert x_m == pytest.approx(sign * (drive.model.position_m - zero_m), abs=5e-6)
    drive.close()


@pytest.mark.soak
def test_a_drive_that_is_told_where_it_stands_goes_back_there_before_it_is_told_again(run: Run) -> None:
    bus = new_channel()
    drive = moved_drive(bus)
    with running(drive):
        write("stage", drive_section(bus, 37, home_m=0.004))
        assert run([*STAGE, "--yes", "--velocity", "0.05"]) == 0
        found = the_stage("cia402", f"{DRIVE_SERIAL:08X}", COUNTS_PER_M)
        assert found.zero == pytest.approx(12_345 - 4000)
        assert drive.model.position_m == pytest.approx(0.03, abs=41e-6)
    drive.close()


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("stuck", "drive "),
        ("no_switch", "the drive reports an error of homing"),
        ("unplug", "no "),
    ],
)
@pytest.mark.soak
def test_a_drive_that_fails_while_it_is_homed_is_stopped(
    run: Run, capsys: pytest.CaptureFixture[str], fault: str, message: str
) -> None:
    bus = new_channel()
    drive = moved_drive(bus)
    drive.model.homing.switches_m = (-0.0045, 0.1245)
    met: list[str] = []

    def once(t_s: float, x_m: float, v_m_s: float, a_m_s2: float) -> None:
        if v_m_s < -0.04 and not met:
            met.append(fault)
            drive.provoke(fault)

    drive.model._moved = once
    with running(drive):
        write("stage", drive_section(bus))
        assert run([*STAGE, "--yes"]) == 1
        assert met
        wait_until(lambda: drive.model.velocity_m_s == 0.0)
        assert drive.model.state is not DriveState.ENABLED
        at_m = drive.model.position_m
        time.sleep(0.1)
        assert drive.model.position_m == at_m
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith(f"forefeel: stage cia402 node 5 on virtual {bus.channel}: {message}")
    assert last.endswith("; the stage has been stopped")
    assert not Path("stage.yaml").exists()
    drive.close()


@pytest.mark.parametrize(
    ("flaw", "message"),
    [
        ("modes", "no homing (6502); home it with its maker's tool"),
        ("method", "stage.homing.method = 5 is refused (6098:00)"),
        ("fault", "the drive is in a fault; expected none: clear it at the drive"),
    ],
)
@pytest.mark.soak
def test_a_drive_that_can_not_be_homed_is_not_moved(
    run: Run, capsys: pytest.CaptureFixture[str], flaw: str, message: str
) -> None:
    bus = new_channel()
    drive = moved_drive(bus)
    if flaw == "modes":
        drive._node.set_data(0x6502, 0, (0x80).to_bytes(4, "little"))
    elif flaw == "fault":
        drive.provoke("drive_fault")
    with running(drive):
        write("stage", drive_section(bus, 5 if flaw == "method" else 17))
        assert run([*STAGE, "--yes"]) == 2
        (said,) = capsys.readouterr().err.splitlines()
        assert message in said
        assert drive.model.position_m == 0.03
    drive.close()


@pytest.mark.soak
def test_a_zaber_stage_that_has_forgotten_where_it_is(run: Run, folder: Path) -> None:
    device = ZaberDevice(ZaberModel(limits_m=(-0.001, 0.011), start_m=0.004, homed=False))
    with PtyThread(device, folder) as port:
        section = {"driver": "zaber_ascii", "port": port.path, "microstep_m": 1e-7, "travel_m": [0.0, 0.01]}
        write("stage", section)
        assert run([*STAGE, "--yes", "--velocity", "0.05"]) == 0
        found = the_stage("zaber_ascii", "73451", 1e7)
        assert (found.zero, found.native_per_m) == pytest.approx((0.0, 1e7))
        assert found.travel_m == pytest.approx((-0.001, 0.011))
        stage = made("stage", calibration="stage.yaml")
        stage.open()
        try:
            assert stage.read(time.monotonic_ns()).position_m == pytest.approx(device.motion()[0], abs=1e-7)
        finally:
            stage.close()
