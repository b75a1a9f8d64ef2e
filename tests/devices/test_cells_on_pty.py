"""Serial load cells over a real pseudo terminal: plugged, unplugged, busy, missing."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import sin
from pathlib import Path

import pytest

from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.hardware.link import LinkState
from forefeel.devices.ascii_line.driver import AsciiLineLoadCell
from forefeel.devices.ascii_line.emulator import EmulatedLoadstar
from forefeel.devices.ascii_line.settings import AsciiLineSettings
from forefeel.devices.bota.driver import BotaSerialLoadCell
from forefeel.devices.bota.emulator import EmulatedBota
from forefeel.devices.bota.settings import BotaSettings
from forefeel.devices.emulation.device import EmulatedDevice
from forefeel.devices.emulation.pty import Pty, PtyServer
from forefeel.devices.emulation.sensing import Sensing
from forefeel.devices.emulation.wire import Faults
from forefeel.slave.load_cell import LoadCell, LoadCellReading
from tests.waiting import wait_until

RATE_HZ = 40.0  # slow enough for a busy machine: silence begins after 125 ms


@contextmanager
def served(device: EmulatedDevice, port: Path, baud: int) -> Iterator[Callable[[bool], None]]:
    """An emulator that lives; what is yielded plugs or unplugs it."""
    wanted, ended = threading.Event(), threading.Event()
    wanted.set()

    def live() -> None:
        with Pty(port) as pty:
            server = PtyServer(device, pty, baud, Faults(split=0.2))
            while not ended.is_set():
                (pty.plug if wanted.is_set() else pty.unplug)()
                server.step()

    thread = threading.Thread(target=live)
    thread.start()
    try:
        wait_until(port.exists)
        yield lambda plugged: wanted.set() if plugged else wanted.clear()
    finally:
        ended.set()
        thread.join()


def readings(driver: LoadCell, count: int) -> list[LoadCellReading]:
    got: list[LoadCellReading] = []

    def enough() -> bool:
        got.extend(driver.read(0, None))
        return len(got) >= count

    wait_until(enough)
    return got


def bota(port: Path) -> BotaSerialLoadCell:
    given = {"driver": "bota_serial", "port": str(port), "full_scale_n": 10, "rate_hz": RATE_HZ}
    return BotaSerialLoadCell(BotaSettings.model_validate(given))


def test_a_bota_cell_is_pulled_out_and_put_back(tmp_path: Path) -> None:
    port, device = tmp_path / "cell", EmulatedBota(sin, Sensing(RATE_HZ))
    driver = bota(port)
    with served(device, port, 460_800) as plug:
        driver.open()
        try:
            for reading in readings(driver, 8):
                assert reading.valid
                assert reading.stamp_ns is not None
                assert reading.stamp_ns <= time.monotonic_ns()
            plug(False)
            wait_until(lambda: driver.link.inhibited)
            with pytest.raises(DeviceError):
                driver.read(0, None)
            plug(True)
            wait_until(lambda: driver.link.state is LinkState.CONFIGURED)
            with pytest.raises(DeviceError):
                driver.read(0, None)
            driver.rearm()
            assert len(readings(driver, 4)) >= 4
        finally:
            driver.close()


def test_a_loadstar_cell_is_asked(tmp_path: Path) -> None:
    port, device = tmp_path / "cell", EmulatedLoadstar(sin, Sensing(150.0))
    given = {"driver": "ascii_line", "port": str(port), "unit": "millipound_force", "request": "O0W1"}
    chosen = AsciiLineSettings.model_validate({**given, "full_scale_n": 10, "rate_hz": 16, "baud": 115_200})
    driver = AsciiLineLoadCell(chosen)
    with served(device, port, 115_200):
        driver.open()
        try:
            assert all(reading.valid for reading in readings(driver, 5))
        finally:
            driver.close()


def test_a_port_that_is_missing_or_busy_is_said_in_one_line(tmp_path: Path) -> None:
    port = tmp_path / "cell"
    with pytest.raises(DeviceSetupError, match="no such port"):
        bota(port).open()
    first = bota(port)
    with served(EmulatedBota(sin, Sensing(RATE_HZ)), port, 460_800):
        first.open()
        try:
            with pytest.raises(DeviceSetupError, match="busy, another process holds it"):
                bota(port).open()
            assert len(readings(first, 2)) >= 2
        finally:
            first.close()
