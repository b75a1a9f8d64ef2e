"""Tables in the files of other programs: Parquet, spreadsheets, numpy, MATLAB, HDF5, LabVIEW's TDMS."""

import csv
import io
import json
import struct
import warnings
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from forefeel.common.errors import RecordingError
from forefeel.common.recording.recording import Array, opened, reason_of, require_room, room_of, unpacked
from forefeel.common.recording.text_table import TextTable

_ROWS_AT_ONCE = 65_536  # of a column that are decoded at once, 512 KiB as float64
_NANOSECONDS = {
    "timestamp": "timestamp[ns]", "duration": "duration[ns]", "time32": "time64[ns]", "time64": "time64[ns]",
}  # fmt: skip
_CELL_BYTES = 8  # of a number in a spreadsheet, and at most of an empty cell
_PART_WEIGHT = 16  # bytes in memory for a byte of styles or texts (17 to 120 measured with openpyxl 3.1)
_LEAST_ROWS = 20  # of a sheet that is taken for a recording: other sheets hold what was set
_MOST_DEFLATED = 1032  # bytes that one byte of zlib may unpack to (zlib's technical details)
_MATRIX, _COMPRESSED = 14, 15  # kinds of elements of a MAT-file
_TEXTS = {1: 0, 2: 2, 3: 3}  # elements before the matrices in a cell, a structure, an object; the last: names
_OPAQUE = 17  # class of a matrix without dimensions
_OBJECT_BYTES = 128  # of an empty array of numpy
_LISTS = "list", "large_list", "fixed_size_list"
_MOST_ELEMENTS = 64  # of a list in each row that become columns
_INFO = Path("meta/info.json")  # of a data set of LeRobot, with the names of what its lists hold


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
    """Context that turns any other exception into a RecordingError and ignores warnings. Its text says that
    `what` was expected, or for an ImportError to install `package`.
    """
    try:
        with warnings.catch_warnings(action="ignore"):
            yield
    except RecordingError:
        raise
    except ImportError as error:
        needs = f"needs {package}: pip install 'forefeel[formats]'"
        raise RecordingError(f"{path}: reading {path.suffix} {needs}") from error
    except Exception as error:
        raise RecordingError(f"{path}: {reason_of(error)}, expected {what} that is whole") from error


def table_of(source: Any, *beside: Any) -> ArrayTable:  # noqa: ANN401 - see `load`
    """Table of the numeric, boolean and date columns of a data frame, mapping or structured array; others are
    left out. Without names: of the arrays `source` and `beside`, or the columns of one matrix, taken as
    time, position and, if there, force. Raises RecordingError for any other input.
    """
    names = next((names for of in _NAMES if (names := of(source)) is not None), None)
    if names is not None and not beside:
        arrays = {str(name): np.asarray(source[name]) for name in names}
    else:
        arrays = _without_names(source, *beside)
    dates = {name: "s" for name, values in arrays.items() if values.dtype.kind == "M"}
    usable = {name: values for name, values in arrays.items() if values.dtype.kind in "iufbM"}
    return ArrayTable({name: partial(_floats, values) for name, values in usable.items()}, dates)


_SI = "time_s", "position_m", "force_N"
# of columns: of a table of pyarrow, a DataFrame of pandas or polars, a mapping, a structured array
_NAMES: tuple[Callable[[Any], Iterable[Any] | None], ...] = (
    lambda source: getattr(source, "column_names", None),
    lambda source: getattr(source, "columns", None),
    lambda source: source.keys() if isinstance(source, Mapping) else None,
    lambda source: source.dtype.names if isinstance(source, np.ndarray) else None,
)


def _without_names(source: Any, *beside: Any) -> dict[str, Any]:  # noqa: ANN401 - see `load`
    """Two or three equally long arrays, or the columns of a matrix, by the names `time_s`, `position_m` and
    `force_N`, in this order. Raises RecordingError for other shapes.
    """
    try:
        columns = np.stack([source, *beside]) if beside else np.asarray(source, np.float64).T
        if columns.ndim == 2 and 2 <= len(columns) <= len(_SI):
            return dict(zip(_SI, columns.astype(np.float64), strict=False))
        shapes = f"arrays of shape {columns.T.shape}"
    except (TypeError, ValueError):
        shapes = type(source).__name__ + (" and others, or of other shapes" if beside else "")
    wanted = "a file, columns by name, or time in s, position in m and force in N of equal length"
    raise RecordingError(f"data: {shapes}, expected {wanted}")


def _floats(values: Any) -> Array:  # noqa: ANN401 - numbers, or dates of any unit
    """Numbers as float64, dates in s since 1970, NaN for what is no date."""
    if values.dtype.kind == "M":
        seconds = values.astype("datetime64[ns]").astype(np.int64) * 1e-9
        values = np.where(np.isnat(values), np.nan, seconds)
    numbers: Array = values.astype(np.float64)
    return numbers


# --- spreadsheets ---


def spreadsheet(path: Path) -> TextTable:
    """Table of the first sheet of an .xlsx with 20 rows of numbers, else of the first that is not empty.

    Raises:
        RecordingError: not installed, no spreadsheet, or one that unpacks to more than is allowed.
    """
    text, notes = _as_text(path)
    table = TextTable(path, lambda _: io.BytesIO(text))
    table.notes += notes
    return table


def _as_text(path: Path) -> tuple[bytes, list[str]]:
    """The first sheet in which 20 rows hold two numbers or more, as text with tabs, and a note on it where
    there are several; else the first with cells. Raises RecordingError: no cells, unreadable, too large.
    """
    with reading(path, "a spreadsheet", "openpyxl"), opened(path) as file:
        import openpyxl  # noqa: PLC0415 - an extra

        parts = zipfile.ZipFile(file).infolist()
        weights = (1 if part.filename.startswith("xl/worksheets/") else _PART_WEIGHT for part in parts)
        require_room(path, sum(part.file_size * weight for part, weight in zip(parts, weights, strict=True)))
        book = openpyxl.load_workbook(file, read_only=True, data_only=True)
        first, size = "", 0
        for sheet in book.worksheets:
            sheet.reset_dimensions()  # each row would be filled up to the size that the sheet states
            written, numbers = io.StringIO(), 0
            rows = csv.writer(written, delimiter="\t")
            for row in sheet.iter_rows(values_only=True):
                size += sum(len(cell) if isinstance(cell, str) else _CELL_BYTES for cell in row) + 2
                require_room(path, size)  # a text that thousands of cells share is in the file once
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
    """Table of a Parquet file, or of the folder of a LeRobot data set; a column is read when it is asked for.
    Lists become a column an element, `name[i]`, or `name.word` where the data set names it; structs, maps and
    binary columns are left out. Each episode of a data set begins 1 s after the last one ends.

    Raises:
        RecordingError: unreadable, or no Parquet file.
    """
    columns: dict[str, Callable[[], Array]] = {}
    units: dict[str, str] = {}
    files = sorted(path.glob("data/**/*.parquet")) if is_data_set(path) else [path]
    first = next(iter(files), path / "data")  # where there is none, that is what is said
    words = _words_of_lists(first)
    with reading(first, "a Parquet file", "pyarrow"), opened(first) as file:
        from pyarrow.parquet import ParquetFile  # noqa: PLC0415 - slow to import, and an extra

        whole = ParquetFile(file)
        for field in whole.schema_arrow:
            kind = str(field.type)
            if kind.startswith(_LISTS):
                for i in range(_elements(first, whole, field)):
                    word = dict(enumerate(words.get(field.name, []))).get(i)
                    name = f"{field.name}[{i}]" if word is None else f"{field.name}.{word}"
                    columns[name] = partial(_parquet_column, files, field.name, i)
            elif not kind.startswith(("struct", "map", "binary")):
                columns[field.name] = partial(_parquet_column, files, field.name)
                units |= {field.name: "s"} if kind.startswith(("timestamp", "duration", "time")) else {}
    table = ArrayTable(columns, units)
    if {"timestamp", "episode_index"} <= set(columns):
        stamps_s, episode = table.read(["timestamp", "episode_index"])
        begins = np.flatnonzero(np.diff(episode)) + 1
        for begin in begins:
            stamps_s[begin:] += stamps_s[begin - 1] + 1.0 - stamps_s[begin]
        columns["timestamp"], table.units["timestamp"] = lambda: stamps_s, "s"
        table.notes += [f"{len(begins) + 1} episodes, taken as runs 1 s apart"] * (len(begins) > 0)
    return table


def is_data_set(path: Path) -> bool:
    """True for the folder of a LeRobot data set."""
    return (path / _INFO).is_file()


def _words_of_lists(path: Path) -> dict[str, list[str]]:
    """Names of the elements of each list column of the LeRobot data set that holds the file; else empty."""
    info = next((parent / _INFO for parent in path.absolute().parents[:4] if is_data_set(parent)), None)
    if info is None:
        return {}
    with reading(info, "names of a LeRobot data set", ""), opened(info) as file:
        words = {name: feature.get("names") for name, feature in json.load(file)["features"].items()}
        lists = {name: next(iter(w.values()), []) if isinstance(w, dict) else w for name, w in words.items()}
        return {name: list(map(str, w)) for name, w in lists.items() if isinstance(w, list)}


def _elements(path: Path, whole: Any, field: Any) -> int:  # noqa: ANN401 - of pyarrow
    """Length of the first list in a column, at most `_MOST_ELEMENTS`; 0: no numbers, no row, or null.
    `whole`: the open ParquetFile; `field`: the list column of its schema. Raises RecordingError if too large.
    """
    from pyarrow import types  # noqa: PLC0415

    if not (types.is_integer(field.type.value_type) or types.is_floating(field.type.value_type)):
        return 0
    _require_column(path, whole.metadata, field.name)
    first = next(whole.iter_batches(1, columns=[field.name]), None)
    row = None if first is None or not len(first) else first.column(0)[0].values
    return 0 if row is None else min(len(row), _MOST_ELEMENTS)


def _require_column(path: Path, metadata: Any, name: str) -> None:  # noqa: ANN401 - of pyarrow
    """Raises RecordingError for a Parquet column that unpacks to more than `room_of` allows, at 8 bytes a
    value at least: one stored zero may stand for many. `metadata`: of the file; columns below `name` count.
    """
    groups = (metadata.row_group(i) for i in range(metadata.num_row_groups))
    chunks = (group.column(i) for group in groups for i in range(group.num_columns))
    sizes = (
        max(chunk.total_uncompressed_size, 8 * chunk.num_values)
        for chunk in chunks
        if f"{chunk.path_in_schema}.".startswith(f"{name}.")
    )
    require_room(path, sum(sizes), f", column {name!r}")


def _parquet_column(files: Sequence[Path], name: str, element: int | None = None) -> Array:
    """Reads a column, or that element of its lists, as float64; what is missing is NaN, times are in s. In
    batches, so that little but the column is held. Raises RecordingError: too large, or no numbers.
    """
    import pyarrow as arrow  # noqa: PLC0415 - slow to import
    from pyarrow import compute  # noqa: PLC0415
    from pyarrow.parquet import ParquetFile  # noqa: PLC0415

    parts = []
    for path in files:
        with reading(path, "a Parquet file", "pyarrow"), opened(path) as file:
            # a text that thousands of rows share is read once
            whole = ParquetFile(file, pre_buffer=False, read_dictionary=[name] * (element is None))
            _require_column(path, whole.metadata, name)
            for batch in whole.iter_batches(_ROWS_AT_ONCE, columns=[name], use_threads=False):
                column = batch.column(0)
                if element is not None:
                    column = compute.list_element(column, element)
                if arrow.types.is_dictionary(column.type):
                    column = column.dictionary.cast("float64", safe=False).take(column.indices)
                kind = column.type
                if temporal := arrow.types.is_temporal(kind):
                    column = column.cast(_NANOSECONDS[str(kind).partition("[")[0]]).cast("int64")
                values = column.cast("float64", safe=False).to_numpy(zero_copy_only=False)
                parts.append(values * 1e-9 if temporal else values)
    return np.concatenate(parts or [np.empty(0)])


# --- numpy, MATLAB and HDF5 ---


def numpy_archive(path: Path) -> ArrayTable:
    """Table of those numeric and date arrays of an .npz that have the most common number of rows; arrays of
    Python objects (they could run code) are left out. Raises RecordingError: unreadable, too large, no table.
    """
    arrays: dict[str, Any] = {}
    with opened(path) as file, reading(path, "a file of numpy.savez", ""):
        require_room(path, sum(part.file_size for part in zipfile.ZipFile(file).infolist()))
        archive = np.load(file, allow_pickle=False)
        for name in archive.files:
            with suppress(ValueError):
                arrays[name] = np.asarray(archive[name])  # of a member that is no array the bytes
    return _table(path, {name: values for name, values in arrays.items() if values.dtype.kind in "iufM"})


def matlab(path: Path) -> ArrayTable:
    """Table of those numeric variables of a .mat that have the most common number of rows; variables in
    structures have dotted names. Version 7.3 is read as HDF5.

    Raises:
        RecordingError: unreadable, damaged, or no table in it.
    """
    from scipy.io import loadmat  # noqa: PLC0415 - slow to import

    with opened(path) as file:
        if b"\x89HDF\r\n" in file.read(1024):
            return hdf5(path)
        with reading(path, "a MATLAB file", "scipy"):
            file.seek(0)
            _require_matlab_room(path, file)
            file.seek(0)
            notes = list[str]()
            variables = _flat(loadmat(file, simplify_cells=True), notes)
    table = _table(path, variables)
    table.notes += notes
    return table


def _require_matlab_room(path: Path, file: BinaryIO) -> None:
    """Raises RecordingError where the variables of level 5, with what cells and structures hold, would take
    too much memory. Reads the open file to its end, from element to element (MAT-File Format, MathWorks,
    chapter 1), whatever length a matrix states, as scipy does. A file of level 4 passes without a check.
    """
    head, size = file.read(128), 0
    if 0 in head[:4]:  # of level 4, which packs nothing
        return
    order = "<" if head[126:] == b"IM" else ">"
    while tag := file.read(8):
        kind, length = struct.unpack(f"{order}II", tag)
        data = file.read(length)
        data = unpacked(path, zlib.decompressobj, data) if kind == _COMPRESSED else tag + data
        size += _memory(memoryview(data), order)
        require_room(path, size)


def _memory(data: memoryview, order: str) -> int:
    """Bytes of memory that scipy takes for the elements in `data`, with what cells and structures hold.
    `data`: whole elements of level 5, not compressed; `order`: of their bytes, `<` or `>`.
    """
    words, at, size = struct.Struct(f"{order}II"), 0, 0

    def element() -> tuple[int, memoryview]:
        """Kind and bytes of the element at `at`; moves `at` behind it, of a matrix only behind its tag."""
        nonlocal at
        kind, length = words.unpack_from(data, at)
        if small := kind >> 16:  # up to four bytes stand in the tag itself
            at += 8
            return kind & 0xFFFF, data[at - 4 : at - 4 + small]
        body = data[at + 8 : at + 8 + length]
        at += 8 if kind == _MATRIX else 8 + length + -length % 8
        return kind, body

    while at + 8 <= len(data):
        kind, body = element()
        size += _OBJECT_BYTES if kind == _MATRIX else len(body)
        if kind != _MATRIX or not body:
            continue
        flags, _ = words.unpack_from(data, at + 8)
        at += 16
        if (of := flags & 0xFF) == _OPAQUE:
            continue
        _, dimensions = element()
        count = prod(struct.unpack(f"{order}{len(dimensions) // 4}I", dimensions))
        texts = [element()[1] for _ in range(1 + _TEXTS.get(of, 0))]
        size += count * (_OBJECT_BYTES + 8 * len(texts[-1]) if of in _TEXTS else 8)
    return size


def hdf5(path: Path) -> ArrayTable:
    """Table of those numeric data sets of an HDF5 file that have the most common number of rows, by dotted
    path; each is read when it is asked for.

    Raises:
        RecordingError: not installed, unreadable, damaged, no table in it, or a data set in another file.
    """
    datasets: dict[str, Any] = {}
    with reading(path, "an HDF5 file", "h5py"), opened(path):
        import h5py  # noqa: PLC0415 - an extra

        def take(name: str, item: Any) -> None:  # noqa: ANN401 - of h5py
            if isinstance(item, h5py.Dataset) and item.dtype.kind in "iuf" and not name.startswith("#"):
                if item.external or item.is_virtual:
                    raise RecordingError(f"{path}: {name!r} lies in another file, expected it in this one")
                _require_chunks(path, item)
                datasets[name.replace("/", ".")] = item

        h5py.File(path).visititems(take)  # stays open as long as the data sets are there
    return _table(path, datasets)


def _require_chunks(path: Path, values: Any) -> None:  # noqa: ANN401 - of h5py
    """Raises RecordingError for a data set of h5py with a chunk that unpacks to more than `room_of` allows,
    whatever the size that it states. Unpacks those chunks of gzip that might be so large.
    """
    require_room(path, values.dtype.itemsize * prod(values.chunks or (0,)))

    def check(chunk: Any) -> None:  # noqa: ANN401 - of h5py
        if chunk.size * _MOST_DEFLATED > room_of(path) and not chunk.filter_mask:
            unpacked(path, zlib.decompressobj, values.id.read_direct_chunk(chunk.chunk_offset)[1])

    if values.compression == "gzip":
        values.id.chunk_iter(check)


def _flat(variables: Mapping[str, Any], notes: list[str], head: str = "") -> dict[str, Array]:
    """Numeric arrays of nested structures by dotted path, which begins with `head`; of an array of structures
    those of the first, with a note. All else is left out.
    """
    arrays: dict[str, Array] = {}
    for name, held in variables.items():
        value = held
        # of a list with elements of unlike shapes numpy has no dimensions
        row = isinstance(held, list) or np.ndim(held) == 1
        if row and len(held) > 0 and isinstance(held[0], Mapping):
            value = held[0]
            notes.append(f"{head}{name}: the first of {len(held)} structures")
        if isinstance(value, Mapping):
            arrays |= _flat(value, notes, f"{head}{name}.")
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
            arrays[head + name] = value
    return arrays


def _table(path: Path, arrays: Mapping[str, Any], units: Mapping[str, str] | None = None) -> ArrayTable:
    """Table of those arrays or data sets that have the most common length (of equally common ones the
    longest), read when asked for. A matrix, at most 64 wide, gives columns `name[i]` along its longer side;
    other shapes are left out. Raises RecordingError where there are none.
    """
    columns: dict[str, tuple[int, Callable[[], Array]]] = {}
    for name, values in arrays.items():
        sides = [side for side in values.shape or () if side != 1]
        if len(sides) == 2 and min(sides) <= _MOST_ELEMENTS:
            rows = range(min(sides))
            columns |= {f"{name}[{i}]": (max(sides), partial(_column, path, values, i)) for i in rows}
        elif len(sides) == 1:
            columns[name] = sides[0], partial(_column, path, values)
    lengths = Counter(length for length, _ in columns.values() if length > 1)
    if not lengths:
        raise RecordingError(f"{path}: no arrays of numbers, expected time, position and force")
    usual = max(lengths, key=lambda length: (lengths[length], length))
    usable = {name: read for name, (length, read) in columns.items() if length == usual}
    return ArrayTable(usable, units or {})


def _column(path: Path, values: Any, row: int | None = None) -> Array:  # noqa: ANN401 - an array or a data set
    """Reads an array, or line `row` of a matrix, along its longer side, as float64; dates in s since
    1970. Raises RecordingError: too large, or unreadable.
    """
    require_room(path, 8 * values.size)
    with reading(path, "a table", ""):
        values = np.squeeze(values[()])
    if row is not None:
        values = np.ascontiguousarray((values if values.shape[0] < values.shape[1] else values.T)[row])
    return _floats(values)


# --- TDMS ---


def tdms(path: Path) -> ArrayTable:
    """Table of those channels of a LabVIEW file, numbers or dates, that have the most common number of
    samples, with the file's units, named `group/channel` where groups share a name; and `time_s` from 0, if
    the first of these is a waveform.

    Raises:
        RecordingError: not installed, unreadable, damaged, or no table in it.
    """
    with reading(path, "a TDMS file", "npTDMS"), opened(path) as raw:
        from nptdms import TdmsFile  # noqa: PLC0415 - an extra

        channels = [channel for group in TdmsFile.open(raw).groups() for channel in group.channels()]
        channels = [channel for channel in channels if channel.dtype.kind in "iufM"]
        require_room(path, sum(8 * len(channel) for channel in channels))
        lengths = Counter(map(len, channels))
        usual = max(lengths, key=lambda length: (lengths[length], length), default=0)
        channels = [channel for channel in channels if len(channel) == usual]
        names = Counter(channel.name for channel in channels)
        step_s = channels[0].properties.get("wf_increment") if channels else None
        arrays: dict[str, Any] = {"time_s": np.arange(usual) * float(step_s)} if step_s else {}
        units = dict[str, str]()
        for channel in channels:
            name = channel.name if names[channel.name] == 1 else f"{channel.group_name}/{channel.name}"
            units[name] = "s" if channel.dtype.kind == "M" else str(channel.properties.get("unit_string", ""))
            arrays[name] = np.asarray(channel[:])
    return _table(path, arrays, units)
