"""`forefeel devices` and `forefeel device probe` as a person uses them, on fakes in stepped time."""

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.hardware.driver import (
    SLOTS,
    Driver,
    DriverSettings,
    InstalledDriver,
    imported,
    installed_drivers,
)
from forefeel.common.state.folder import StateFolder
from forefeel.configured_devices import ConfiguredDevice, configured
from forefeel.daemon_settings import load_daemon
from forefeel.devices.shared.stream import latency_warning
from forefeel.probe.ports import can_interfaces, serial_ports
from forefeel.probe.probe import filter_lag_s
from forefeel.slave.load_cell import LoadCellReading
from tests.devices.fake_devices import FakeCell, FakeHandle, FakeStage, S, SteppedClock

HOW_TO = Path(__file__).parents[2] / "docs" / "how-to" / "hardware.md"
Run = Callable[[Sequence[str]], int]
SLAVE = """role: slave
axes:
- stage: {driver: zaber_ascii, port: /dev/stage, microstep_m: 1e-6, travel_m: [-0.01, 0.2]}
  load_cell: {driver: ascii_line, port: /dev/cell, full_scale_n: 10, rate_hz: 80, pushes_only: true,
    filter_lag_s: 0.01}
  gripper: {driver: simulated}
"""
MASTER = """role: master
axes:
- handle: {driver: coil_serial, port: /dev/handle, counts_per_m: 1e6, newton_per_ampere: 5, max_current_a: 1}
"""
WRONG = DeviceSetupError("/dev/cell: no such port; expected one that `forefeel devices` lists")


class Bench:
    """The fakes that stand in for the drivers, by slot."""

    def __init__(self) -> None:
        self.clock = SteppedClock()
        self.stage, self.load_cell = FakeStage(self.clock), FakeCell(self.clock)
        self.handle = FakeHandle(self.clock)

    def make(self, driver: InstalledDriver) -> Any:  # noqa: ANN401
        return getattr(self, driver.slot)


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Bench:
    bench = Bench()
    monkeypatch.setattr(InstalledDriver, "make", lambda driver, *_: bench.make(driver))
    monkeypatch.setattr("forefeel.probe.probe.MonotonicClock", lambda: bench.clock)
    monkeypatch.chdir(tmp_path)
    Path("slave.yaml").write_text(SLAVE)
    Path("master.yaml").write_text(MASTER)
    return bench


class NetworkCell(DriverSettings):
    """A load cell behind a socket: its port is no serial one."""

    driver: Literal["network"] = "network"
    port: int = 5000


def test_a_port_that_is_a_number_is_probed_and_is_no_serial_port(
    bench: Bench, run: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    driver = InstalledDriver("load_cell", "network", "elsewhere", "1.0", Driver(NetworkCell, "a:b", "a cell"))
    device = ConfiguredDevice("insertion", NetworkCell(), driver)
    assert device.serial_port is None
    monkeypatch.setattr("forefeel.probe.probe.configured", lambda _: [device])
    assert run(["device", "probe", "--config", "slave.yaml", "--seconds", "0.5"]) == 0
    assert "insertion load_cell: network on 5000: ready; " in capsys.readouterr().out


# --- the registry ---


DRIVERS = [found for slot in SLOTS for found in installed_drivers(slot)]


@pytest.mark.parametrize("found", DRIVERS, ids=lambda found: f"{found.slot} {found.name}")
def test_every_place_that_a_driver_names_can_be_imported(found: InstalledDriver) -> None:
    driver = found.driver
    for place in (driver.make, driver.homing, driver.emulator):
        assert place is None or imported(place) is not None


@pytest.mark.parametrize("text", re.findall(r"```yaml\n(.*?)```", HOW_TO.read_text(), re.DOTALL))
def test_the_configurations_of_the_how_to_are_accepted(tmp_path: Path, text: str) -> None:
    (tmp_path / "daemon.yaml").write_text(text)
    devices = configured(load_daemon(tmp_path / "daemon.yaml"))
    assert any(device.settings.hardware and device.where for device in devices)


def test_the_how_to_shows_every_driver_with_hardware() -> None:
    text = HOW_TO.read_text()
    assert [
        each.name for each in DRIVERS if each.driver.settings.hardware and f"driver: {each.name}" not in text
    ] == []


# --- devices ---


def port(device: str, vid: int | None = None, serial: str | None = None) -> ListPortInfo:
    found = ListPortInfo(device, skip_link_detection=True)
    found.vid, found.pid, found.serial_number = vid, None if vid is None else 0x6001, serial
    return found


def test_serial_ports_have_stable_names_and_ids(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    by_id = tmp_path / "by-id"
    by_id.mkdir()
    for name in ("ttyUSB0", "ttyUSB1"):
        (tmp_path / name).touch()
    (by_id / "usb-FTDI_A50-if00-port0").symlink_to(tmp_path / "ttyUSB1")
    ports = [port(str(tmp_path / "ttyUSB1"), 0x0403, "A50"), port(str(tmp_path / "ttyUSB0"))]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    plain, ftdi = serial_ports(by_id)
    assert (plain.device, plain.stable, plain.usb, plain.advice) == (ports[1].device, None, None, None)
    assert (ftdi.stable, ftdi.usb) == (str(by_id / "usb-FTDI_A50-if00-port0"), "0403:6001")
    assert ftdi.serial == "A50"


def test_slow_latency_timer_is_said(tmp_path: Path) -> None:
    (tmp_path / "ttyUSB1").mkdir()
    for timer_ms, said in (("16\n", True), ("1\n", False), ("", False)):
        (tmp_path / "ttyUSB1" / "latency_timer").write_text(timer_ms)
        assert ("16 ms" in (latency_warning("/dev/ttyUSB1", tmp_path) or "")) is said


def test_can_interfaces_are_told_by_their_type_and_how_to_bring_one_up(tmp_path: Path) -> None:
    for name, kind, flags in (
        ("eth0", "1", "0x1003"),
        ("can1", "280", "0x40080"),
        ("can0", "280", "0x40081"),
    ):
        (tmp_path / name).mkdir()
        (tmp_path / name / "type").write_text(f"{kind}\n")
        (tmp_path / name / "flags").write_text(f"{flags}\n")
    up, down = can_interfaces(tmp_path)
    assert (up.name, up.up, up.advice) == ("can0", True, None)
    assert (down.name, down.up) == ("can1", False)
    assert down.advice is not None and "ip link set can1 up" in down.advice
    assert can_interfaces(tmp_path / "none") == []


def test_devices_are_listed_for_a_person_and_for_a_program(
    run: Run, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(list_ports, "comports", lambda: [port("/dev/ttyUSB0", 0x0403, "A50")])
    assert run(["devices"]) == 0
    shown = capsys.readouterr().out
    assert "0403:6001" in shown
    assert all(each.name in shown and each.driver.what in shown for each in DRIVERS)
    assert run(["devices", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "forefeel.devices/1"
    assert [each["driver"] for each in document["drivers"]] == [driver.name for driver in DRIVERS]
    assert document["serial_ports"][0]["serial"] == "A50"


# --- probe ---


def test_probe_says_rate_and_round_trip_and_touches_nothing(
    run: Run, bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["device", "probe", "--config", "slave.yaml", "--seconds", "4"]) == 0
    said = capsys.readouterr()
    stage, gripper, cell = said.out.splitlines()
    assert said.err == "next: forefeel doctor --config slave.yaml\n"
    for word in ("zaber_ascii on /dev/stage: ready", "Fake 2000", "250 Hz", "p50 2 ms, p99 6 ms"):
        assert word in stage
    assert "simulated" in gripper
    assert "80 of 80 Hz" in cell
    assert bench.stage.calls == bench.load_cell.calls == ["open", "close"]


def test_probe_of_a_master_reads_the_handle_and_gives_no_force(
    run: Run, bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["device", "probe", "--config", "master.yaml", "--seconds", "1", "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)["devices"]
    assert found["slot"] == "handle"
    assert found["verdict"] == "ready"
    assert found["rate_hz"] is None
    assert bench.handle.calls == ["open", "close"]


def test_devices_are_left_alone_beside_their_daemon(
    run: Run, bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("slave.yaml").write_text(f"state: {{directory: state}}\n{SLAVE}")
    calibrate = "calibrate load-cell --axis insertion --out cell.yaml --weights 1"
    with StateFolder(Path("state")):
        for line in ("device probe", calibrate):
            assert run([*line.split(), "--config", "slave.yaml"]) == 2
            assert "the slave runs" in capsys.readouterr().err
    assert bench.stage.calls == bench.load_cell.calls == []


def test_a_reading_that_is_not_valid_tells_nothing_of_the_filter(
    run: Run, bench: Bench, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def read(now_ns: int, recording_time_s: float | None) -> list[LoadCellReading]:
        """Restless by a count of a millinewton; once beyond the range."""
        found = FakeCell.read(bench.load_cell, now_ns, recording_time_s)
        return [
            LoadCellReading(10.0 if at == 5 * S else 1e-3 * (counts % 2), counts, at != 5 * S, at)
            for _, counts, _, at in found
        ]

    monkeypatch.setattr(bench.load_cell, "read", read)
    assert run(["device", "probe", "--config", "slave.yaml", "--seconds", "3", "--json"]) == 0
    *_, found = json.loads(capsys.readouterr().out)["devices"]
    assert (found["invalid"], found["filter_lag_s"]) == (1, None)


def test_a_wrong_device_is_one_line_and_exit_2_after_all_were_probed(
    run: Run, bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.load_cell.refuses = WRONG
    bench.stage.fails_at_s = 0.5
    assert run(["device", "probe", "--config", "slave.yaml", "--seconds", "1"]) == 2
    said = capsys.readouterr()
    assert said.err == f"forefeel: insertion load_cell: {WRONG}\n"
    assert "/dev/stage: failed; Fake 2000; link inhibited; 1 faults" in said.out
    assert "/dev/cell: refused" in said.out
    assert bench.stage.calls[-1] == bench.load_cell.calls[-1] == "close"


@pytest.mark.parametrize(
    ("attribute", "value"),
    [("fails_at_s", 0.5), ("rate_hz", 0.0), ("refuses", DeviceError("not ready within 4 s"))],
    ids=["fails", "silent", "does not open"],
)
def test_device_that_fails_while_probed_is_exit_1(
    run: Run, bench: Bench, capsys: pytest.CaptureFixture[str], attribute: str, value: object
) -> None:
    setattr(bench.load_cell, attribute, value)
    assert run(["device", "probe", "--config", "slave.yaml", "--seconds", "1", "--json"]) == 1
    said = capsys.readouterr()
    assert said.err.startswith("forefeel: insertion load_cell: ")
    assert [each["verdict"] for each in json.loads(said.out)["devices"]] == ["ready", "simulated", "failed"]


@pytest.mark.parametrize("line", ["none.yaml", "slave.yaml --seconds 0", "slave.yaml --seconds nan"])
def test_bad_input_of_probe_is_refused(run: Run, bench: Bench, line: str) -> None:
    assert run(["device", "probe", "--config", *line.split()]) == 2
    assert bench.stage.calls == []


@pytest.mark.parametrize("rate_hz", [80.0, 500.0])
@pytest.mark.parametrize("lag_s", [0.005, 0.04])
def test_filter_lag_is_told_by_the_steepest_answer_and_never_below_it(rate_hz: float, lag_s: float) -> None:
    """By one period more where that is all that the rate can tell."""
    random = np.random.default_rng(1)
    time_s = np.arange(0.0, 2.0, 1.0 / rate_hz)
    stamps_ns = [round(t * 1e9) for t in time_s]
    noise_n = random.normal(0.0, 0.002, len(time_s))
    pressed_n = np.minimum(time_s, 1.0) * (time_s < 1.003)
    after_s = np.maximum(0.0, time_s - 1.003)
    let_go_n = np.where(time_s < 1.003, pressed_n, np.exp(-after_s / lag_s))
    found_s = filter_lag_s(stamps_ns, (let_go_n + noise_n).tolist())
    assert found_s is not None
    assert 0.95 * lag_s < found_s < 1.2 * lag_s + 1.0 / rate_hz
    assert filter_lag_s(stamps_ns, noise_n.tolist()) is None
    assert filter_lag_s(stamps_ns, np.round(noise_n, 2).tolist()) is None
