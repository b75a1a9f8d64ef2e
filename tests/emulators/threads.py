"""Emulated devices in threads of the test, for clients that live in real time."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, Protocol

from forefeel.devices.emulation.pty import Pty, PtyServer
from forefeel.devices.emulation.wire import EmulatedDevice


class Steps(Protocol):
    """Whatever lives by being stepped."""

    def step(self) -> None: ...


@contextmanager
def running(living: Steps) -> Iterator[threading.Lock]:
    """Steps it in a thread; it stands while the lock is held. What it raises is raised at the end."""
    stopping, between, broken = threading.Event(), threading.Lock(), list[BaseException]()

    def live() -> None:
        try:
            while not stopping.wait(1e-4):
                with between:
                    living.step()
        except BaseException as error:  # noqa: BLE001 - shown by the test
            broken.append(error)

    thread = threading.Thread(target=live, name=type(living).__name__)
    thread.start()
    try:
        yield between
    finally:
        stopping.set()
        thread.join()
        for error in broken:
            raise error


class Port(NamedTuple):
    """The serial port of an emulated device; `do`: something between two rounds of the device."""

    path: str
    pty: Pty
    do: Callable[[Callable[[], object]], None]


@contextmanager
def on_pty(device: EmulatedDevice, folder: Path, baud: int = 115_200) -> Iterator[Port]:
    with Pty(folder / "port") as pty, running(PtyServer(device, pty, baud)) as between:

        def do(action: Callable[[], object]) -> None:
            with between:
                action()

        yield Port(str(pty.link), pty, do)
