"""An emulated device on a pseudo terminal, served by a thread of the test."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

from forefeel.devices.emulation.device import EmulatedDevice
from forefeel.devices.emulation.pty import Pty, PtyServer
from forefeel.devices.emulation.wire import Faults
from tests.devices.can_rig import running


class PtyThread:
    """Use: `with PtyThread(device, folder) as port:`; `port.path` is the serial port."""

    def __init__(self, device: EmulatedDevice, folder: Path, baud: int = 115_200, faults: str = "") -> None:
        self.pty = Pty(folder / "port")
        self._server = PtyServer(device, self.pty, baud, Faults.parse(faults))
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
