"""An emulated device on a pseudo terminal: what a serial port is to the host."""

import errno
import fcntl
import os
import select
import struct
import tempfile
import time
import tty
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from forefeel.common.errors import ConfigurationError
from forefeel.devices.emulation.wire import EmulatedDevice, Faults, Timetable, Wire

# --- The baud rate that a host has set on a pseudo terminal, and what is heard at another than was spoken.
_TCGETS2, _TCSETS2 = 0x802C_542A, 0x402C_542B  # of x86 and Arm
# bytes of `struct termios2`, and where its c_cflag and its two speeds begin (asm-generic/termbits.h)
_STATE_BYTES, _CFLAG_AT, _SPEEDS_AT = 44, 8, 36
_CBAUD, _BOTHER = 0o010_017, 0o010_000  # mask of the rate in c_cflag, and: the rate is in the speeds
_TOLERANCE = 0.03  # a UART loses its place after half a bit in ten


def host_baud(terminal: int) -> int | None:
    """The rate at which the host sends on an open terminal; None where the system does not tell."""
    state = _state(terminal)
    return None if state is None else struct.unpack_from("<II", state, _SPEEDS_AT)[1]


def set_baud(terminal: int, baud: int) -> None:
    """Sets the rate as a host that opens the port does; nothing where the system has other calls for it."""
    state = _state(terminal)
    if state is None:
        return
    (flags,) = struct.unpack_from("<I", state, _CFLAG_AT)
    struct.pack_into("<I", state, _CFLAG_AT, (flags & ~_CBAUD) | _BOTHER)
    struct.pack_into("<II", state, _SPEEDS_AT, baud, baud)
    with suppress(OSError):
        fcntl.ioctl(terminal, _TCSETS2, bytes(state))


def misheard(data: bytes, spoken_baud: int, heard_baud: int) -> bytes:
    """What a UART at one rate makes of bytes (8N1, no pause between them) at another. Pure.

    A byte whose stop bit is missing is read as 0, as Linux does.
    """
    if abs(heard_baud - spoken_baud) <= _TOLERANCE * spoken_baud:
        return data
    bits = [level for byte in data for level in (0, *(byte >> i & 1 for i in range(8)), 1)]
    ratio, found, at = spoken_baud / heard_baud, bytearray(), 0

    def level(time: float) -> int:
        return bits[int(time)] if time < len(bits) else 1

    while (start := _falling_edge(bits, at)) is not None:
        samples = [level(start + (k + 0.5) * ratio) for k in range(10)]
        at = int(start + 9.5 * ratio) + 1
        if samples[0]:
            at = start + 1  # too short to be a start bit
        else:
            found.append(sum(bit << i for i, bit in enumerate(samples[1:9])) if samples[9] else 0)
    return bytes(found)


def _falling_edge(bits: list[int], at: int) -> int | None:
    """Where the line next falls; it is high before the first bit."""
    falls = (i for i in range(at, len(bits)) if not bits[i] and (i == 0 or bits[i - 1]))
    return next(falls, None)


def _state(terminal: int) -> bytearray | None:
    state = bytearray(_STATE_BYTES)
    try:
        fcntl.ioctl(terminal, _TCGETS2, state)
    except OSError:
        return None
    return state


# --- An emulated device on a pseudo terminal: what a serial port is to the host.
_PERIOD_S = 0.001  # s that a round waits at most: the period of the devices that send at 1 kHz
_CHUNK_BYTES = 4096  # bytes of one read


class Pty:
    """The device's end of a pseudo terminal; the host opens `link`, a symbolic link that stays the same.

    Raises:
        ConfigurationError: the link's place holds something that is no link of ours.
    """

    def __init__(self, link: Path) -> None:
        self.link = link
        self._master = self._slave = -1
        self.lost = 0
        self._baud: int | None = None
        self.plug()

    def speak_at(self, baud: int) -> None:
        """The device has that rate; a host at another mishears it, and is misheard."""
        self._baud = baud
        if self._slave >= 0:
            set_baud(self._slave, baud)

    def plug(self) -> None:
        """Makes a new terminal behind the same link."""
        if self._master >= 0:
            return
        if self.link.exists() and not self.link.is_symlink():
            raise ConfigurationError(f"{self.link}: exists and is no link; expected a free path")
        self._master, self._slave = os.openpty()  # our own slave end stays open: no EIO without a host
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        if self._baud is not None:
            set_baud(self._slave, self._baud)
        fresh = Path(tempfile.mktemp(dir=self.link.parent, prefix=f".{self.link.name}."))
        fresh.symlink_to(os.ttyname(self._slave))
        fresh.replace(self.link)

    def unplug(self) -> None:
        """The terminal goes away, as a cable that is pulled."""
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
        """What the host wrote, after waiting for at most `timeout_s`."""
        if self._master < 0:
            time.sleep(timeout_s)
            return b""
        if not select.select([self._master], [], [], timeout_s)[0]:
            return b""
        try:
            return self._heard(os.read(self._master, _CHUNK_BYTES), to_host=False)
        except OSError as error:
            if error.errno in (errno.EIO, errno.EAGAIN):
                return b""
            raise

    def write(self, data: bytes) -> None:
        """To the host; what it does not read is lost once the terminal is full, and counted."""
        if data and self._master >= 0:
            data = self._heard(data, to_host=True)
        while data and self._master >= 0:
            try:
                data = data[os.write(self._master, data) :]
            except BlockingIOError:
                self.lost += len(data)
                return

    def _heard(self, data: bytes, to_host: bool) -> bytes:
        """What the other end receives where the two rates differ."""
        device, host = self._baud, host_baud(self._slave) if self._baud else None
        if not device or not host:
            return data
        return misheard(data, device, host) if to_host else misheard(data, host, device)

    def __enter__(self) -> "Pty":
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()


class PtyServer:
    """Runs an emulated device on a pty in real time.

    `step` is to be called over and over; it waits for at most a millisecond.
    """

    def __init__(self, device: EmulatedDevice, pty: Pty, baud: int, faults: Faults, seed: int = 0) -> None:
        self._device, self._pty = device, pty
        pty.speak_at(baud)
        self.to_device, self.to_host = (Wire(baud, faults, f"{way} {seed}") for way in ("in", "out"))
        self._timetable = Timetable(faults)
        self._start_s = time.monotonic()

    def step(self) -> None:
        """One round: host to device, the device lives, device to host, and what is to happen now."""
        data = self._pty.read(self._wait_s())
        t_s = time.monotonic() - self._start_s
        for fault in self._timetable.due(t_s):
            self.provoke(fault)
        self.to_device.send(data, t_s)
        arrived = self.to_device.arrived(t_s)
        if arrived:
            self._device.receive(arrived, t_s)
        self.to_host.send(self._device.advance(t_s), t_s)
        self._pty.write(self.to_host.arrived(t_s))

    def _wait_s(self) -> float:
        """Until the next bytes arrive at either end, at most a millisecond."""
        t_s = time.monotonic() - self._start_s
        due_s = [wire.next_s - t_s for wire in (self.to_device, self.to_host) if wire.next_s is not None]
        return max(0.0, min([_PERIOD_S, *due_s]))

    @property
    def faults(self) -> Sequence[str]:
        return ("unplug", "plug", *self._device.faults)

    def provoke(self, fault: str) -> None:
        """Begins a fault of the cable (`unplug`, `plug`) or of the device now.

        Raises:
            ConfigurationError: there is no such fault.
        """
        if fault == "unplug":
            self._pty.unplug()
        elif fault == "plug":
            self._pty.plug()
        else:
            self._device.provoke(fault)
