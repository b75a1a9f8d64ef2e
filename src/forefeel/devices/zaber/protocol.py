"""The Zaber ASCII protocol (firmware 6 and 7) as the host speaks it. Pure.

```
/1 1 07 move abs 1000:E9     command: device, axis, message id
@01 1 07 OK BUSY -- 0:E0     reply: OK or RJ, BUSY or IDLE, the gravest warning flag, data
```

Alerts (`!`) say no more than the flag of the next reply: they are noise here.

The two digits after the colon are the LRC: the two's complement of the sum of the bytes between the first
character and the colon.
"""

import re
from collections import Counter
from dataclasses import dataclass

SPEED_DATA = 1.6384  # 1 microstep/s as data of `maxspeed` and `move vel` (Zaber ASCII protocol manual)
ACCELERATION_DATA = 1.6384e-4  # 1 microstep/s^2 as data of `accel` (Zaber ASCII protocol manual)
WARNINGS = {
    "FF": "critical system error",
    "FN": "peripheral not supported",
    "FZ": "peripheral inactive",
    "FH": "hardware emergency stop",
    "FV": "overvoltage or undervoltage",
    "FO": "driver disabled by command",
    "FC": "current inrush error",
    "FM": "motor temperature error",
    "FD": "driver disabled",
    "FQ": "encoder error",
    "FI": "index error",
    "FA": "encoder synchronisation error",
    "FR": "overdrive limit exceeded",
    "FS": "stalled and stopped",
    "FB": "stream bounds error",
    "FP": "path deviation",
    "FE": "limit error",
    "FT": "excessive twist",
    "WL": "unexpected limit trigger",
    "WV": "voltage out of range",
    "WT": "controller temperature high",
    "WS": "stalled with recovery",
    "WM": "displaced when stationary",
    "WP": "invalid calibration type",
    "WR": "no reference position",
    "WH": "not homed",
    "NC": "manual control",
    "NI": "movement interrupted",
}
UNHOMED = frozenset({"WR", "WH"})
DRIVER_OFF = frozenset({"FD", "FO"})
_ALSO_FAULTS = frozenset({"WL", "NC"}) | UNHOMED
_MAX_LINE_BYTES = 256  # bytes of a line that are kept
_MESSAGE_IDS = 100  # message ids: two digits, 00 to 99 (Zaber ASCII protocol manual)
_ENDS = re.compile(rb"[\r\n]")
_CHECKSUM = re.compile(rb":([0-9A-F]{2})\Z")
_REPLY = re.compile(rb"@(\d\d) (\d)(?: (\d\d))? (OK|RJ) (BUSY|IDLE) (--|[A-Z0-9]{2})(?: ([\x20-\x7e]*))?\Z")


@dataclass(frozen=True, slots=True)
class Reply:
    """An answer to a command. `warning`: the gravest flag, empty for none; `data`: the reason if rejected."""

    device: int
    axis: int
    message_id: int | None
    accepted: bool
    busy: bool
    warning: str
    data: str


def lrc(body: bytes) -> int:
    """The checksum of the bytes between the first character and the colon."""
    return -sum(body) & 0xFF


def is_fault(flag: str) -> bool:
    """True for a flag that forbids motion: faults (F.), no reference, a limit, a hand at the knob."""
    return flag.startswith("F") or flag in _ALSO_FAULTS


def in_words(flag: str) -> str:
    return f"{flag} ({WARNINGS[flag]})" if flag in WARNINGS else flag


class CommandEncoder:
    """Commands to one device, with rolling message ids 00 to 99."""

    def __init__(self, device: int) -> None:
        self._device = device
        self._next = 0

    def encode(self, axis: int, text: str) -> tuple[int, bytes]:
        """Encodes a command with the next message id; returns (message id, line).

        Where the command ends in a number, ids are passed over until the checksum ends in a letter: if the
        colon is damaged or lost on the way, the line is no valid command with a longer number.
        """
        while True:
            message_id, self._next = self._next, (self._next + 1) % _MESSAGE_IDS
            body = f"{self._device} {axis} {message_id:02d}{' ' if text else ''}{text}"
            checksum = f"{lrc(body.encode('ascii')):02X}"
            if not text[-1:].isdigit() or checksum[1] in "ABCDEF":
                return message_id, f"/{body}:{checksum}\n".encode("ascii")


class Parser:
    """Bytes to replies; starts anywhere, drops what is damaged, never raises, holds at most a line.

    Attributes:
        checksums: whether a line without a checksum is dropped; one with a wrong checksum always is.
        dropped: what was: lines of `bad_checksum`, `malformed`, `overlong`; `noise`: bytes outside of lines.
    """

    def __init__(self, checksums: bool = True) -> None:
        self.checksums = checksums
        self.dropped: Counter[str] = Counter()
        self._partial = b""

    def feed(self, data: bytes) -> list[Reply]:
        """Returns the replies in the lines that are complete now; counts and drops damaged and long ones."""
        *lines, partial = _ENDS.split(self._partial + data)
        if len(partial) > _MAX_LINE_BYTES:
            self.dropped["overlong"] += 1
            partial = b""
        self._partial = partial
        return [reply for line in lines if line and (reply := self._reply(line)) is not None]

    def _reply(self, line: bytes) -> Reply | None:
        """Parses a line from the first `@` of a valid reply; counts what it drops. None: no reply."""
        if len(line) > _MAX_LINE_BYTES:
            self.dropped["overlong"] += 1
            return None
        starts = [match.start() for match in re.finditer(b"@", line)]
        if not starts:
            self.dropped["noise"] += len(line)
            return None
        reason = ""
        for start in starts:
            parsed = parse(line[start:], self.checksums)
            if not isinstance(parsed, str):
                self._skipped(line[:start], reason)
                return parsed
            reason = reason or parsed
        self.dropped[reason] += 1
        return None

    def _skipped(self, before: bytes, reason: str) -> None:
        if reason:
            self.dropped[reason] += 1
        elif before:
            self.dropped["noise"] += len(before)


def parse(line: bytes, checksums: bool) -> Reply | str:
    """Parses a line without its end; returns `bad_checksum` or `malformed` where it is no reply. `checksums`:
    a line without one is a bad one.
    """
    match = _CHECKSUM.search(line)
    if match is not None:
        body = line[: match.start()]
        if lrc(body[1:]) != int(match[1], 16):
            return "bad_checksum"
    elif checksums:
        return "bad_checksum"
    else:
        body = line
    reply = _REPLY.match(body)
    if reply is None:
        return "malformed"
    device, axis, message_id, flag, status, warning, data = reply.groups(b"")
    return Reply(
        int(device),
        int(axis),
        int(message_id) if message_id else None,
        flag == b"OK",
        status == b"BUSY",
        "" if warning == b"--" else warning.decode("ascii"),
        data.decode("ascii"),
    )
