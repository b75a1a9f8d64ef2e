"""ROS: bags, and MCAP files of other programs with messages in CDR."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from forefeel.common.errors import RecordingError
from forefeel.common.recording.array_tables import reading
from forefeel.common.recording.recording import Array, opened, room_of

_UNITS = {"force": "N", "torque": "Nm", "position": "m"}
"""REP 103: SI units everywhere. A joint's position may be rad."""
_MOST_ELEMENTS = 32  # of an array in a message that become columns


class RosTable:
    """The numbers of each topic as columns `topic.field`, at the stamps of the last one that is read; those
    of other topics are interpolated.

    Attributes: see `TextTable`.
    """

    def __init__(self, path: Path) -> None:
        """Reads all of the file.

        Raises:
            RecordingError: not installed, unreadable, damaged, or no numbers in it.
        """
        self._path = path
        self._stamps_s: dict[str, list[float]] = {}
        rows: dict[str, list[dict[str, float]]] = {}
        room = room_of(path)
        for topic, log_ns, message, size in _messages(path):
            if (room := room - size) < 0:
                raise RecordingError(f"{path}: unpacks to more than {room_of(path)} bytes")
            values = dict(_numbers(message, ""))
            header = values.pop(".header.stamp.sec", None), values.pop(".header.stamp.nanosec", 0.0)
            stamp_s = log_ns * 1e-9 if header[0] is None else header[0] + header[1] * 1e-9
            self._stamps_s.setdefault(topic, []).append(stamp_s)
            rows.setdefault(topic, []).append(values)
        self._columns: dict[str, tuple[str, Array]] = {}
        self.units: dict[str, str] = {"time": "s"}
        for topic, found in rows.items():
            for field in found[0]:
                column = np.array([row.get(field, np.nan) for row in found])
                if np.ptp(column) > 0.0:  # what stays as it is tells nothing
                    name = topic + field
                    self._columns[name] = topic, column
                    self.units[name] = next((u for word, u in _UNITS.items() if f".{word}" in field), "")
        if not self._columns:
            raise RecordingError(f"{path}: no message with numbers that change, expected force and position")
        self.names: Sequence[str] = ("time", *self._columns)
        self.notes: list[str] = []

    def read(self, names: Sequence[str]) -> list[Array]:
        """Columns at the stamps of the last one's topic."""
        topic = self._columns[names[-1]][0]
        time_s = np.array(self._stamps_s[topic])
        return [time_s if name == "time" else self._at(time_s, topic, name) for name in names]

    def _at(self, time_s: Array, topic: str, name: str) -> Array:
        own, values = self._columns[name]
        if own == topic:
            return values
        stamps_s = np.array(self._stamps_s[own])
        order = np.argsort(stamps_s, kind="stable")
        self.notes.append(f"{name} interpolated at the stamps of {topic}")
        return np.interp(time_s, stamps_s[order], values[order], left=np.nan, right=np.nan)


def _numbers(value: Any, head: str) -> Iterator[tuple[str, float]]:  # noqa: ANN401 - a message of any kind
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


def _messages(path: Path) -> Iterator[tuple[str, int, Any, int]]:
    """(topic, ns, message, bytes) of all that can be read."""
    with reading(path, "a recording of ROS", "rosbags"), opened(path) as file:
        from rosbags.highlevel import AnyReader  # noqa: PLC0415 - an extra
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415

        if path.suffix == ".mcap":
            from mcap.reader import make_reader  # noqa: PLC0415

            store = get_typestore(Stores.ROS2_HUMBLE)
            for schema, channel, record in make_reader(file).iter_messages():
                if schema is None or channel.message_encoding != "cdr":
                    continue
                if schema.name not in store.types and schema.encoding == "ros2msg":
                    store.register(get_types_from_msg(schema.data.decode(), schema.name))
                message = store.deserialize_cdr(record.data, schema.name)
                yield channel.topic, record.log_time, message, len(record.data)
            return
        with AnyReader([path]) as reader:
            for connection, log_ns, data in reader.messages():
                message = reader.deserialize(data, connection.msgtype)
                yield connection.topic, log_ns, message, len(data)
