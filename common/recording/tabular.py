"""Import of recordings from CSV and Parquet tables of named columns of numbers, and from MCAP files."""

import csv
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from forefeel.common.errors import RecordingError
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.recording.recording import Array, Recording, check_samples, opened, room_of
from forefeel.common.recording.units import Mapping

_SHOWN_CHARACTERS = 40  # characters of a bad cell that an error shows
_LONGEST_HEADER = 65_536  # bytes that are read as a header
_BUFFER_BYTES = 65_536  # bytes that a Parquet file is read by
_ROWS_AT_ONCE = 65_536  # rows of a column that are decoded at once, 512 KiB as float64


class CsvTable:
    """A CSV file: UTF-8 with or without BOM, any line end, comma, semicolon or tab, one header line.

    Blank lines are skipped. A file of nothing but numbers is parsed as a block; any other, cell by cell.

    Raises:
        RecordingError: unreadable, not UTF-8, no header, or a line with more or fewer cells than the header.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._block = _block(path)
        if self._block is None:
            self._read_cells()
        else:
            self.names: Sequence[str] = self._block[0]

    def _read_cells(self) -> None:
        path = self._path
        lines = [(number, line) for number, line in enumerate(_lines(path), 1) if line.strip()]
        if not lines:
            raise RecordingError(f"{path}: only blank lines, expected a header line with column names")
        self._line_numbers, rows = _split(path, lines)
        self.names = [cell.strip() for cell in rows[0]]
        self._rows = rows[1:]
        if all(_is_number(cell) for cell in self.names):
            raise RecordingError(f"{self.where(-1)}: numbers, expected a header line with column names")
        self._check_widths()

    def numbers(self, name: str) -> Array:
        """One column as float64.

        Raises:
            RecordingError: a value that is no number.
        """
        column = self.names.index(name)
        if self._block is not None:
            return np.asarray(self._block[1][column])
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
        if self._block is not None:
            self._block = None
            self._read_cells()
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
        self._path, self._arrow = path, pyarrow
        self._schema: Any = self._read(pyarrow.parquet.read_schema)
        self.names: Sequence[str] = self._schema.names

    def numbers(self, name: str) -> Array:
        """One column as float64, nulls as NaN; read in batches, so that little but the column is held."""
        kind = self._schema.field(name).type
        types = self._arrow.types
        if not (types.is_integer(kind) or types.is_floating(kind)):
            raise RecordingError(f"{self._path}, column {name!r}: holds {kind}, expected numbers")
        values = self._read(lambda file: self._batches(file, name))
        values.flags.writeable = False
        return np.asarray(values)

    def _batches(self, file: BinaryIO, name: str) -> Array:
        parquet = self._arrow.parquet.ParquetFile(file, pre_buffer=False, buffer_size=_BUFFER_BYTES)
        self._require_room(parquet.metadata, name)
        values, at = np.empty(parquet.metadata.num_rows), 0
        for batch in parquet.iter_batches(_ROWS_AT_ONCE, columns=[name], use_threads=False):
            values[at : at + len(batch)] = batch.column(0).to_numpy(zero_copy_only=False)
            at += len(batch)
        self._arrow.default_memory_pool().release_unused()
        return values

    def _require_room(self, metadata: Any, name: str) -> None:  # noqa: ANN401 - of pyarrow
        place, room = self._schema.names.index(name), room_of(self._path)
        pieces = (metadata.row_group(group).column(place) for group in range(metadata.num_row_groups))
        size = max(
            metadata.num_rows * np.dtype(np.float64).itemsize, sum(p.total_uncompressed_size for p in pieces)
        )
        if size > room:
            raise RecordingError(f"{self._path}, column {name!r}: {size} bytes when unpacked, allowed {room}")

    def _read(self, read: Callable[[BinaryIO], Any]) -> Any:  # noqa: ANN401 - of pyarrow, which has no types
        with opened(self._path) as file:
            try:
                return read(file)
            except (self._arrow.ArrowException, OSError, ValueError) as error:
                reason = str(error).splitlines()[0]
                raise RecordingError(f"{self._path}: {reason}, expected a Parquet file") from error

    def where(self, index: int) -> str:
        """The file and the row, counted from 1."""
        return f"{self._path}: row {index + 1}"


def _block(path: Path) -> tuple[list[str], Array] | None:
    """Names and columns, shape (columns, n), of a file that starts with its header and holds numbers only.

    None for any other, which is then read cell by cell, so that an error can name its place.
    """
    try:
        with opened(path) as file:
            header = file.readline(_LONGEST_HEADER).decode("utf-8-sig")
            delimiter = max(",;\t", key=header.count)
            names = [cell.strip() for cell in header.split(delimiter)]
            if '"' in header or "\r" in header[:-2] or any(map(_is_number, names)) or "" in names:
                return None
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # no rows: said by who needs them
                rows = np.loadtxt(file, np.float64, None, delimiter, ndmin=2, encoding="utf-8")
    except (ValueError, UnicodeDecodeError):
        return None
    if not len(rows) or rows.shape[1] != len(names):
        return None
    columns = np.ascontiguousarray(rows.T)
    columns.flags.writeable = False
    return names, columns


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


_TABLES: dict[str, type[CsvTable] | type[ParquetTable]] = {".csv": CsvTable, ".parquet": ParquetTable}


def load_recording(path: Path, mapping: Mapping | None = None, axis: str | None = None) -> Recording:
    """The recording in a .csv, .parquet or .mcap file.

    Without `mapping` a table has the columns `time_s`, `position_m` and, where it was measured, `force_n`.
    `axis` chooses one of an MCAP file; it may be left out when there is only one.

    Raises:
        RecordingError: one line that says where, which value, and what was expected.
    """
    suffix = path.suffix.lower()
    if suffix == ".mcap":
        if mapping is not None:
            raise RecordingError(
                f"{path}: a column mapping was given, expected one for .csv or .parquet only"
            )
        return Run(path).to_recording(axis)
    if suffix not in _TABLES:
        raise RecordingError(f"{path}: suffix {suffix!r}, expected .csv, .parquet or .mcap")
    table = _TABLES[suffix](path)
    if mapping is None:
        mapping = Mapping(force="N:force_n" if "force_n" in table.names else None)
    return _from_table(table, mapping, path)


def _from_table(table: CsvTable | ParquetTable, mapping: Mapping, path: Path) -> Recording:
    columns = mapping.columns()
    for name, _ in columns:
        _check_column(table, name, path)
    # checked before the conversion: an error shows the values as the file has them
    raw = {name: table.numbers(name) for name, _ in columns}
    check_samples(raw, str(path), table.where)
    time_s, position_m, *force_n = (
        raw[name] * to_si if to_si != 1.0 else raw[name] for name, to_si in columns
    )
    return Recording(path.stem, time_s, position_m, force_n[0] if force_n else None, source=str(path))


def _check_column(table: CsvTable | ParquetTable, name: str, path: Path) -> None:
    found = list(table.names).count(name)
    if found == 0:
        raise RecordingError(f"{path}: no column {name!r}, it has {', '.join(map(repr, table.names))}")
    if found > 1:
        raise RecordingError(f"{path}: {found} columns are named {name!r}, expected one")
