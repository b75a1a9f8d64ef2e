"""CSV and Parquet files as tables of named columns of numbers."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from common.errors import RecordingError
from common.recording.recording import Array, opened

_SHOWN_CHARACTERS = 40


class Table(Protocol):
    """Columns by name; `where` names the place of a sample in the file, for errors."""

    @property
    def names(self) -> Sequence[str]:
        """The columns in the order of the file."""
        ...

    def numbers(self, name: str) -> Array:
        """One column as float64, what is missing as NaN; RecordingError for a value that is no number."""
        ...

    def where(self, index: int) -> str:
        """The file and the line or row of a sample."""
        ...


class CsvTable:
    """A CSV file: UTF-8 with or without BOM, any line end, comma, semicolon or tab, one header line.

    Blank lines are skipped.

    Raises:
        RecordingError: unreadable, not UTF-8, no header, or a line with more or fewer cells than the header.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        lines = [(number, line) for number, line in enumerate(_lines(path), 1) if line.strip()]
        if not lines:
            raise RecordingError(f"{path}: only blank lines, expected a header line with column names")
        self._line_numbers, rows = _split(path, lines)
        self.names: Sequence[str] = [cell.strip() for cell in rows[0]]
        self._rows = rows[1:]
        if all(_is_number(cell) for cell in self.names):
            raise RecordingError(f"{self.where(-1)}: numbers, expected a header line with column names")
        self._check_widths()

    def numbers(self, name: str) -> Array:
        """One column as float64."""
        column = self.names.index(name)
        try:
            return np.array([float(row[column]) for row in self._rows], dtype=np.float64)
        except ValueError:
            index, text = next((i, r[column]) for i, r in enumerate(self._rows) if not _is_number(r[column]))
            shown = text[:_SHOWN_CHARACTERS]
            raise RecordingError(
                f"{self.where(index)}, column {name!r}: {shown!r}, expected a number"
            ) from None

    def where(self, index: int) -> str:
        """The file and the line; -1 is the header."""
        return f"{self._path}: line {self._line_numbers[index + 1]}"

    def _check_widths(self) -> None:
        expected = len(self.names)
        for index, row in enumerate(self._rows):
            if len(row) != expected:
                raise RecordingError(
                    f"{self.where(index)}: {len(row)} cell(s), expected {expected} as in the header"
                )


class ParquetTable:
    """A Parquet file; needs the extra `forefeel[parquet]`.

    Raises:
        RecordingError: pyarrow is not installed, unreadable, or no Parquet file.
    """

    def __init__(self, path: Path) -> None:
        try:
            import pyarrow  # noqa: PLC0415 - optional, and slow to import
            import pyarrow.parquet  # noqa: PLC0415
        except ImportError as error:
            raise RecordingError(
                f"{path}: reading Parquet needs pyarrow: pip install forefeel[parquet]"
            ) from error
        self._path = path
        with opened(path) as file:
            try:
                self._table: Any = pyarrow.parquet.read_table(file)
            except (pyarrow.ArrowException, OSError) as error:
                reason = str(error).splitlines()[0]
                raise RecordingError(f"{path}: {reason}, expected a Parquet file") from error
        self.names: Sequence[str] = self._table.column_names

    def numbers(self, name: str) -> Array:
        """One column as float64, nulls as NaN."""
        column = self._table.column(name).to_numpy()
        if column.dtype.kind not in "iuf":
            kind = self._table.schema.field(name).type
            raise RecordingError(f"{self._path}, column {name!r}: holds {kind}, expected numbers")
        return np.asarray(column, dtype=np.float64)

    def where(self, index: int) -> str:
        """The file and the row, counted from 1."""
        return f"{self._path}: row {index + 1}"


def _lines(path: Path) -> list[str]:
    with opened(path) as file:
        content = file.read()
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: byte {error.start} is not UTF-8, expected text in UTF-8") from error
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _split(path: Path, lines: list[tuple[int, str]]) -> tuple[list[int], list[list[str]]]:
    header = lines[0][1]
    reader = csv.reader((f"{line}\n" for _, line in lines), delimiter=max(",;\t", key=header.count))
    numbers, rows = [], []
    try:
        for row in reader:
            rows.append(row)
            numbers.append(lines[reader.line_num - 1][0])  # a quoted cell may span lines
    except csv.Error as error:
        raise RecordingError(
            f"{path}: line {lines[reader.line_num - 1][0]}: {error}, expected CSV"
        ) from error
    return numbers, rows


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
