"""ROS: bags, and MCAP files of other programs with messages in CDR."""

import bz2
from array import array
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
from mcap.reader import NonSeekingReader
from numpy.typing import NDArray

from forefeel.common.errors import RecordingError
from forefeel.common.recording.array_tables import reading
from forefeel.common.recording.mcap_reader import CUT
from forefeel.common.recording.mcap_records import DAMAGE
from forefeel.common.recording.recording import Array, opened, require_room, room_of, unpacked

_UNITS = {"force": "N", "torque": "Nm", "position": "m"}
"""REP 103: SI units everywhere. A joint's position may be rad."""
Size = tuple[int, int, float]
"""Least bytes of a field in a file, those in memory then, and the most for each further one."""
_BASE, _NAME, _ARRAY = 1, 2, 3  # Nodetype of rosbags
_PACKED = {"64": 8, "32": 4, "16": 2, "ng": 4}  # bytes by the end of a primitive's name, a string's length
_OBJECT_BYTES = 200  # of a number, a text or a message in Python with what holds it
_CODE_BYTES = 4096  # of the code that reads an element of an array of fixed length (measured)
_MOST_ELEMENTS = 32  # of an array in a message that become columns


class RosTable:
    """Table of ROS messages: the numbers of each topic as columns `topic.field`, with a row for each message
    of any topic, by its stamp; NaN in the rows of other topics.

    Attributes: see `TextTable`.
    """

    def __init__(self, path: Path, cut: bool = False) -> None:
        """Reads the file, if `cut` off up to the cut; numbers that never change give no column.

        Raises:
            RecordingError: not installed, unreadable, damaged, or no numbers in it.
        """
        stamps_s: dict[str, list[float]] = {}
        read: dict[str, dict[str, array[float]]] = {}
        room = room_of(path)
        for topic, log_ns, message, size in _messages(path, cut):
            values = dict(_numbers(message, ""))
            if (room := room - max(size, 8 * len(values))) < 0:
                raise RecordingError(f"{path}: unpacks to more than {room_of(path)} bytes")
            header = values.pop(".header.stamp.sec", None), values.pop(".header.stamp.nanosec", 0.0)
            stamp_s = log_ns * 1e-9 if header[0] is None else header[0] + header[1] * 1e-9
            stamps_s.setdefault(topic, []).append(stamp_s)
            if topic not in read:
                read[topic] = {field: array("d") for field in values}
            for field, column in read[topic].items():
                column.append(values.get(field, np.nan))
        joined_s = np.concatenate([np.array(stamps) for stamps in stamps_s.values()] or [np.empty(0)])
        order = np.argsort(joined_s, kind="stable")
        rows = dict(
            zip(
                stamps_s, np.split(np.argsort(order), np.cumsum([*map(len, stamps_s.values())])), strict=False
            )
        )
        self._time_s = joined_s[order]
        self._columns: dict[str, tuple[NDArray[np.int64], Array]] = {}
        self.units: dict[str, str] = {"time": "s"}
        for topic, columns in read.items():
            for field, column in columns.items():
                numbers = np.array(column)
                known = numbers[np.isfinite(numbers)]
                if len(known) and np.ptp(known) > 0.0:  # what stays as it is tells nothing
                    name = topic + field
                    self._columns[name] = rows[topic], numbers
                    self.units[name] = next((u for word, u in _UNITS.items() if f".{word}" in field), "")
        if not self._columns:
            raise RecordingError(f"{path}: no message with numbers that change, expected force and position")
        self.names: Sequence[str] = ("time", *self._columns)
        self.notes = [CUT] * cut

    def read(self, names: Sequence[str]) -> list[Array]:
        return [self._time_s if name == "time" else self._column(name) for name in names]

    def _column(self, name: str) -> Array:
        column, (rows, values) = np.full(len(self._time_s), np.nan), self._columns[name]
        column[rows] = values
        return column


def _numbers(value: Any, head: str) -> Iterator[tuple[str, float]]:  # noqa: ANN401 - a message of any kind
    """Yields every number in a message, deep, with the path of its field behind `head`; arrays of over 32
    elements and fields that begin with `_` are left out.
    """
    if isinstance(value, bool | int | float | np.number):
        yield head, float(value)
    elif isinstance(value, np.ndarray | list):
        if len(value) <= _MOST_ELEMENTS:
            for i, element in enumerate(value):
                yield from _numbers(element, f"{head}[{i}]")
    elif hasattr(value, "__dataclass_fields__"):
        for field in value.__dataclass_fields__:
            if not field.startswith("_"):
                yield from _numbers(getattr(value, field), f"{head}.{field}")


def _messages(path: Path, cut: bool) -> Iterator[tuple[str, int, Any, int]]:
    """Yields topic, log time in ns, message and packed bytes of each message of a bag, or in CDR of an MCAP
    file (in the order of the file). Raises RecordingError: not installed, unreadable, damaged, or too large;
    of an MCAP file that is `cut`, damage only ends the messages.
    """
    with reading(path, "a recording of ROS", "rosbags"), opened(path) as file:
        from rosbags.highlevel import AnyReader  # noqa: PLC0415 - an extra
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415

        if path.suffix.lower() == ".mcap":
            store, sizes = get_typestore(Stores.ROS2_HUMBLE), dict[str, Size]()
            # in the order of the file, whose chunks `Run` has measured
            with suppress(*(DAMAGE if cut else ())):
                for schema, channel, record in NonSeekingReader(file).iter_messages(log_time_order=False):
                    if schema is None or channel.message_encoding != "cdr":
                        continue
                    if schema.name not in store.types and schema.encoding == "ros2msg":
                        store.register(get_types_from_msg(schema.data.decode(), schema.name))
                    _require_message(path, schema.name, len(record.data), store.fielddefs, sizes)
                    message = store.deserialize_cdr(record.data, schema.name)
                    yield channel.topic, record.log_time, message, len(record.data)
            return
        with AnyReader([path]) as reader:
            sizes = {}
            _bound_chunks(path, reader.readers[0])
            for connection, log_ns, data in reader.messages():
                _require_message(path, connection.msgtype, len(data), reader.typestore.fielddefs, sizes)
                message = reader.deserialize(data, connection.msgtype)
                yield connection.topic, log_ns, message, len(data)


def _bound_chunks(path: Path, reader: Any) -> None:  # noqa: ANN401 - of rosbags
    """Bounds what a chunk may unpack to: the library has no limit."""
    new = {bz2.decompress: bz2.BZ2Decompressor, lz4.frame.decompress: lz4.frame.LZ4FrameDecompressor}
    for at, chunk in reader.chunks.items():
        if decompressor := new.get(chunk.decompressor):
            reader.chunks[at] = chunk._replace(decompressor=partial(unpacked, path, decompressor))


def _require_message(path: Path, kind: str, packed: int, definitions: Any, sizes: dict[str, Size]) -> None:  # noqa: ANN401 - of rosbags
    _, memory, expansion = _size((_NAME, kind), definitions, sizes)
    require_room(path, memory + int(min(expansion, 1e9) * packed), f", message {kind}")


def _size(field: Any, definitions: Any, sizes: dict[str, Size]) -> Size:  # noqa: ANN401 - of rosbags
    """Bounds of a field's size: least bytes in a file; bytes in memory for these; most bytes in memory for a
    further one. `field`, `definitions`: as of rosbags; `sizes`: cache of results by type name.
    """
    node, of = field
    if node == _BASE:
        return _PACKED.get(of[0][-2:], 1), _OBJECT_BYTES, 4.0  # a character takes up to 4
    if node == _NAME:
        if of not in sizes:
            sizes[of] = 0, 0, inf  # of a kind that holds itself
            parts = [_size(part, definitions, sizes) for _, part in definitions[of][1]]
            packed, memory = sum(part[0] for part in parts), _OBJECT_BYTES + sum(part[1] for part in parts)
            sizes[of] = packed, memory, max((part[2] for part in parts), default=1.0)
        return sizes[of]
    element, count = of
    if element[0] == _BASE and element[1][0] != "string":
        return count if node == _ARRAY else 4, _OBJECT_BYTES, 1.0  # of numpy, its bytes are in the file
    packed, memory, expansion = _size(element, definitions, sizes)
    if node == _ARRAY:  # is read by code that has lines for each element
        return count * packed, count * (memory + _CODE_BYTES), expansion
    return 4, _OBJECT_BYTES, max(expansion, memory / packed if packed else inf)
