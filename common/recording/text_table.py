"""Text tables as instruments, spreadsheets and people write them: CSV, TSV, columns of blanks."""

import csv
import io
import re
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import islice
from math import nan
from pathlib import Path
from typing import BinaryIO

import numpy as np

from forefeel.common.errors import RecordingError
from forefeel.common.recording.recording import Array, opened, reason_of

_HEAD_BYTES = 65_536  # in which delimiter, header and units are looked for
_MOST_HEAD_ROWS = 200  # that tell how the others are written
_DELIMITERS = ";", "\t", ",", "|"
_BLANK = " "
_COMMENTS = "#", "%", "//"
_MISSING = ["", "nan", "NaN", "NAN", "NA", "N/A", "n/a", "#N/A", "#NV", "null", "NULL", "None", "-", "--"]
_MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
_EXPONENT = r"([eE][-+]?\d+)?"
_KINDS = {
    "number": re.compile(r"[-+]?(\d+\.?\d*|\.\d+|inf)" + _EXPONENT),
    "comma": re.compile(r"[-+]?(\d+,\d*|,\d+)" + _EXPONENT),
    "date": re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?"),
    "zoned": re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?(Z|[-+]\d\d(:?\d\d)?)"),
    "clock": re.compile(r"\d\d:\d\d:\d\d(\.\d+)?"),
}
_UNIT = re.compile(r"[\[(]?[A-Za-zµμ°%][A-Za-z0-9µμ°%·*./^ ]{0,7}[\])]?|[\[(][\])]|-?")


@dataclass(frozen=True, slots=True)
class Layout:
    """Form of a text table. `first`: lines before its first row. `kinds`: of `_KINDS`, by column."""

    encoding: str
    delimiter: str
    decimal: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    kinds: tuple[str, ...]
    first: int


class TextTable:
    """Table in a text file, whose encoding, delimiter, decimal sign, header and row of units it finds out.

    Attributes:
        names: of the header; `1`, `2`, ... without one.
        units: from a row below the header, by name.
        notes: what of the file was left out.

    Raises:
        RecordingError: unreadable, or no table.
    """

    def __init__(
        self, path: Path, source: Callable[[Path], AbstractContextManager[BinaryIO]] = opened
    ) -> None:
        """`source`: opens the text; of a spreadsheet what it has been made into."""
        self._path, self._source = path, source
        with source(path) as file:
            self._layout = _layout(path, file.read(_HEAD_BYTES))
        self.names: Sequence[str] = self._layout.names
        self.units = dict(zip(self.names, self._layout.units, strict=True))
        timed = (name for name, kind in zip(self.names, self._layout.kinds, strict=True) if kind != "number")
        self.units |= dict.fromkeys(timed, "s")
        self.notes: list[str] = []

    def read(self, names: Sequence[str]) -> list[Array]:
        """Columns as float64, what is missing as NaN; dates in s since 1970, clocks in s since midnight. A
        last row that is cut off is left out, with a note.

        Raises:
            RecordingError: a cell that is none of these, with its row; a row too short that is not the last.
        """
        places = list(map(self.names.index, names))
        end = self._layout.delimiter
        empty = re.compile(rf"{re.escape(end)} *(?=[{re.escape(end)}\r\n])")
        try:
            # by numpy, which takes no empty cell, in a third of the time; of blanks none is an empty cell
            for filled in (False,) if end == _BLANK else (False, True):
                with suppress(ValueError), self._rows() as rows:
                    return self._numbers(
                        (empty.sub(f"{end}nan", row) for row in rows) if filled else rows, places
                    )
            with self._rows() as rows:  # a date, a comment, a row of another width, or no number
                return self._cells(rows, places)
        except (UnicodeError, csv.Error) as error:
            raise RecordingError(f"{self._path}: {reason_of(error)}, expected text") from error

    @contextmanager
    def _rows(self) -> Iterator[Iterator[str]]:
        """Context with the lines from the first row on; decimal commas are made points."""
        layout = self._layout
        with self._source(self._path) as file, io.TextIOWrapper(file, layout.encoding) as text:
            rows = islice(text, layout.first, None)
            yield (row.replace(",", ".") for row in rows) if layout.decimal == "," else rows

    def _numbers(self, rows: Iterator[str], places: Sequence[int]) -> list[Array]:
        """Reads the columns `places` by numpy, of a table with nothing but rows of equal width.

        Raises:
            ValueError: such a column is no numbers, a cell is missing, or a row has another width.
        """
        types = ["U1"] * len(self.names)  # of what is not wanted
        for i in places:
            if self._layout.kinds[i] != "number":
                raise ValueError(self.names[i])
            types[i] = "f8"
        table = np.loadtxt(
            rows,
            [(str(i), kind) for i, kind in enumerate(types)],
            delimiter=None if self._layout.delimiter == _BLANK else self._layout.delimiter,
            comments=None,
            quotechar='"',
            ndmin=1,
        )
        return [np.array(table[str(i)]) for i in places]

    def _cells(self, rows: Iterator[str], places: Sequence[int]) -> list[Array]:
        """Reads the columns `places` of any table, a cell at a time; errors and notes as of `read`."""
        delimiter, width = self._layout.delimiter, len(self.names)
        reader = map(str.split, rows) if delimiter == _BLANK else csv.reader(rows, delimiter=delimiter)
        columns = [array("d") for _ in places]
        short = ""
        for line, cells in enumerate(reader, self._layout.first + 1):
            if not cells or cells[0].lstrip().startswith(_COMMENTS):
                continue
            if short or len(cells) > width:
                short = short or f"line {line}: {len(cells)} cell(s), expected {width}"
                raise RecordingError(f"{self._path}: {short}")
            if len(cells) < width:
                short = f"line {line}: {len(cells)} cell(s), expected {width}"
                continue
            for i, column in zip(places, columns, strict=True):
                try:
                    column.append(_value(cells[i].strip(), self._layout.kinds[i]))
                except ValueError:
                    where = f"{self._path}: line {line}, column {self.names[i]!r}"
                    raise RecordingError(f"{where}: {cells[i][:40]!r}, expected a number") from None
        if short:
            self.notes.append("the last line, which is cut off")
        return [np.array(column) for column in columns]


def _value(cell: str, kind: str) -> float:
    """Number of a cell, NaN where it is missing; of a date s since 1970, of a clock s since midnight. Raises
    ValueError for other text.
    """
    if cell in _MISSING:
        return nan
    if kind == "number":
        return float(cell)
    moment = datetime.fromisoformat(f"1970-01-01T{cell}" if kind == "clock" else cell)
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def _layout(path: Path, head: bytes) -> Layout:
    """Finds encoding, delimiter, decimal mark, columns and first row by the first bytes of a file; raises
    RecordingError without a row of numbers.
    """
    encoding, text = _decoded(head)
    lines = [line.strip("\r") for line in re.split("\r\n|\n|\r", text)]
    if len(head) == _HEAD_BYTES:
        lines = lines[:-1]  # cut by us
    rows = [(number, line) for number, line in enumerate(lines) if line.strip()]
    if not rows:
        raise RecordingError(f"{path}: only blank lines, expected a table of time, position and force")
    data = [(n, line) for n, line in rows if not line.lstrip().startswith(_COMMENTS)]
    delimiter, width = _delimiter([line for _, line in data[-_MOST_HEAD_ROWS:]])
    cells = {number: _split(line.lstrip("#%/ "), delimiter) for number, line in rows}
    full = (n for n, _ in data if len(cells[n]) == width)
    first = next((n for n in full if any(p.fullmatch(c) for c in cells[n] for p in _KINDS.values())), None)
    if first is None:
        raise RecordingError(f"{path}: no row of numbers, expected a table of time, position and force")
    names, units = _header([cells[n] for n, _ in rows if n < first], width)
    body = [cells[n] for n, _ in data[-_MOST_HEAD_ROWS:] if n >= first and len(cells[n]) == width]
    kinds = [_kind([row[i] for row in body]) for i in range(len(names))]
    decimal = "." if "comma" not in kinds or delimiter == "," else ","
    kinds = ["number" if kind == "comma" else kind for kind in kinds]
    return Layout(encoding, delimiter, decimal, _distinct(names), tuple(units), tuple(kinds), first)


def _decoded(head: bytes) -> tuple[str, str]:
    """Encoding and text of a file's first bytes: by their byte order mark, else UTF-8, else Windows-1252."""
    for mark, encoding in _MARKS.items():
        if head.startswith(mark):
            return encoding, head.decode(encoding, "ignore")
    try:
        return "utf-8", head.decode() if len(head) < _HEAD_BYTES else head[: head.rfind(b"\n")].decode()
    except UnicodeDecodeError:
        return "cp1252", head.decode("cp1252", "replace")


def _delimiter(lines: Sequence[str]) -> tuple[str, int]:
    """Delimiter, the first that cuts more than half of the lines into equally many cells, at least two, and
    that number; a comma and 1 where none does.
    """
    for delimiter in (*_DELIMITERS, _BLANK):
        widths = Counter(len(_split(line, delimiter)) for line in lines)
        width = max(widths, key=widths.__getitem__, default=1)
        if width > 1 and 2 * widths[width] > len(lines):
            return delimiter, width
    return ",", 1


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter == _BLANK:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


def _kind(cells: Sequence[str]) -> str:
    """The kind (of `_KINDS`) of most cells that are there; "comma" where any has a decimal comma. "number"
    where none is there or most are text, which is refused when it is read.
    """
    kinds = Counter(
        next((kind for kind, pattern in _KINDS.items() if pattern.fullmatch(cell)), "text")
        for cell in cells
        if cell not in _MISSING
    )
    if kinds["comma"]:
        return "comma"
    ranking = kinds.most_common(1)
    return ranking[0][0] if ranking and ranking[0][0] != "text" else "number"


def _header(above: list[list[str]], width: int) -> tuple[list[str], list[str]]:
    """Names and units of `width` columns from the cells of the lines above the first row; a comment may be
    the header. A column without a name gets its number as name; without a row of units each unit is empty.
    """
    above = [c[1:] if len(c) == width + 1 and c[0].endswith(":") else c for c in above]  # columns: t x F
    lines = [cells for cells in above if len(cells) == width or len(cells) == width - 1]
    if not lines:
        return [str(i + 1) for i in range(width)], [""] * width
    *before, last = lines
    units = [""] * width
    if before and len(last) == width and all(_UNIT.fullmatch(cell) for cell in last) and any(last):
        units, last = last, before[-1]
    names = [*last, *([""] * (width - len(last)))]
    return [name or str(i + 1) for i, name in enumerate(names)], units


def _distinct(names: Sequence[str]) -> tuple[str, ...]:
    """Names, with the column's number added to each that stands twice."""
    twice = {name for name, times in Counter(names).items() if times > 1}
    return tuple(f"{name} {i + 1}" if name in twice else name for i, name in enumerate(names))
