"""The line protocol of serial CAN adapters (LAWICEL, "slcan"). Pure.

`tIIILDD..` is a frame with an 11-bit identifier, `T` with 29 bits, `r` and `R` remote frames; a carriage
return ends a line, a bell is a refusal. The protocol has no checksum: a digit that became another digit is
a valid frame.
"""

from collections import Counter
from typing import NamedTuple

BITRATES = {
    10_000: "S0",
    20_000: "S1",
    50_000: "S2",
    100_000: "S3",
    125_000: "S4",
    250_000: "S5",
    500_000: "S6",
    750_000: "S7",
    1_000_000: "S8",
}
OK, BELL = b"\r", b"\x07"
_LONGEST = 64  # of a line: T, 8 digits, length, 16 digits, 4 of a time stamp are 30
_ID_DIGITS = {"t": 3, "r": 3, "T": 8, "R": 8}
_MOST_ID = {3: 0x7FF, 8: 0x1FFF_FFFF}
_HEX = frozenset("0123456789abcdefABCDEF")
_STAMP_DIGITS = 4  # hexadecimal digits of the time stamp, in ms, that an adapter may append (LAWICEL)


class Frame(NamedTuple):
    """A classic CAN frame; `length` is what a remote frame asks for."""

    can_id: int
    data: bytes
    extended: bool = False
    remote: bool = False
    length: int = 0


def encoded(frame: Frame) -> bytes:
    """The line of a frame."""
    letter = ("R" if frame.extended else "r") if frame.remote else ("T" if frame.extended else "t")
    length = frame.length if frame.remote else len(frame.data)
    digits = f"{frame.can_id:08X}" if frame.extended else f"{frame.can_id:03X}"
    return f"{letter}{digits}{length:d}{frame.data.hex().upper()}\r".encode("ascii")


def decoded(line: str) -> Frame | None:
    """The frame of a line without its end; None unless every character is as it must be."""
    digits = _ID_DIGITS.get(line[:1])
    if digits is None or len(line) < digits + 2 or not _HEX.issuperset(line[1:]):
        return None
    can_id, length, rest = int(line[1 : digits + 1], 16), ord(line[digits + 1]) - ord("0"), line[digits + 2 :]
    remote = line[0] in "rR"
    expected = 0 if remote else 2 * length
    if not 0 <= length <= 8 or can_id > _MOST_ID[digits]:
        return None
    if len(rest) not in (expected, expected + _STAMP_DIGITS):
        return None
    return Frame(can_id, bytes.fromhex(rest[:expected]), digits == 8, remote, length)


class Lines:
    """Cuts bytes into lines; bounded.

    Attributes:
        counts: `bells`, and `overlong` lines, which are dropped as a whole.
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._rest = b""
        self._skipping = False

    def feed(self, data: bytes) -> list[bytes]:
        """The lines that are complete now, in order, none of them empty."""
        self.counts["bells"] += data.count(BELL)
        *complete, self._rest = (self._rest + data).replace(BELL, OK).split(OK)
        if complete and self._skipping:
            complete, self._skipping = complete[1:], False
        if len(self._rest) > _LONGEST:
            self.counts["overlong"] += not self._skipping
            self._rest, self._skipping = b"", True
        return [line for line in complete if line]


class SlcanParser:
    """Bytes of an adapter into frames; no bytes make it raise, and what follows damage is read again.

    A frame that is glued to a truncated one is found: its letter can not be a digit of another.

    Attributes:
        counts: `frames`; `damaged` lines that lost a frame, `answers` to commands, `bells`, `overlong`.
    """

    def __init__(self) -> None:
        self._lines = Lines()
        self.counts = self._lines.counts

    def feed(self, data: bytes) -> list[Frame]:
        """The frames that are complete now."""
        frames = []
        for line in self._lines.feed(data):
            frame = self._read(line.decode("latin-1"))
            if frame is not None:
                self.counts["frames"] += 1
                frames.append(frame)
        return frames

    def _read(self, text: str) -> Frame | None:
        frame = decoded(text)
        if frame is not None:
            return frame
        if text in ("z", "Z") or text[0] in "VNFv":
            self.counts["answers"] += 1
            return None
        self.counts["damaged"] += 1
        last = max(text.rfind(letter) for letter in _ID_DIGITS)
        return decoded(text[last:]) if last > 0 else None
