"""Tables in the files of other programs: Parquet, spreadsheets, MATLAB, HDF5, LabVIEW's TDMS."""

import csv
import io
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from forefeel.common.errors import RecordingError
from forefeel.common.recording.recording import Array, opened, room_of
from forefeel.common.recording.text_table import TextTable

_ROWS_AT_ONCE = 65_536  # of a column that are decoded at once, 512 KiB as float64
_NANOSECONDS = {
    "timestamp": "timestamp[ns]", "duration": "duration[ns]", "time32": "time64[ns]", "time64": "time64[ns]",
}  # fmt: skip
_LEAST_ROWS = 20  # of a sheet that is taken for a recording: other sheets hold what was set
_MOST_ELEMENTS = 64  # of a list in each row that become columns


class ArrayTable:
    """Columns that are arrays already, loaded when they are read.

    Attributes: see `TextTable`.
    """

    def __init__(self, columns: Mapping[str, Callable[[], Array]], units: Mapping[str, str]) -> None:
        self._columns = columns
        self.names: Sequence[str] = tuple(columns)
        self.units = dict(units)
        self.notes: list[str] = []

    def read(self, names: Sequence[str]) -> list[Array]:
        """Columns as float64, what is missing as NaN."""
        return [self._columns[name]() for name in names]


@contextmanager
def reading(path: Path, what: str, package: str) -> Iterator[None]:
    """What a library raises in the body becomes one line; `package` may not be installed."""
    try:
        yield
    except RecordingError:
        raise
    except ImportError as error:
        needs = f"needs {package}: pip install 'forefeel[formats]'"
        raise RecordingError(f"{path}: reading {path.suffix} {needs}") from error
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RecordingError(f"{path}: {reason}, expected {what} that is whole") from error


def _require_room(path: Path, size: int, what: str = "") -> None:
    if size > (room := room_of(path)):
        raise RecordingError(f"{path}{what}: {size} bytes when unpacked, allowed {room}")


def table_of(columns: Any) -> ArrayTable:  # noqa: ANN401 - arrays by name, or a DataFrame of pandas
    """Arrays by name."""
    return ArrayTable(*_plain({str(name): np.asarray(columns[name]) for name in columns.keys()}))  # noqa: SIM118


def _plain(arrays: Mapping[str, Any]) -> tuple[dict[str, Callable[[], Array]], dict[str, str]]:
    """Numbers as float64, dates in s since 1970; the units of dates. Anything else is left out."""
    found, units = dict[str, Callable[[], Array]](), dict[str, str]()
    for name, values in arrays.items():
        if values.dtype.kind == "M":
            found[name] = _given(values.astype("datetime64[ns]").astype(np.int64) * 1e-9)
            units[name] = "s"
        elif values.dtype.kind in "iufb":
            found[name] = _given(values.astype(np.float64))
    return found, units


# --- spreadsheets ---


def spreadsheet(path: Path) -> TextTable:
    """The first sheet of an .xlsx with `_LEAST_ROWS` rows of numbers, or the first that is not empty.

    Raises:
        RecordingError: not installed, no spreadsheet, or one that unpacks to more than is allowed.
    """
    text, notes = _as_text(path)

    @contextmanager
    def source(_path: Path) -> Iterator[BinaryIO]:
        yield io.BytesIO(text)

    table = TextTable(path, source)
    table.notes += notes
    return table


def _as_text(path: Path) -> tuple[bytes, list[str]]:
    with reading(path, "a spreadsheet", "openpyxl"), opened(path) as file:
        import openpyxl  # noqa: PLC0415 - an extra

        _require_room(path, sum(part.file_size for part in zipfile.ZipFile(file).infolist()))
        book = openpyxl.load_workbook(file, read_only=True, data_only=True)
        first = ""
        for sheet in book.worksheets:
            written, numbers = io.StringIO(), 0
            rows = csv.writer(written, delimiter="\t")
            for row in sheet.iter_rows(values_only=True):
                rows.writerow(row)
                numbers += sum(isinstance(cell, int | float) for cell in row) > 1
            if numbers >= _LEAST_ROWS:
                return written.getvalue().encode(), [f"sheet {sheet.title!r}"] * (len(book.worksheets) > 1)
            first = first or written.getvalue()
    if not first:
        raise RecordingError(f"{path}: no cells, expected a table of time, position and force")
    return first.encode(), []


# --- Parquet ---


def parquet(path: Path) -> ArrayTable:
    """A Parquet file; lists in each row become a column an element.

    Raises:
        RecordingError: unreadable, or no Parquet file.
    """
    from pyarrow.parquet import ParquetFile  # noqa: PLC0415 - slow to import

    columns: dict[str, Callable[[], Array]] = {}
    units: dict[str, str] = {}
    with _arrow_file(path) as file:
        whole = ParquetFile(file)
        for field in whole.schema_arrow:
            kind = str(field.type)
            if "list" in kind:
                elements = _elements(whole, field.name)
                columns |= {f"{field.name}[{i}]": _reader(path, field.name, i) for i in range(elements)}
            elif not kind.startswith(("struct", "map", "binary")):
                columns[field.name] = _reader(path, field.name)
                units |= {field.name: "s"} if kind.startswith(("timestamp", "duration", "time")) else {}
    return ArrayTable(columns, units)


def _reader(path: Path, name: str, element: int | None = None) -> Callable[[], Array]:
    return lambda: _parquet_column(path, name, element)


def _elements(whole: Any, name: str) -> int:  # noqa: ANN401 - of pyarrow
    first = next(whole.iter_batches(1, columns=[name]), None)
    row = None if first is None or not len(first) else first.column(0)[0].as_py()
    return min(len(row), _MOST_ELEMENTS) if row and isinstance(row[0], int | float) else 0


def _parquet_column(path: Path, name: str, element: int | None) -> Array:
    """Read in batches, so that little but the column is held."""
    import pyarrow as arrow  # noqa: PLC0415 - slow to import
    from pyarrow import compute  # noqa: PLC0415
    from pyarrow.parquet import ParquetFile  # noqa: PLC0415

    with _arrow_file(path) as file:
        whole = ParquetFile(file, pre_buffer=False)
        metadata = whole.metadata
        groups = (metadata.row_group(i) for i in range(metadata.num_row_groups))
        chunks = (group.column(i) for group in groups for i in range(group.num_columns))
        packed = sum(each.total_uncompressed_size for each in chunks if each.path_in_schema.startswith(name))
        _require_room(path, max(8 * metadata.num_rows, packed), f", column {name!r}")
        parts = []
        for batch in whole.iter_batches(_ROWS_AT_ONCE, columns=[name], use_threads=False):
            column = batch.column(0)
            if element is not None:
                column = compute.list_element(column, element)
            kind = column.type
            if temporal := arrow.types.is_temporal(kind):
                column = column.cast(_NANOSECONDS[str(kind).partition("[")[0]]).cast("int64")
            values = column.cast("float64", safe=False).to_numpy(zero_copy_only=False)
            parts.append(values * 1e-9 if temporal else values)
    return np.concatenate(parts or [np.empty(0)])


@contextmanager
def _arrow_file(path: Path) -> Iterator[BinaryIO]:
    import pyarrow as arrow  # noqa: PLC0415 - slow to import

    with opened(path) as file:
        try:
            yield file
        except (arrow.ArrowException, OSError, ValueError) as error:
            raise RecordingError(f"{path}: {str(error).splitlines()[0]}, expected a Parquet file") from error


# --- MATLAB and HDF5 ---


def matlab(path: Path) -> ArrayTable:
    """The variables of a .mat that have equally many rows; version 7.3 is HDF5.

    Raises:
        RecordingError: unreadable, damaged, or no table in it.
    """
    from scipy.io import loadmat, whosmat  # noqa: PLC0415 - slow to import

    with opened(path) as file:
        if b"\x89HDF\r\n" in file.read(1024):
            return hdf5(path)
        with reading(path, "a MATLAB file", "scipy"):
            file.seek(0)
            sizes = [8 * int(np.prod(shape)) for _, shape, _ in whosmat(file)]
            _require_room(path, sum(sizes))
            file.seek(0)
            return _table(path, _flat(loadmat(file, simplify_cells=True)))


def hdf5(path: Path) -> ArrayTable:
    """The data sets of an HDF5 file that have equally many rows.

    Raises:
        RecordingError: not installed, unreadable, damaged, or no table in it.
    """
    found: dict[str, Array] = {}
    with reading(path, "an HDF5 file", "h5py"), opened(path):
        import h5py  # noqa: PLC0415 - an extra

        def take(name: str, item: Any) -> None:  # noqa: ANN401 - of h5py
            if isinstance(item, h5py.Dataset) and item.dtype.kind in "iuf" and not name.startswith("#"):
                _require_room(path, sum(each.nbytes for each in found.values()) + 8 * item.size)
                found[name.replace("/", ".")] = item[()]

        with h5py.File(path) as file:
            file.visititems(take)
    return _table(path, found)


def _flat(variables: Mapping[str, Any], head: str = "") -> dict[str, Array]:
    found: dict[str, Array] = {}
    for name, value in variables.items():
        if isinstance(value, Mapping):
            found |= _flat(value, f"{head}{name}.")
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
            found[head + name] = value
    return found


def _table(path: Path, found: Mapping[str, Array], units: Mapping[str, str] | None = None) -> ArrayTable:
    """Of the arrays those of the usual length, a matrix as its columns."""
    columns: dict[str, Array] = {}
    for name, value in found.items():
        values = np.squeeze(value).astype(np.float64)
        if values.ndim == 2 and min(values.shape) <= _MOST_ELEMENTS:
            rows = values if values.shape[0] < values.shape[1] else values.T
            columns |= {f"{name}[{i}]": np.ascontiguousarray(row) for i, row in enumerate(rows)}
        elif values.ndim == 1:
            columns[name] = values
    lengths = Counter(len(values) for values in columns.values() if len(values) > 1)
    if not lengths:
        raise RecordingError(f"{path}: no arrays of numbers, expected time, position and force")
    usual = max(lengths, key=lambda length: (lengths[length], length))
    kept = {name: values for name, values in columns.items() if len(values) == usual}
    return ArrayTable({name: _given(values) for name, values in kept.items()}, units or {})


def _given(values: Array) -> Callable[[], Array]:
    return lambda: values


# --- TDMS ---


def tdms(path: Path) -> ArrayTable:
    """The channels of a LabVIEW file that have equally many samples, and the time of a waveform.

    Raises:
        RecordingError: not installed, unreadable, damaged, or no table in it.
    """
    with reading(path, "a TDMS file", "npTDMS"), opened(path) as raw:
        from nptdms import TdmsFile  # noqa: PLC0415 - an extra

        file = TdmsFile.open(raw)
        channels = [channel for group in file.groups() for channel in group.channels()]
        _require_room(path, sum(8 * len(channel) for channel in channels))
        lengths = Counter(map(len, channels))
        usual = max(lengths, key=lambda length: (lengths[length], length), default=0)
        channels = [channel for channel in channels if len(channel) == usual]
        names = Counter(channel.name for channel in channels)
        step_s = channels[0].properties.get("wf_increment") if channels else None
        found: dict[str, Any] = {"time_s": np.arange(usual) * float(step_s)} if step_s else {}
        units = dict[str, str]()
        for channel in channels:
            name = channel.name if names[channel.name] == 1 else f"{channel.group_name}/{channel.name}"
            values = np.asarray(channel[:])
            units[name] = str(channel.properties.get("unit_string", ""))
            if values.dtype.kind == "M":
                values, units[name] = values.astype("datetime64[ns]").astype(np.int64) * 1e-9, "s"
            if values.dtype.kind in "iuf":
                found[name] = values
    return _table(path, found, units)
