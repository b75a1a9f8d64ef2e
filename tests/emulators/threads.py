"""Emulated devices in threads of the test, for clients that live in real time."""

import queue
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Protocol

from forefeel.devices.emulation.pty import Pty, PtyServer
from forefeel.devices.emulation.wire import EmulatedDevice
from tests.waiting import PATIENCE_S


class Steps(Protocol):
    """Whatever lives by being stepped."""

    def step(self) -> None: ...


class _Life:
    """Steps one in a thread; what it raises is kept, and ends it."""

    def __init__(self, one: Steps) -> None:
        self.broken: BaseException | None = None
        self._one, self._stopping = one, threading.Event()
        self._actions: queue.SimpleQueue[tuple[Callable[[], object], threading.Event]] = queue.SimpleQueue()
        self.thread = threading.Thread(target=self._run, name=type(one).__name__)

    def do(self, action: Callable[[], object]) -> None:
        """Between two steps, for what the stepping thread must not meet half done; waits for it."""
        done = threading.Event()
        self._actions.put((action, done))
        assert done.wait(PATIENCE_S)

    def end(self) -> None:
        self._stopping.set()
        self.thread.join()

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                self._one.step()
                while not self._actions.empty():
                    action, done = self._actions.get()
                    action()
                    done.set()
        except BaseException as error:  # noqa: BLE001 - shown by the test
            self.broken = error


@contextmanager
def running(*living: Steps) -> Iterator[Callable[[Callable[[], object]], None]]:
    """Steps each in a thread of its own; yields what does something between two steps of the first."""
    lives = [_Life(one) for one in living]
    for life in lives:
        life.thread.start()
    try:
        yield lives[0].do
    finally:
        for life in lives:
            life.end()
        for broken in filter(None, (life.broken for life in lives)):
            raise broken


class PtyThread:
    """Use: `with PtyThread(device, folder) as port:`; `port.path` is the serial port."""

    def __init__(self, device: EmulatedDevice, folder: Path, baud: int = 115_200) -> None:
        self.pty = Pty(folder / "port")
        self._server = PtyServer(device, self.pty, baud)
        self._left = ExitStack()

    @property
    def path(self) -> str:
        return str(self.pty.link)

    def do(self, action: Callable[[], object]) -> None:
        """Between two rounds of the device."""
        self._between_steps(action)

    def __enter__(self) -> "PtyThread":
        self._left.callback(self.pty.unplug)
        self._between_steps = self._left.enter_context(running(self._server))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._left.close()
