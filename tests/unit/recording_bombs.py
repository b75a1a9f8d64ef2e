"""Small files of other programs that their libraries expand to gigabytes, with what is said of each."""

import io
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import openpyxl
import pyarrow as pa
import pyarrow.parquet as pq
from mcap.writer import Writer
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

_MAIN = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
_TYPES = "[Content_Types].xml"
_STRINGS = (
    '<Override PartName="/xl/sharedStrings.xml" '
    'ContentType="application/vnd.openxmlformats-officedocument.spreadsheetml.sharedStrings+xml"/>'
)
_NAMES = "time_s", "position_m"


def _spreadsheet(sheet: str, strings: str = "", styles: str = "") -> Callable[[Path], None]:
    """A workbook whose parts hold other content."""
    parts = {
        "xl/worksheets/sheet1.xml": f'<worksheet xmlns="{_MAIN}">{sheet}</worksheet>',
        "xl/sharedStrings.xml": f'<sst xmlns="{_MAIN}">{strings}</sst>',
    }
    if styles:
        parts["xl/styles.xml"] = f'<styleSheet xmlns="{_MAIN}">{styles}</styleSheet>'

    def write(path: Path) -> None:
        openpyxl.Workbook().save(made := io.BytesIO())
        with zipfile.ZipFile(made) as old, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new:
            content = {name: old.read(name).decode() for name in old.namelist()} | parts
            content[_TYPES] = content[_TYPES].replace("</Types>", f"{_STRINGS}</Types>")
            for name, text in content.items():
                new.writestr(name, text)

    return write


def _cells(count: int, cell: str) -> str:
    rows = (f'<row r="{i}">{cell.format(i)}</row>' for i in range(1, count + 1))
    return f"<sheetData>{''.join(rows)}</sheetData>"


def _ros(definition: str, data: bytes) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start("ros2")
            schema = writer.register_schema("x/msg/A", "ros2msg", definition.encode())
            channel = writer.register_channel("/a", "cdr", schema)
            writer.add_message(channel, 0, data, 0)
            writer.finish()  # type: ignore[no-untyped-call]

    return write


def _message(fields: str) -> str:
    return f"{'=' * 80}\nMSG: x/{fields}\n"


def _bag(path: Path) -> None:
    writer = BagWriter(path)
    writer.set_compression(writer.CompressionFormat.BZ2)
    with writer:
        store = get_typestore(Stores.ROS1_NOETIC)
        connection = writer.add_connection("/a", "std_msgs/msg/String", typestore=store)
        writer.write(connection, 1, struct.pack("<I", 2**27) + bytes(2**27))


def _element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def _matrix(kind: int, sides: tuple[int, int], content: bytes) -> bytes:
    head = _element(6, struct.pack("<II", kind, 0)) + _element(5, struct.pack("<2i", *sides))
    return _element(14, head + _element(1, b"") + content)


def _matlab(content: bytes) -> Callable[[Path], None]:
    """A structure with a field that holds `content`."""
    field = struct.pack("<HHI", 5, 4, 32) + _element(1, b"a".ljust(32, b"\0"))
    packed = zlib.compress(_matrix(2, (1, 1), field + content))
    return lambda path: _written(path, b"MATLAB 5.0".ljust(124) + b"\x00\x01IM" + _element(15, packed))


def _written(path: Path, content: bytes) -> None:
    path.write_bytes(content)


def _parquet(column: Callable[[], Any]) -> Callable[[Path], None]:
    return lambda path: pq.write_table(pa.table(dict.fromkeys(_NAMES, column())), path, compression="zstd")


def _row_groups(path: Path) -> None:
    batch = pa.table(dict.fromkeys(_NAMES, _zeros(2**20)))
    with pq.ParquetWriter(path, batch.schema, compression="zstd") as writer:
        for _ in range(16):
            writer.write_table(batch)


def _zeros(count: int) -> Any:  # noqa: ANN401 - of pyarrow
    return pa.DictionaryArray.from_arrays(pa.array(np.zeros(count, np.int32)), pa.array([0.0])).cast(
        "float64"
    )


def _list() -> Any:  # noqa: ANN401 - of pyarrow
    return pa.ListArray.from_arrays(pa.array([0, 2**24], pa.int32()), _zeros(2**24))


def _texts() -> Any:  # noqa: ANN401 - of pyarrow
    dictionary = pa.array(["1" * 10**6])
    return pa.DictionaryArray.from_arrays(pa.array(np.zeros(200, np.int32)), dictionary)


def _hdf5(layout: dict[str, tuple[int | None, ...]], packed: bytes = b"") -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            for name in _NAMES:
                values = file.create_dataset(name, dtype="f8", compression=9, **layout)
                if packed:
                    values.id.write_direct_chunk((0,), packed)

    return write


_UNPACKED = "bytes when unpacked, allowed"


def expanding_files() -> dict[str, tuple[Callable[[Path], None], str]]:
    """How each is written, and what is said of it. Read with room, most take 128 MiB to many GiB.

    A function, or each process that collects the tests would make them."""
    return {
        "far.xlsx": (
            _spreadsheet(
                '<dimension ref="A1:XFD131072"/><sheetData><row r="1"><c r="A1"><v>1</v></c></row>'
                '<row r="131072"><c r="XFD131072"><v>1</v></c></row></sheetData>'
            ),
            "no time",
        ),
        "wide.xlsx": (_spreadsheet(_cells(3000, '<c r="XFD{}"><v>1</v></c>')), _UNPACKED),
        "texts.xlsx": (
            _spreadsheet(_cells(2000, '<c r="A{}" t="s"><v>0</v></c>'), f"<si><t>{'x' * 10**6}</t></si>"),
            _UNPACKED,
        ),
        "styles.xlsx": (_spreadsheet(_cells(1, ""), "", f"<cellXfs>{'<xf/>' * 10**6}</cellXfs>"), _UNPACKED),
        "array.mcap": (_ros("string[30000000] a\n", bytes(64)), _UNPACKED),
        "nested.mcap": (
            _ros("B[3000] b\n" + _message("B\nC[3000] c") + _message("C\nuint8 a"), bytes(64)),
            _UNPACKED,
        ),
        "list.mcap": (
            _ros("B[] b\n" + _message("B\nuint8 a"), b"\0\1\0\0" + struct.pack("<I", 10**7) + bytes(10**7)),
            _UNPACKED,
        ),
        "packed.bag": (_bag, _UNPACKED),
        "zeros.mat": (_matlab(_matrix(6, (2**24, 1), _element(9, bytes(2**27)))), _UNPACKED),
        "bytes.mat": (_matlab(_matrix(6, (2**24, 1), _element(2, bytes(2**24)))), _UNPACKED),
        "cells.mat": (_matlab(_matrix(1, (20_000, 20_000), b"")), _UNPACKED),
        "zeros.parquet": (_row_groups, f"column 'time_s': {2**27} {_UNPACKED}"),
        "list.parquet": (_parquet(_list), _UNPACKED),
        "struct.parquet": (_parquet(lambda: pa.StructArray.from_arrays([_list()], ["a"])), "no time"),
        "texts.parquet": (_parquet(lambda: _texts().cast(pa.string())), "expected at least 2"),
        "zeros.h5": (_hdf5({"shape": (2**27,), "chunks": (2**20,)}), _UNPACKED),
        "chunk.h5": (_hdf5({"shape": (10,), "maxshape": (None,), "chunks": (2**28,)}), _UNPACKED),
        "packed.h5": (_hdf5({"shape": (10,), "chunks": (10,)}, zlib.compress(bytes(2**27))), _UNPACKED),
    }
