"""CiA 404: units, flaws, and the load-cell driver against the emulated transducer, in stepped time."""

import math
from itertools import pairwise
from math import nan
from pathlib import Path
from typing import Any

import can
import pytest
import yaml

from forefeel.common.clock import VirtualClock
from forefeel.common.errors import ConfigurationError, DeviceError, DeviceSetupError
from forefeel.common.hardware.link import LinkState
from forefeel.devices.canopen.cia301 import EMERGENCY, emergency_frame
from forefeel.devices.canopen.network import acquire, release
from forefeel.devices.cia404 import protocol as cia404
from forefeel.devices.cia404.driver import Cia404LoadCell
from forefeel.devices.cia404.emulator import SERIAL
from forefeel.devices.shared.force_scale import ForceScale, StuckWatch
from tests.devices.can_rig import CELL, cell_settings, new_channel, rigged
from tests.devices.test_cia402_stage import without

STRAIN = 0xFA010100  # micrometres per metre


def test_unit_has_the_published_bytes() -> None:
    """Of a Baumer DST strain sensor, from its CANopen manual."""
    assert cia404.UNIT.pack(STRAIN) == bytes.fromhex("00 01 01 FA")


@pytest.mark.parametrize(
    ("code", "newton"),
    [(0x00210000, 1.0), (0x03210000, 1e3), (0xFD210000, 1e-3), (0x00220000, None), (0xFA010100, None)],
)
def test_units_of_force(code: int, newton: float | None) -> None:
    assert cia404.newton_per_unit(code) == (None if newton is None else pytest.approx(newton))


def test_what_can_not_be_a_reading() -> None:
    pdo = cia404.reading_pdo(CELL)
    assert cia404.measured(pdo, bytes(4)) is None
    for status in range(1, 256):
        assert cia404.Measured(1.0, status).flaws
    assert not cia404.Measured(1.0, 0).flaws
    assert cia404.Measured(1.0, 3).flaws == ("not_valid", "overrange")
    assert cia404.Measured(-1.0, 5).flaws == ("not_valid", "underrange")
    assert cia404.Measured(1.0, 0x48).flaws == ("unknown_status",)
    nan = cia404.measured(pdo, cia404.PROCESS_VALUE.pack(math.nan) + b"\0")
    assert nan is not None
    assert nan.flaws == ("not_a_number",)


def test_every_reading_comes_once_with_its_stamp() -> None:
    with rigged("cell", cell={"sign": -1}) as rig:
        rig.readings(0.0)
        readings = rig.readings(0.4)
        stamps_ns = [reading.stamp_ns or 0 for reading in readings]
        assert len(stamps_ns) == 20 and [b - a for a, b in pairwise(stamps_ns)] == [20_000_000] * 19
        assert {(r.force_n, r.raw_counts, r.valid) for r in readings} == {(-1.25, 1_250_000, True)}
        assert f"serial {SERIAL:08X}" in rig.cell.link.identity


def test_calibration_scales_and_must_be_of_this_cell(tmp_path: Path) -> None:
    file = tmp_path / "cell.yaml"
    values = {
        "format": "forefeel.load_cell_calibration/1",
        "driver": "cia404",
        "serial": "1",
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
    with rigged(cell={"calibration": file}) as rig:
        with pytest.raises((ConfigurationError, DeviceError), match="serial = '1'"):
            rig.cell.open()
        file.write_text(yaml.safe_dump({**values, "serial": f"{SERIAL:08X}"}))
        rig.cell.open()
        assert rig.readings(0.1)[0].force_n == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("changed", "unit", "missing", "says"),
    [
        ({}, STRAIN, 0, r"unit FA010100 .*expected newtons"),
        ({"node_id": 5}, None, 0, "a CiA 402 device, expected CiA 404"),
        ({}, None, cia404.UNIT.index, r"reading 6131:01 is refused \(Code"),
    ],
)
def test_cell_that_is_not_of_the_settings_is_refused(
    changed: dict[str, Any], unit: int | None, missing: int, says: str
) -> None:
    with rigged(cell=changed, unit=unit) as rig:
        without(rig, missing)
        with pytest.raises(DeviceSetupError, match=says):
            rig.cell.open()


def test_stage_and_cell_share_one_network_and_one_sync() -> None:
    with rigged("stage", "cell") as rig:
        shared = acquire(rig.bus)
        assert shared.users == 3
        release(shared)
        syncs = rig.drive._syncs
        rig.readings(1.0)
        assert rig.drive._syncs - syncs == pytest.approx(50, abs=1)  # one producer of 50 Hz, not two
        rig.drive.provoke("drive_fault")
        rig.fault_of(rig.stage)
        rig.readings(0.1)
        assert len(rig.readings(0.4)) >= 15 and rig.cell.link.inhibited is None  # without the stage's SYNC
        rig.until(rig.stage, LinkState.CONFIGURED)
        rig.stage.rearm()
        assert rig.readings(0.4) and rig.stage.link.state is LinkState.READY
        rig.stage.close()
        assert rig.readings(0.2)


def test_an_emergency_that_is_over_at_once_is_a_fault() -> None:
    with rigged("cell") as rig:
        for code in 0x8130, 0:
            rig.transducer._bus.send(
                can.Message(arbitration_id=EMERGENCY + CELL, data=emergency_frame(code), is_extended_id=False)
            )
        assert rig.fault_of(rig.cell).endswith("emergency 8130")


def test_readings_from_before_a_close_are_dropped() -> None:
    with rigged("cell") as rig:
        rig.time.run(0.4)
        rig.cell.close()
        since_ns = rig.time.now_ns()
        rig.cell.open()
        assert all((reading.stamp_ns or 0) >= since_ns for reading in rig.readings(0.1))


def test_readings_that_waited_while_the_stage_had_a_fault_are_dropped() -> None:
    with rigged("cell") as rig:
        rig.time.run(0.4)
        rig.cell.rearm()
        assert rig.cell.read(rig.time.now_ns(), None) == []
        assert rig.readings(0.1) and rig.cell.link.counters["discarded"] >= 20


def test_bus_has_one_bitrate() -> None:
    with rigged("cell") as rig, pytest.raises(DeviceSetupError, match="bitrate = 500000: expected 1000000"):
        acquire(rig.bus.model_copy(update={"bitrate": 500_000}))


# --- what the cell says of itself ---


def believed(driver: Cia404LoadCell, values: list[float], statuses: list[int]) -> list[bool]:
    """Readings in newtons, past the bus."""
    driver.link.begin()
    for state in (LinkState.OPEN, LinkState.IDENTIFIED, LinkState.CONFIGURED, LinkState.READY):
        driver.link.advance(state)
    driver._force = ForceScale(10.0, 1, 1.0, None, StuckWatch(noisy=False), driver.link.counters)
    found = []
    for n, pair in enumerate(zip(values, statuses, strict=True)):
        driver._clock = VirtualClock(n * 4_000_000)
        driver._on_reading(0, bytearray(driver._pdo.pack(*pair)), 0.0)
        found += [reading.valid for reading in driver.read(0, None)]
    return found


def test_each_flaw_of_a_reading_is_counted() -> None:
    driver = Cia404LoadCell(cell_settings(new_channel()))
    statuses = [0, 3, 5, 1, 0x80, 0, 0]
    assert believed(driver, [1.0, 10.0, -10.0, 1.1, 1.2, nan, 9.9], statuses) == [True, *[False] * 6]
    assert {name: count for name, count in driver.link.counters.items() if count} == {
        "not_valid": 3, "overrange": 1, "underrange": 1, "unknown_status": 1, "not_a_number": 1,
        "beyond_full_scale": 3, "readings": 7, "tpdos": 7,
    }  # fmt: skip
