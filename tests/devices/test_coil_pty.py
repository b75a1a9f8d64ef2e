"""The coil handle with its own thread on a pseudo terminal: port, unplugging, another host."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from forefeel.common.clock import MonotonicClock
from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.hardware.link import LinkState
from forefeel.devices.coil.driver import CoilHandle
from forefeel.devices.coil.emulator import CoilDevice, CoilHardware
from forefeel.devices.emulation.pty import Pty, PtyServer
from forefeel.devices.emulation.wire import Faults
from forefeel.master.daemon import make_handle
from tests.devices.coil_rig import Hand, coil_settings
from tests.waiting import wait_until

CALM_S = 2.0
"""A watchdog that a busy machine does not trip by itself: longer than settings and a real device allow."""


class Emulated:
    """A device on a terminal, served by a thread."""

    def __init__(self, link: Path, hardware: CoilHardware | None = None) -> None:
        self.hand = Hand()
        self.device = CoilDevice(hardware, self.hand)
        self.pty = Pty(link)
        self.todo: Callable[[], None] | None = None


@contextmanager
def served(link: Path, hardware: CoilHardware | None = None) -> Iterator[Emulated]:
    emulated, done = Emulated(link, hardware), threading.Event()
    server = PtyServer(emulated.device, emulated.pty, 2_000_000, Faults())

    def serve() -> None:
        while not done.is_set():
            if emulated.todo is not None:
                emulated.todo()
                emulated.todo = None
            server.step()

    thread = threading.Thread(target=serve)
    with emulated.pty:
        thread.start()
        try:
            yield emulated
        finally:
            done.set()
            thread.join()


@contextmanager
def opened(link: Path) -> Iterator[CoilHandle]:
    calm = coil_settings(port=str(link)).model_copy(update={"watchdog_s": CALM_S})
    handle = CoilHandle(calm)
    handle.open()
    try:
        yield handle
    finally:
        handle.close()


def tick(handle: CoilHandle, force_n: float) -> bool:
    """Whether the handle did what the haptic loop wants."""
    try:
        handle.read(time.monotonic_ns())
        handle.render(force_n, time.monotonic_ns())
    except DeviceError:
        return False
    return True


def test_it_opens_reads_and_renders_and_after_unplugging_waits_for_the_deadman(tmp_path: Path) -> None:
    calm = CoilHardware(longest_watchdog_ms=round(1e3 * CALM_S))
    with served(tmp_path / "handle", calm) as emulated, opened(tmp_path / "handle") as handle:
        assert handle.link.identity == "forefeel-coil emulated, firmware 1.0"
        emulated.hand.position_m, emulated.hand.pressed = 0.012, True
        wait_until(lambda: handle.read(time.monotonic_ns()).deadman)
        assert handle.read(time.monotonic_ns()).position_m == pytest.approx(0.012, abs=2e-6)
        wait_until(lambda: tick(handle, 3.0) and emulated.device.current_a == 1.5)
        emulated.todo = emulated.pty.unplug
        wait_until(lambda: not tick(handle, 3.0))
        wait_until(lambda: emulated.device.current_a == 0.0)
        emulated.todo = emulated.pty.plug
        wait_until(lambda: handle.link.state is LinkState.CONFIGURED)
        assert not tick(handle, 3.0)
        emulated.hand.pressed = False
        time.sleep(0.02)
        assert not handle.pressed_anew
        emulated.hand.pressed = True
        wait_until(lambda: handle.pressed_anew)
        assert emulated.device.current_a == 0.0
        handle.rearm()
        wait_until(lambda: tick(handle, 3.0) and emulated.device.current_a == 1.5)
        handle.close()
        handle.close()
        wait_until(lambda: emulated.device.current_a == 0.0)
        assert handle.link.state is LinkState.CLOSED


def test_no_port_is_one_line_that_names_it(tmp_path: Path) -> None:
    settings = coil_settings(port=str(tmp_path / "none"))
    with pytest.raises(DeviceSetupError, match=r"none: no such port; expected one that"):
        make_handle(settings, MonotonicClock()).open()


def test_a_port_that_another_process_holds_is_busy(tmp_path: Path) -> None:
    second = CoilHandle(coil_settings(port=str(tmp_path / "handle")))
    busy = pytest.raises(DeviceSetupError, match="busy, another process holds it")
    with served(tmp_path / "handle"), opened(tmp_path / "handle"), busy:
        second.open()


def test_another_version_is_refused_by_name(tmp_path: Path) -> None:
    handle = CoilHandle(coil_settings(port=str(tmp_path / "handle")))
    refused = pytest.raises(DeviceSetupError, match=r"handle: firmware 2\.0 speaks protocol 2; expected 1$")
    with served(tmp_path / "handle", CoilHardware(protocol=2, firmware="2.0")), refused:
        handle.open()
