"""Every fault of the wire leaves its count at the driver, beside what the tests of each driver show."""

import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from math import nan
from pathlib import Path
from random import Random

import pytest

from forefeel.common.errors import DeviceError
from forefeel.common.hardware.calibration import CellScale
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.devices.ascii_line.emulator import EmulatedHx711, EmulatedLoadstar
from forefeel.devices.bota.protocol import BAUD
from forefeel.devices.canopen.bus import open_bus
from forefeel.devices.canopen.hub import CanHub
from forefeel.devices.canopen.settings import CanSettings
from forefeel.devices.cia402.driver import Cia402Stage
from forefeel.devices.cia404 import protocol as cia404
from forefeel.devices.cia404.driver import Cia404LoadCell
from forefeel.devices.emulation.sensing import Sensing
from forefeel.devices.emulation.wire import Faults
from forefeel.devices.shared.conversation import Timed
from tests.devices import test_ascii_line_driver as lines
from tests.devices import test_bota_serial as bota
from tests.devices.can_rig import (
    cell_on,
    cell_settings,
    drive_on,
    new_channel,
    running,
    stage_settings,
)
from tests.devices.cell_bench import Port
from tests.waiting import wait_until

# --- CAN, through a serial adapter ---


@contextmanager
def on_adapter(folder: Path) -> Iterator[tuple[CanHub, list[DeviceLink]]]:
    """A drive and a cell, their drivers at the first adapter of a hub; both are ready."""
    ends = [folder / name for name in ("host", "drive", "cell")]
    buses = [CanSettings(interface="slcan", channel=str(end)) for end in ends]
    hub = CanHub(ends)
    with running(hub):
        drive, transducer = drive_on(open_bus(buses[1])), cell_on(open_bus(buses[2]))
        stage, cell = Cia402Stage(stage_settings(buses[0])), Cia404LoadCell(cell_settings(buses[0]))
        with running(drive, transducer):
            stage.open()
            cell.open()
            try:
                yield hub, [stage.link, cell.link]
            finally:
                stage.close()
                cell.close()
        drive.close()
        transducer.close()
    hub.close()


def befall(hub: CanHub, faults: Faults) -> None:
    """Faults of the lines to and from the host, from now on."""
    for wire in (hub._ports[0].to_host, hub._ports[0].to_adapter):
        wire._faults = faults
        wire.counts.clear()


def grown(links: list[DeviceLink], before: list[Counter[str]], name: str) -> bool:
    """Whether each has counted one more."""
    return all(link.counters[name] > old[name] for link, old in zip(links, before, strict=True))


def test_lines_that_are_dropped_or_damaged_are_counted_by_both_drivers_of_a_bus(tmp_path: Path) -> None:
    with on_adapter(tmp_path) as (hub, links):
        befall(hub, Faults(split=0.5))
        wait_until(lambda: hub._ports[0].to_host.counts["split"] > 20)
        assert not any(link.counters["bus_damaged"] for link in links), "lines in parts are whole"
        # a busy machine may be silent for longer than a driver takes for granted; then it has counted that
        assert all(link.state is LinkState.READY or link.counters["silent_periods"] for link in links)
        before = [link.counters.copy() for link in links]
        befall(hub, Faults(drop=0.15))
        wait_until(lambda: hub._ports[0].to_host.counts["dropped"] > 5)
        wait_until(lambda: grown(links, before, "silent_periods"), 20.0)
        befall(hub, Faults(corrupt=0.15))
        wait_until(lambda: grown(links, before, "bus_damaged"), 20.0)  # a handshake may be under way
        befall(hub, Faults())
        for link in links:  # a digit that is another may be a fault: then it is said, and it waits
            assert link.state is LinkState.READY or (link.inhibited and link.counters["faults"])


# --- a cell on CAN: what it says of itself ---


def believed(driver: Cia404LoadCell, values: list[float], statuses: list[int]) -> list[bool]:
    """Readings 4 ms apart in newtons, past the bus."""
    driver.scale = CellScale(1.0, 10.0)
    pairs = zip(values, statuses, strict=True)
    timed = [Timed(n * 4_000_000, None, cia404.Measured(*pair)) for n, pair in enumerate(pairs)]
    return [driver._reading(each).valid for each in timed]


def test_a_cell_on_can_that_repeats_itself_is_not_believed() -> None:
    driver, random = Cia404LoadCell(cell_settings(new_channel())), Random(4)
    noise = [random.gauss(1.0, 0.002) for _ in range(250)]
    valid = believed(driver, noise + [1.0] * 500, [0] * 750)
    assert valid.index(False) == 250 + 250  # after a second
    assert not any(valid[500:])
    assert driver.link.counters["stuck"] == 250


def test_each_flaw_that_a_cell_on_can_tells_is_counted() -> None:
    driver = Cia404LoadCell(cell_settings(new_channel()))
    statuses = [0, 3, 5, 1, 0x80, 0, 0]
    assert believed(driver, [1.0, 10.0, -10.0, 1.1, 1.2, nan, 9.9], statuses) == [True, *[False] * 6]
    assert {name: count for name, count in driver.link.counters.items() if count} == {
        "not_valid": 3, "overrange": 1, "underrange": 1, "unknown_status": 1, "not_a_number": 1,
        "beyond_full_scale": 3,
    }  # fmt: skip


# --- serial cells ---


def test_a_dropped_frame_is_missing_and_a_late_one_is_not() -> None:
    for faults in (Faults(drop=0.01), Faults(delay=0.002)):
        port = Port(bota.device(noise_n=0.002), BAUD, faults, until_s=2.001)
        with bota.opened(port) as driver:
            counters, wire = driver.link.counters, port.to_host.counts
            missing, befallen = counters["missing"], wire.copy()
            driver.read(0, None)
            got = [reading for _ in range(3) for reading in bota.played(driver, port, 1.0)]
            port.play(0.1)
            assert wire["dropped" if faults.drop else "delayed"] > befallen["dropped"] + 2
            assert counters["missing"] - missing == wire["dropped"] - befallen["dropped"]
            assert counters["junk_bytes"] == counters["bad_checksum"] == counters["faults"] == 0
            assert all(reading.valid for reading in got)
            assert driver.link.state is LinkState.READY


def test_lines_that_are_late_or_in_parts_are_whole() -> None:
    port = Port(EmulatedHx711(bota.slope, Sensing(80.0)), 115_200, Faults(split=0.5, delay=0.05), until_s=4.0)
    with lines.opened(port, lines.settings(unit="newton", full_scale_n=1e4)) as driver:
        before = port.to_host.counts["chunks"] - driver.link.counters["lines"]
        junk = driver.link.counters["junk_lines"]  # the first one is cut
        port.play(5.0)
        assert port.to_host.counts["split"] > 100 and port.to_host.counts["delayed"] > 10
        late = port.to_host.counts["chunks"] - driver.link.counters["lines"]
        assert abs(late - before) <= 2  # under way
        assert junk <= 1 and driver.link.counters["junk_lines"] == junk
        assert driver.link.counters["faults"] == 0


def test_an_answer_that_is_dropped_is_unanswered() -> None:
    port = Port(EmulatedLoadstar(bota.slope, lines.QUIET), 115_200, until_s=6.0)
    chosen = lines.settings(request="O0W1", rate_hz=20)
    with lines.opened(port, chosen) as driver:
        unanswered = driver.link.counters["unanswered"]
        port.to_host._faults = Faults(drop=0.06)
        port.play(8.0)
        dropped = port.to_host.counts["dropped"]
        assert dropped > 5
        assert driver.link.counters["unanswered"] - unanswered == pytest.approx(dropped, abs=1)
        assert driver.link.counters["faults"] == 0


def test_a_cell_of_lines_that_is_pulled_waits_to_be_re_armed() -> None:
    port = Port(EmulatedHx711(bota.slope, Sensing(80.0)), 115_200, until_s=4.0)
    with lines.opened(port, lines.settings(unit="newton", full_scale_n=1e4)) as driver:
        port.plugged = False
        port.play_until(lambda: driver.link.state is LinkState.CLOSED)
        assert driver.link.counters["faults"] >= 1
        port.plugged = True
        port.play_until(lambda: driver.link.state is LinkState.CONFIGURED)
        with pytest.raises(DeviceError, match="gone while reading"):
            driver.read(time.monotonic_ns(), None)
        driver.rearm()
        assert bota.played(driver, port, 0.5)
