"""The emulator of a driver in processes of its own, which can be frozen, unplugged and told to fail."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from forefeel.common.errors import RunError
from forefeel.common.hardware.driver import InstalledDriver, imported
from forefeel.devices.emulation.bench import Emulation
from forefeel.parent import child_environment

_ENDS_S = 5.0  # s until it must have ended after SIGTERM, else it is killed


class EmulatorProcess:
    """One `forefeel emulate` with its stdin."""

    def __init__(self, device: str, port: str) -> None:
        command = [sys.executable, "-m", "forefeel", "emulate", device, "--port", port]
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=child_environment(),
        )
        self._device = device

    def wait_until_ready(self) -> None:
        """Waits for the line that it prints when its port is there. Raises RunError when it ends before."""
        assert self._process.stdout is not None
        if not self._process.stdout.readline():
            error = self._process.stderr.read().strip() if self._process.stderr else ""
            raise RunError(f"the emulator of {self._device} ended: {error or 'it said nothing'}")

    def order(self, line: str) -> None:
        """A fault of the device or of its cable, as `forefeel emulate` takes it on stdin."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()

    def freeze(self) -> None:
        """The device stops answering, and its cable stays."""
        self._process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """Lets the device go on."""
        self._process.send_signal(signal.SIGCONT)

    def close(self) -> None:
        """Ends the process; idempotent."""
        self.thaw()
        self._process.terminate()
        try:
            self._process.communicate(timeout=_ENDS_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()


class EmulatedBench:
    """An emulated device, its cable, and the settings of the driver that talks to it.

    Attributes:
        settings: of the driver; `missing`: the same with a port that does not exist.
        faults: what the device itself can be told to do.
    """

    def __init__(self, driver: InstalledDriver, folder: Path, leave: ExitStack) -> None:
        emulation: Emulation = imported(str(driver.driver.emulator))
        on_can = emulation.on_can
        host, device_end = (str(folder / name) for name in ("host", "device"))
        hub = _started("can_hub", f"{host},{device_end}", leave) if on_can else None
        self._device = _started(driver.name, device_end if on_can else host, leave)
        self._cable = hub or self._device
        self.faults = emulation.faults
        self.settings = emulation.settings(driver, host)
        self.missing = emulation.settings(driver, str(folder / "nothing_here"))

    def unplug(self) -> None:
        """Pulls the cable."""
        self._cable.order("unplug")

    def plug(self) -> None:
        """Puts the cable in again."""
        self._cable.order("plug")

    def order(self, line: str) -> None:
        self._device.order(line)

    @contextmanager
    def frozen(self) -> Iterator[None]:
        """Stops the device's process, so that it is silent within the block."""
        self._device.freeze()
        try:
            yield
        finally:
            self._device.thaw()


def _started(device: str, port: str, leave: ExitStack) -> EmulatorProcess:
    process = EmulatorProcess(device, port)
    leave.callback(process.close)
    process.wait_until_ready()
    return process
