"""An emulated device on a pseudo terminal, served by a thread of the test."""

import queue
import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

from forefeel.emulate.device import EmulatedDevice
from forefeel.emulate.pty import Pty, PtyServer
from forefeel.emulate.wire import Faults
from tests.waiting import PATIENCE_S


class PtyThread:
    """Use: `with PtyThread(device, folder) as port:`; `port.path` is the serial port."""

    def __init__(self, device: EmulatedDevice, folder: Path, baud: int = 115_200, faults: str = "") -> None:
        self.pty = Pty(folder / "port")
        self._server = PtyServer(device, self.pty, baud, Faults.parse(faults))
        self._actions: queue.SimpleQueue[tuple[Callable[[], object], threading.Event]] = queue.SimpleQueue()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="emulated device")

    @property
    def path(self) -> str:
        return str(self.pty.link)

    def do(self, action: Callable[[], object]) -> None:
        """Between two rounds of the device."""
        done = threading.Event()
        self._actions.put((action, done))
        assert done.wait(PATIENCE_S)

    def __enter__(self) -> "PtyThread":
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stopping.set()
        self._thread.join()
        self.pty.unplug()

    def _run(self) -> None:
        while not self._stopping.is_set():
            self._server.step()
            while not self._actions.empty():
                action, done = self._actions.get()
                action()
                done.set()
