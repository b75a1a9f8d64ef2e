"""What the configuration has wrong: `forefeel device probe` says it in one line that says what to do, exit
code 2, and nothing moves. Real commands, drivers and emulators, over pseudo terminals and a CAN bus.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import pytest
import yaml

from forefeel.devices.bota.emulator import EmulatedBota
from forefeel.devices.canopen.emulator import CanopenDevice
from forefeel.devices.cia402 import protocol as cia402
from forefeel.devices.cia404 import protocol as cia404
from forefeel.devices.emulation.device import EmulatedDevice
from forefeel.devices.emulation.sensing import Sensing
from forefeel.devices.shared.settings import SerialSettings
from forefeel.devices.shared.stream import SerialStream
from forefeel.devices.zaber.emulator import ZaberDevice
from tests.devices.can_rig import START_M, cell_on, drive_on, new_channel, running, virtual_bus
from tests.devices.pty_thread import PtyThread
from tests.devices.zaber_rig import MODEL

Run = Callable[[Sequence[str]], int]
ZABER = {"driver": "zaber_ascii", "microstep_m": MODEL.microstep_m, "travel_m": [-0.002, 0.09]}
BOTA = {"driver": "bota_serial", "full_scale_n": 10.0, "rate_hz": 100}
DRIVE = {"driver": "cia402", "node_id": 5, "counts_per_m": 1e6, "travel_m": [-0.002, 0.12], "sync_hz": 50}
CELL = {"driver": "cia404", "node_id": 6, "full_scale_n": 10.0, "rate_hz": 50}
YEARS_AGO = date.today() - timedelta(days=800)


class Probe:
    """Probes one device and gives the line that was said."""

    def __init__(self, run: Run, capsys: pytest.CaptureFixture[str], folder: Path) -> None:
        self._run, self._capsys, self.folder = run, capsys, folder

    def refused(self, slot: str, section: dict[str, Any]) -> str:
        axis = {"limits": {"workspace_m": [0.0, 0.08], "max_force_n": 3.0}, slot: section}
        file = self.folder / "slave.yaml"
        file.write_text(yaml.safe_dump({"role": "slave", "axes": [axis]}))
        assert self._run(["device", "probe", "--config", str(file), "--seconds", "0.05"]) == 2
        (line,) = self._capsys.readouterr().err.splitlines()
        assert line.startswith(f"forefeel: insertion {slot}: ")
        return line


@pytest.fixture
def probe(run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Probe:
    return Probe(run, capsys, tmp_path)


def calibration(folder: Path, slot: str, **changes: object) -> str:
    driver = {"stage": "zaber_ascii", "load_cell": "bota_serial"}[slot]
    about = {"driver": driver, "serial": "SN-1", "date": date.today(), "zero": 0.0, **changes}
    own: dict[str, object] = {"native_per_m": 1e7, "travel_m": [-0.1, 0.2], "repeatability_m": 1e-6}
    if slot == "load_cell":
        own = {"gain_n": 1.0, "residual_n": 0.0, "hysteresis_n": 0.0, "range_n": [0.0, 1.0]}
        own["points"] = [[0.0, 0.0], [1.0, 1.0]]
    file = folder / "calibration.yaml"
    file.write_text(yaml.safe_dump({"format": f"forefeel.{slot}_calibration/1", **about, **own, **changes}))
    return str(file)


@contextmanager
def stage_that_stands(folder: Path, device: ZaberDevice) -> Iterator[str]:
    """Its port; fails when it has moved at the end."""
    places_m = set[float]()
    device.moved = lambda _t_s, x_m, _v_m_s, _a_m_s2: places_m.add(x_m)
    with PtyThread(device, folder) as port:
        yield port.path
    assert places_m == {MODEL.start_m}


STAGES: list[tuple[str, dict[str, Any], dict[str, Any], str]] = [
    ("wrong port", {"port": "nothing"}, {}, "nothing: no such port; expected one that `forefeel"),
    (
        "wrong baud", {"baud": 9600}, {},
        "silence: no power, another baud rate, or another device; expected Zaber device 1 in ASCII at 9600",
    ),
    ("wrong address", {"device": 3}, {}, "silence: no power, another baud rate, or another device; expected"),
    (
        "checksum off", {}, {"has_checksums": False},
        "checksums stay off (rejected, BADCOMMAND); expected a device with comm.checksum",
    ),
    ("not homed", {}, {"homed": False}, "expected a homed stage: run `forefeel calibrate stage`"),
]  # fmt: skip


@pytest.mark.parametrize(("case", "changes", "model", "expected"), STAGES, ids=[each[0] for each in STAGES])
def test_a_serial_stage(
    probe: Probe, tmp_path: Path, case: str, changes: dict[str, Any], model: dict[str, Any], expected: str
) -> None:
    with stage_that_stands(tmp_path, ZaberDevice(replace(MODEL, **model))) as port:
        assert expected in probe.refused("stage", {**ZABER, "port": port, **changes}), case


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (
            {"serial": "4711"},
            "serial = '4711': expected '73451', the device that answers; `forefeel calibrate s",
        ),
        (
            {"serial": "73451", "date": YEARS_AGO},
            "out of date by 435 days; `forefeel calibrate stage` makes a new",
        ),
        ({"serial": "73451", "native_per_m": 1e8}, "native_per_m = 1e+08: expected 1e+07 within 1%"),
    ],
)
def test_the_calibration_of_a_serial_stage(
    probe: Probe, tmp_path: Path, changes: dict[str, Any], expected: str
) -> None:
    file = calibration(tmp_path, "stage", **changes)
    with stage_that_stands(tmp_path, ZaberDevice(MODEL)) as port:
        assert expected in probe.refused("stage", {**ZABER, "port": port, "calibration": file})


def test_a_port_that_is_held(probe: Probe, tmp_path: Path) -> None:
    with stage_that_stands(tmp_path, ZaberDevice(MODEL)) as port:
        held = SerialStream(SerialSettings(port=port))
        try:
            said = probe.refused("stage", {**ZABER, "port": port})
        finally:
            held.close()
        assert f"busy, another process holds it; expected it free: `fuser -v {port}` names who" in said


CELLS: list[tuple[str, EmulatedDevice, dict[str, Any], str]] = [
    ("wrong device", ZaberDevice(MODEL), {"baud": 115_200}, "nothing comes within 1 s; expected Bota frames"),
    (
        "wrong baud", EmulatedBota(lambda _: 0.0, Sensing(100.0)), {"baud": 230_400},
        "nothing of the expected Bota frames at 230400 baud: wrong baud or another device",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("case", "device", "changes", "expected"), CELLS, ids=[each[0] for each in CELLS])
def test_a_serial_cell(
    probe: Probe, tmp_path: Path, case: str, device: EmulatedDevice, changes: dict[str, Any], expected: str
) -> None:
    with PtyThread(device, tmp_path) as port:
        assert expected in probe.refused("load_cell", {**BOTA, "port": port.path, **changes}), case


def test_a_serial_cell_behind_the_driver_of_a_stage(probe: Probe, tmp_path: Path) -> None:
    with PtyThread(EmulatedBota(lambda _: 0.0, Sensing(100.0)), tmp_path, 460_800) as port:
        said = probe.refused("stage", {**ZABER, "port": port.path, "baud": 460_800})
    assert "bytes that are no Zaber ASCII: another device, or another baud rate; expected Zaber" in said


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (
            {},
            "serial = 'SN-1': expected 'B-7', the device that answers; `forefeel calibrate load-cell`",
        ),
        (
            {"driver": "ascii_line", "serial": "B-7"},
            "driver = 'ascii_line': expected 'bota_serial', the device that answers",
        ),
        (
            {"serial": "B-7", "date": YEARS_AGO},
            "out of date by 435 days; `forefeel calibrate load-cell` makes",
        ),
        ({"serial": "B-7", "gain_n": 0.0}, "gain_n = 0.0: input should be greater than 0"),
        ({"serial": "B-7", "gain_n": -1.0}, "gain_n = -1.0: input should be greater than 0"),
        ({"serial": "B-7", "gain_n": 1e12}, "gain_n = 1e+12: expected 0.5 to 2, within a factor of 2"),
        ({"serial": "B-7", "gain_n": 0.49}, "gain_n = 0.49: expected 0.5 to 2, within a factor of 2"),
        ({"serial": "B-7", "zero": -10.5}, "zero = -10.5: expected at most 10 native units"),
        ({"serial": "B-7", "date": date(2999, 1, 1)}, "date = 2999-01-01: expected at most today"),
        ({"serial": ""}, "serial = '': string should have at least 1 character"),
    ],
)
def test_the_calibration_of_a_serial_cell(
    probe: Probe, tmp_path: Path, changes: dict[str, Any], expected: str
) -> None:
    with PtyThread(EmulatedBota(lambda _: 0.0, Sensing(100.0)), tmp_path, 460_800) as port:
        file = calibration(tmp_path, "load_cell", **changes)
        said = probe.refused("load_cell", {**BOTA, "port": port.path, "serial": "B-7", "calibration": file})
    assert expected in said


def without(device: CanopenDevice, index: int) -> None:
    """A device that has no such object."""
    del device._node.object_dictionary[index]


NODES: list[tuple[str, str, dict[str, Any], int | None, str]] = [
    ("unknown object of a drive", "stage", DRIVE, cia402.ABORT_OPTION.index,
     "writing 6007:00 is refused (Code 0x06020000, Object does not exist); "
     "expected a device that has it: check node_id and driver"),
    ("unknown object of a cell", "load_cell", CELL, cia404.UNIT.index, "reading 6131:01 is refused (Code"),
    ("wrong node", "stage", {**DRIVE, "node_id": 9}, None,
     "no answer; expected a CiA 402 device: check node_id, bitrate and wiring"),
    ("cell behind the driver of a drive", "stage", {**DRIVE, "node_id": 6}, None,
     "a CiA 404 device, expected CiA 402"),
    ("drive behind the driver of a cell", "load_cell", {**CELL, "node_id": 5}, None,
     "a CiA 402 device, expected CiA 404"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("case", "slot", "section", "index", "expected"), NODES, ids=[each[0] for each in NODES]
)
def test_a_node(
    probe: Probe, case: str, slot: str, section: dict[str, Any], index: int | None, expected: str
) -> None:
    bus = new_channel()
    drive, cell = drive_on(virtual_bus(bus)), cell_on(virtual_bus(bus))
    if index is not None:
        without(drive if slot == "stage" else cell, index)
    with running(drive, cell):
        said = probe.refused(slot, {**section, "can": bus.model_dump()})
    assert expected in said, case
    assert drive.model.position_m == START_M
    drive.close()
    cell.close()


def test_a_bus_that_is_none(probe: Probe, tmp_path: Path) -> None:
    can = {"interface": "slcan", "channel": str(tmp_path / "none")}
    assert "none: no such port; expected one that `forefeel devices`" in probe.refused(
        "load_cell", {**CELL, "can": can}
    )
    can = {"interface": "socketcan", "channel": "none0"}
    said = probe.refused("load_cell", {**CELL, "can": can})
    assert "socketcan none0: can not be opened" in said
    assert said.endswith("expected a CAN bus that is up, see `forefeel devices`")
