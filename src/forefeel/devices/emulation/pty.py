"""An emulated device on a pseudo terminal: what a serial port is to the host."""

import os
import select
import tempfile
import time
import tty
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from forefeel.common.errors import ConfigurationError
from forefeel.devices.emulation.wire import EmulatedDevice, Wire

_PERIOD_S = 0.001  # s that a round waits at most: the period of the devices that send at 1 kHz
_CHUNK_BYTES = 4096  # bytes of one read


class Pty:
    """The device's end of a pseudo terminal; the host opens `link`, a symbolic link that stays the same.

    Raises:
        ConfigurationError: the link's place holds something that is no link of ours, or can hold none.
    """

    def __init__(self, link: Path) -> None:
        self.link = link
        self._master = self._slave = -1
        self.plug()

    def plug(self) -> None:
        """Opens a new terminal and puts the link to it in place; nothing when it is open. ConfigurationError:
        something that is no link is at the place, or no link can be made there.
        """
        if self._master >= 0:
            return
        if self.link.exists() and not self.link.is_symlink():
            raise ConfigurationError(f"{self.link}: exists and is no link; expected a free path")
        self._master, self._slave = os.openpty()  # our own slave end stays open: no EIO without a host
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        fresh = Path(tempfile.mktemp(dir=self.link.parent, prefix=f".{self.link.name}."))
        try:
            fresh.symlink_to(os.ttyname(self._slave))
            fresh.replace(self.link)
        except OSError as error:
            raise ConfigurationError(
                f"{self.link}: {error.strerror}; expected a folder that one may write, as in /tmp/device"
            ) from error

    def unplug(self) -> None:
        """Removes the link and closes the terminal."""
        with suppress(FileNotFoundError):
            self.link.unlink()
        for end in (self._master, self._slave):
            if end >= 0:
                os.close(end)
        self._master = self._slave = -1

    def fileno(self) -> int:
        """The device's end, for select; -1 while unplugged."""
        return self._master

    def read(self, timeout_s: float) -> bytes:
        """Reads the host's bytes; waits at most `timeout_s`, empty when there are none or while unplugged."""
        if self._master < 0:
            time.sleep(timeout_s)
            return b""
        if not select.select([self._master], [], [], timeout_s)[0]:
            return b""
        return os.read(self._master, _CHUNK_BYTES)

    def write(self, data: bytes) -> None:
        """Writes to the host; what it does not read is lost once the terminal is full."""
        while data and self._master >= 0:
            try:
                data = data[os.write(self._master, data) :]
            except BlockingIOError:
                return

    def __enter__(self) -> "Pty":
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()


class PtyServer:
    """Runs an emulated device on a pty in real time.

    `step` is to be called over and over; it waits for at most a millisecond.
    """

    def __init__(self, device: EmulatedDevice, pty: Pty, baud: int) -> None:
        self._device, self._pty = device, pty
        self.to_device, self.to_host = Wire(baud), Wire(baud)
        self._start_s = time.monotonic()

    def step(self) -> None:
        """Carries bytes both ways, each once it has crossed the wire, advances the device; waits 1 ms at
        most.
        """
        data = self._pty.read(self._wait_s())
        t_s = time.monotonic() - self._start_s
        self.to_device.send(data, t_s)
        arrived = self.to_device.arrived(t_s)
        if arrived:
            self._device.receive(arrived, t_s)
        self.to_host.send(self._device.advance(t_s), t_s)
        self._pty.write(self.to_host.arrived(t_s))

    def _wait_s(self) -> float:
        """Time in s until the next bytes arrive at either end, at most a millisecond."""
        t_s = time.monotonic() - self._start_s
        due_s = [wire.next_s - t_s for wire in (self.to_device, self.to_host) if wire.next_s is not None]
        return max(0.0, min([_PERIOD_S, *due_s]))

    @property
    def faults(self) -> Sequence[str]:
        return ("unplug", "plug", *self._device.faults)

    def provoke(self, fault: str) -> None:
        """Unplugs or plugs the terminal; passes other faults on to the device."""
        if fault == "unplug":
            self._pty.unplug()
        elif fault == "plug":
            self._pty.plug()
        else:
            self._device.provoke(fault)
