"""Load cells that print one number a line. Pure.

`newton`: any cell; `millipound_force`: Loadstar iLoad (`O0W1` and a carriage return ask for one reading);
`counts`: an HX711 behind a microcontroller, as its usual sketches print it, with or without a label
(`HX711 reading: 8400`).

The lines carry no checksum: a digit that became another digit on the wire can not be told from a measurement.
"""

import re
from collections import Counter
from typing import Literal, NamedTuple

Unit = Literal["newton", "millipound_force", "counts"]

NEWTON_PER_UNIT = {"newton": 1.0, "millipound_force": 4.4482216152605e-3}  # counts need a calibration
COUNTS_RANGE = -(1 << 23), (1 << 23) - 1  # where the 24 bit of an HX711 end: at either end it is overrange

# bytes of a line that may be a number: label, number and unit take at most 57 (`_LINE`), blanks not counted
_MAX_LINE_BYTES = 64
_ENDS = re.compile(rb"[\r\n]+")
_LINE = re.compile(
    rb"(?:[A-Za-z][\w ]{0,30}[:=])?[ \t]*([-+]?\d{1,12}(?:\.\d{0,9})?)[ \t]*(N?)[ \t]*", re.ASCII
)


class AsciiReading(NamedTuple):
    """A number in the unit of the cell, and how many bytes its line had, the end (CR LF) included."""

    number: float
    size: int


class LineParser:
    """Bytes in, numbers out, in the unit of the cell.

    What stands before the first line end is cut in the middle, and dropped.

    Attributes:
        counters: `lines` (that were numbers), `junk_lines`, `junk_bytes` (all that belonged to no number).
    """

    def __init__(self, unit: Unit, counters: Counter[str] | None = None) -> None:
        self.counters = Counter[str]() if counters is None else counters
        self._unit = unit
        self._buffer = bytearray()
        self._skipping = True  # until the next line end

    def begin(self) -> None:
        """Drops what has come: the next byte begins a line, the answer to a request."""
        self._buffer.clear()
        self._skipping = False

    def feed(self, data: bytes) -> list[AsciiReading]:
        """Returns the numbers of the lines that are complete now, oldest first; counts and drops others."""
        self._buffer += data
        *lines, rest = _ENDS.split(self._buffer)
        readings = [
            AsciiReading(number, len(line) + 2)
            for line in lines
            if (number := self._number(bytes(line))) is not None
        ]
        if len(rest) > _MAX_LINE_BYTES:
            self.counters["junk_bytes"] += len(rest)
            self._skipping, rest = True, bytearray()
        self._buffer = bytearray(rest)
        return readings

    def _number(self, line: bytes) -> float | None:
        """Returns the number in a line, and counts the line; None for one that is cut, too long, or no
        number. None for an empty line too, which is not counted.
        """
        skipping, self._skipping = self._skipping, False
        if not line and not skipping:
            return None
        number = None if skipping or len(line) > _MAX_LINE_BYTES else parse_line(line, self._unit)
        if number is None:
            self.counters["junk_lines"] += 1
            self.counters["junk_bytes"] += len(line)
        else:
            self.counters["lines"] += 1
        return number


def parse_line(line: bytes, unit: Unit) -> float | None:
    """The number of a line without its end; None when it is none, or names another unit."""
    match = _LINE.fullmatch(line)
    if match is None or (match[2] and unit != "newton"):
        return None
    return float(match[1])


def encode_line(number: float, unit: Unit) -> bytes:
    """A line as the cells of that unit print it."""
    return b"%.4f\r\n" % number if unit == "newton" else b"%d\r\n" % round(number)
