"""Several serial CAN adapters on one bus: an slcan hub over pseudo terminals."""

import select
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path

from forefeel.devices.canopen.slcan import BELL, BITRATES, OK, Lines, frame_of
from forefeel.devices.emulation.pty import Pty

_WAIT_S = 0.002  # s that a round waits at most


def frame_s(frame: bytes, bitrate: int) -> float:
    """The time that a frame (a line of slcan) takes on the wire with worst-case stuffing, the gap included.

    Davis et al., CAN schedulability analysis: refuted, revisited and revised (2007), equation 1:
    8 n + g + 13 + (g + 8 n - 1) / 4 bits for n bytes, g = 34 or 54.
    """
    head_digits, head_bits = (10, 54) if frame[:1] in b"TR" else (5, 34)
    data_bits = 4 * (len(frame) - head_digits)
    return (data_bits + head_bits + 13 + (head_bits + data_bits - 1) // 4) / bitrate


class SlcanAdapter:
    """One adapter: lines of its host in, frames and answers out. Pure."""

    def __init__(self) -> None:
        self._lines = Lines()
        self.open = False

    def receive(self, data: bytes) -> tuple[list[bytes], bytes]:
        """Takes bytes of the host; returns (frames for the bus, answers for the host). A frame while open, or
        a command that is obeyed, is answered with a carriage return, any other line with a bell.
        """
        frames, answers = [], bytearray()
        for line in self._lines.feed(data):
            if self.open and line == frame_of(line):
                frames.append(line)
                answers += OK
            elif line[:1] not in b"tTrR" and self._obey(line):
                answers += OK
            else:
                answers += BELL
        return frames, bytes(answers)

    def _obey(self, line: bytes) -> bool:
        if line in (b"O", b"C"):
            self.open = line == b"O"
            return True
        return line.decode("latin-1") in BITRATES.values() and not self.open


class _Port:
    def __init__(self, link: Path) -> None:
        self.pty = Pty(link)
        self.adapter = SlcanAdapter()


class CanHub:
    """Adapters, one for each link, on one bus: a frame goes to all others. To be stepped over and over."""

    faults = "unplug", "plug"

    def __init__(self, links: Sequence[Path], bitrate: int = 1_000_000) -> None:
        self._ports = [_Port(link) for link in links]
        self._bitrate, self._free_s = bitrate, 0.0
        self._on_wire = deque[tuple[float, int, bytes]]()  # (when it is complete, sender, frame)

    def provoke(self, fault: str) -> None:
        """Unplugs the first adapter (`unplug`), which closes its channel, or plugs it in again (`plug`)."""
        port = self._ports[0]
        if fault == "unplug":
            port.pty.unplug()
            port.adapter.open = False
        elif fault == "plug":
            port.pty.plug()

    def step(self) -> None:
        """Waits up to 2 ms, takes what the hosts wrote, and delivers each frame that has passed the bus. A
        frame goes to all open adapters but its sender.
        """
        ready = {port.pty.fileno() for port in self._ports if port.pty.fileno() >= 0}
        ready = set(select.select(list(ready), [], [], self._wait_s())[0])
        for i, port in enumerate(self._ports):
            if port.pty.fileno() in ready:
                frames, answers = port.adapter.receive(port.pty.read(0.0))
                port.pty.write(answers)
                for frame in frames:
                    self._free_s = max(self._free_s, time.monotonic()) + frame_s(frame, self._bitrate)
                    self._on_wire.append((self._free_s, i, frame))
        while self._on_wire and self._on_wire[0][0] <= time.monotonic():
            _, sender, frame = self._on_wire.popleft()
            for i, port in enumerate(self._ports):
                if i != sender and port.adapter.open:
                    port.pty.write(frame + OK)

    def close(self) -> None:
        for port in self._ports:
            port.pty.unplug()

    def _wait_s(self) -> float:
        due_s = self._on_wire[0][0] - time.monotonic() if self._on_wire else _WAIT_S
        return max(0.0, min(_WAIT_S, due_s))
