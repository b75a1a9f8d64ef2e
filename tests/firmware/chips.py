"""Emulated chips that run the images of firmware/, as devices of a line in stepped time.

No part of it looks at a clock: a chip is as far as the stepped time, however busy the host is.
"""

import fcntl
import json
import os
import select
import socket
import subprocess
import sys
import termios
from collections import Counter, deque
from contextlib import suppress
from pathlib import Path
from typing import Any

from forefeel.devices.coil.protocol import CoilParser, CoilState
from forefeel.testing import SteppedTime

BRIDGE = Path(__file__).with_name("chip.cjs")
_HANGS_S = 120.0  # s of the host without a byte, of a QEMU that has died


class Chip:
    """What the emulators share.

    Attributes:
        time: the stepped time; newest: the newest state that the chip has sent.
    """

    time: SteppedTime

    faults = ()

    def __init__(self) -> None:
        self.newest: CoilState | None = None
        self._parser = CoilParser(Counter())

    def provoke(self, fault: str) -> None:
        """There are none of the device's own."""

    def _note(self, data: bytes) -> bytes:
        for frame in self._parser.feed(data):
            if isinstance(frame, CoilState):
                self.newest = frame
        return data


class Qemu(Chip):
    """The AVR image in QEMU, whose time is that of the states.

    Its UART writes to a socket of a few bytes, so the chip stands still until they are read; but QEMU hands
    it a byte of ours at a time, and none while it stands. So the chip goes on until it has all of them, and
    the stepped time with it. Before it sends states nothing of the firmware waits for the host.
    """

    def __init__(self, image: Path) -> None:
        super().__init__()
        self._image = image
        self._ours, self._theirs = socket.socketpair()
        self._theirs.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)
        self._ours.setblocking(False)
        self._start()

    def _start(self) -> None:
        end = self._theirs.fileno()
        self._process = subprocess.Popen(
            ["qemu-system-avr", "-M", "uno", "-bios", str(self._image), "-display", "none",
             "-monitor", "none", "-chardev", f"socket,id=uart,fd={end}", "-serial", "chardev:uart"],
            pass_fds=[end], stdin=subprocess.DEVNULL,
        )  # fmt: skip
        self.newest, self._to_chip, self._begun = None, bytearray(), (0.0, 0)

    def receive(self, data: bytes, t_s: float) -> None:
        del t_s
        self._to_chip += data

    def advance(self, t_s: float) -> bytes:
        data = self._note(self._exchange(0.01 if self.newest is None else 0.0))
        while self._to_chip or unread_bytes(self._ours):  # QEMU takes none while its UART waits for us
            data += self._note(self._exchange(1e-3))
        if self.newest is None:
            return data
        if self._begun == (0.0, 0):
            self._begun = t_s, self.newest.time_us
        until_us = self._begun[1] + (t_s - self._begun[0]) * 1e6
        while self.newest is not None and self.newest.time_us < until_us:
            data += self._note(self._exchange(_HANGS_S))
        self.time.set_ns(self.time.now_ns() + round((self.newest.time_us - until_us) * 1e3))
        return data

    def reset(self) -> None:
        """Takes the power away and gives it back: `system_reset` of QEMU 7.2 does not reset an AVR's core."""
        self._process.kill()
        self._process.wait()
        self._start()

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        self._ours.close()
        self._theirs.close()

    def _exchange(self, wait_s: float) -> bytes:
        """Gives the chip what it takes and returns what it says, empty when it says nothing for that long."""
        with suppress(BlockingIOError):
            while self._to_chip:
                del self._to_chip[: self._ours.send(self._to_chip)]
        if select.select([self._ours], [], [], wait_s)[0]:
            return self._ours.recv(24)
        assert wait_s < _HANGS_S, "the chip says nothing any more"
        return b""


def unread_bytes(end: socket.socket) -> int:
    """Bytes that the other end has not read yet (SIOCOUTQ)."""
    return int.from_bytes(fcntl.ioctl(end, termios.TIOCOUTQ, bytes(4)), sys.byteorder)


class Node(Chip):
    """An image in avr8js or rp2040js, by the bridge beside this file; both step by instructions.

    Attributes:
        duty: of the output, in steps of the PWM, with the direction as its sign; `late_us`: the longest from
            the last byte of a command to another duty.
    """

    def __init__(self, kind: str, image: Path, modules: Path) -> None:
        super().__init__()
        self.duty, self.late_us = 0, 0.0
        self._orders, self._to_chip, self._t_s = deque[dict[str, Any]](), bytearray(), 0.0
        self._process = subprocess.Popen(
            ["node", str(BRIDGE), kind, str(image)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env={**os.environ, "NODE_PATH": str(modules)},
        )  # fmt: skip

    def receive(self, data: bytes, t_s: float) -> None:
        del t_s
        self._to_chip += data

    def order(self, **what: Any) -> None:  # noqa: ANN401 - of the bridge
        """What is done to the chip in the next step, one order a step."""
        self._orders.append(what)

    def advance(self, t_s: float) -> bytes:
        order = self._orders.popleft() if self._orders else {}
        line = {"us": (t_s - self._t_s) * 1e6, "bytes": self._to_chip.hex(), **order}
        self._to_chip.clear()
        self._t_s = t_s
        assert self._process.stdin and self._process.stdout
        print(json.dumps(line), file=self._process.stdin, flush=True)
        answer = json.loads(self._process.stdout.readline())
        self.duty, self.late_us = answer["duty"], answer["late_us"]
        return self._note(bytes.fromhex(answer["bytes"]))

    def reset(self) -> None:
        self.order(reset=True)

    def close(self) -> None:
        self._process.kill()
        self._process.communicate()
