"""The load-cell driver against the emulated transducer, alone and beside a drive."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml

from forefeel.common.errors import ConfigurationError, DeviceError, DeviceSetupError
from forefeel.common.hardware.link import LinkState
from forefeel.devices.canopen.network import acquire, release
from forefeel.devices.cia402.driver import Cia402Stage
from forefeel.devices.cia404.driver import Cia404LoadCell
from forefeel.devices.cia404.emulator import SERIAL, Transducer404
from forefeel.slave.load_cell import LoadCellReading
from tests.devices.can_rig import (
    cell_on,
    cell_settings,
    drive_on,
    new_channel,
    running,
    stage_settings,
    virtual_bus,
)
from tests.waiting import wait_until


@contextmanager
def rig(opened: bool = True, **changed: object) -> Iterator[tuple[Transducer404, Cia404LoadCell]]:
    bus = new_channel()
    cell = cell_on(virtual_bus(bus))
    driver = Cia404LoadCell(cell_settings(bus, **changed))
    with running(cell):
        try:
            if opened:
                driver.open()
            yield cell, driver
        finally:
            driver.close()
    cell.close()


def some(driver: Cia404LoadCell, count: int = 5) -> list[LoadCellReading]:
    found: list[LoadCellReading] = []

    def enough() -> bool:
        found.extend(driver.read(time.monotonic_ns(), None))
        return len(found) >= count

    wait_until(enough)
    return found


def test_every_reading_once_with_its_stamp() -> None:
    with rig(sign=-1) as (_, driver):
        readings = some(driver, 10)
        stamps = [reading.stamp_ns for reading in readings]
        assert len(set(stamps)) == len(stamps)
        assert stamps == sorted(stamps, key=lambda stamp: stamp or 0)
        assert {(r.force_n, r.raw_counts, r.valid) for r in readings} == {(-1.25, 1_250_000, True)}
        assert f"serial {SERIAL:08X}" in driver.link.identity
        taken = driver.link.counters["tpdos"]
    assert taken - len(readings) <= 3


def test_overrange_is_not_believed_but_says_how_much() -> None:
    with rig() as (cell, driver):
        cell.provoke("overrange")
        wait_until(lambda: any(not r.valid and r.force_n == 10.0 for r in driver.read(0, None)))
        counters = driver.link.counters
        assert counters["not_valid"] == counters["overrange"] == counters["beyond_full_scale"] > 0
        cell.provoke("free")
        wait_until(lambda: any(r.valid for r in driver.read(0, None)))
        assert driver.link.inhibited is None


def test_near_full_scale_of_the_settings_is_not_believed() -> None:
    with rig(full_scale_n=1.3) as (_, driver):
        assert not any(reading.valid for reading in some(driver))


def test_silence_is_a_fault_until_rearmed() -> None:
    with rig() as (cell, driver):
        some(driver, 2)
        cell.provoke("unplug")
        wait_until(lambda: driver.link.inhibited is not None)
        with pytest.raises(DeviceError, match="no TPDO"):
            driver.read(0, None)
        assert driver.link.counters["faults"] >= 1 and driver.link.counters["silent_periods"] >= 10
        cell.provoke("plug")
        wait_until(lambda: driver.link.state is LinkState.CONFIGURED)
        with pytest.raises(DeviceError, match="no TPDO"):
            driver.read(0, None)
        driver.rearm()
        assert some(driver, 3)[0].valid


def test_a_calibration_scales_and_must_be_of_this_cell(tmp_path: Path) -> None:
    file = tmp_path / "cell.yaml"
    values = {
        "format": "forefeel.load_cell_calibration/1",
        "driver": "cia404",
        "serial": f"{SERIAL:08X}",
        "date": "2026-01-01",
        "valid_days": 3650,
        "gain_n": 2.0,
        "zero": 0.25,
        "residual_n": 0.001,
        "hysteresis_n": 0.001,
        "range_n": [-5.0, 5.0],
        "points": [[0.25, 0.0], [1.25, 2.0]],
    }
    file.write_text(yaml.safe_dump(values))
    with rig(calibration=file) as (_, driver):
        assert some(driver)[0].force_n == pytest.approx(2.0)
    file.write_text(yaml.safe_dump({**values, "serial": "1"}))
    with (
        rig(opened=False, calibration=file) as (_, driver),
        pytest.raises((ConfigurationError, DeviceError), match="serial = '1'"),
    ):
        driver.open()


def test_a_unit_that_is_no_force() -> None:
    bus = new_channel()
    cell = Transducer404(virtual_bus(bus), 6, lambda _: 0.0, unit=0xFA010100)
    with running(cell):
        for more, match in (
            ({}, r"unit FA010100 .*expected newtons"),
            ({"full_scale_native": 2000.0}, "unit FA010100 .*without calibration"),
        ):
            with pytest.raises(DeviceSetupError, match=match):
                Cia404LoadCell(cell_settings(bus, **more)).open()
    cell.close()


def test_a_unit_of_force_beside_a_full_scale_of_the_settings() -> None:
    with (
        rig(opened=False, full_scale_native=2000.0) as (_, driver),
        pytest.raises(DeviceSetupError, match=r"full_scale_native = 2000.0; expected newtons"),
    ):
        driver.open()


def test_stage_and_cell_share_one_network_and_one_sync() -> None:
    bus = new_channel()
    drive, cell = drive_on(virtual_bus(bus)), cell_on(virtual_bus(bus))
    stage, driver = Cia402Stage(stage_settings(bus)), Cia404LoadCell(cell_settings(bus))
    with running(drive, cell):
        stage.open()
        driver.open()
        shared = acquire(bus)
        assert shared.users == 3
        release(shared)
        syncs, start_s = drive._syncs, time.monotonic()
        some(driver, 20)
        rate_hz = (drive._syncs - syncs) / (time.monotonic() - start_s)
        assert rate_hz < 75  # one producer of 50 Hz, not two
        drive.provoke("drive_fault")
        wait_until(lambda: stage.link.inhibited is not None)
        some(driver, 20)  # the cell goes on without the stage's SYNC
        assert driver.link.inhibited is None
        wait_until(lambda: stage.link.state is LinkState.CONFIGURED)
        stage.rearm()
        some(driver, 20)
        assert stage.link.state is LinkState.READY
        stage.close()
        some(driver, 5)
        driver.close()
    drive.close()
    cell.close()


def test_a_bus_has_one_bitrate() -> None:
    bus = new_channel()
    shared = acquire(bus)
    try:
        with pytest.raises(DeviceSetupError, match="bitrate = 500000: expected 1000000"):
            acquire(bus.model_copy(update={"bitrate": 500_000}))
    finally:
        release(shared)
