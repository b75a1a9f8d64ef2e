"""Reads a recorded run: messages, columns of numbers, and the recording that they make."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from itertools import chain
from math import nan
from pathlib import Path
from types import NoneType
from typing import Any, TypeVar

import numpy as np
from mcap.records import Channel, Metadata, Statistics
from mcap.records import Message as MessageRecord
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from forefeel.common.errors import RecordingError
from forefeel.common.messages import Message
from forefeel.common.recording.mcap_records import RecordReader
from forefeel.common.recording.recording import Column, Recording, opened
from forefeel.common.topics import FORCE, MASTER_IMPAIRMENT, SLAVE_IMPAIRMENT, Topic, parse_key

M = TypeVar("M", bound=Message)
Columns = dict[str, NDArray[Any]]

CUT = "the file is cut off: what follows its last whole chunk is lost"
_BLOCK_MESSAGES = 4096
_NUMBERS = {bool, int, float, NoneType}
_LIST_OF = cache(lambda kind: TypeAdapter(list[kind]))  # type: ignore[valid-type]
_IMPAIRMENTS = {topic.name: topic for topic in (MASTER_IMPAIRMENT, SLAVE_IMPAIRMENT)}


@dataclass(frozen=True, slots=True)
class Stream:
    """The messages of one axis and topic in the order of the file: receive stamps in ns, and JSON."""

    log_ns: list[int] = field(default_factory=list)
    payloads: list[bytes] = field(default_factory=list)


class Run:
    """One run: cell, axes, the messages of each topic in the order of their arrival, metadata.

    Messages are decoded and validated when they are asked for; columns are kept after that. An axis that the
    run does not have raises RecordingError; a topic of which nothing was recorded is empty.

    Attributes:
        cell: None without a message.
        truncated: the writer was killed: the run ends where the last whole chunk does.
        metadata: tables by name.

    Raises:
        RecordingError: unreadable, not MCAP, damaged, or of several cells.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.cell: str | None = None
        self.metadata: dict[str, Mapping[str, str]] = {}
        self._streams: dict[tuple[str, str], Stream] = {}
        self._columns: dict[tuple[str, str], Columns] = {}
        with opened(path) as file:
            records = RecordReader(file, path)
            self._read(records)
        self.truncated = records.truncated
        self.axes: tuple[str, ...] = tuple(sorted({axis for axis, _ in self._streams}))

    def _read(self, records: RecordReader) -> None:
        """Fills the streams, `cell` and `metadata` from the records. Raises RecordingError: a message of a
        channel that is not declared, of a second cell, or not as many as the statistics say.
        """
        channels, count = dict[int, Stream](), 0
        for record in records:
            if isinstance(record, MessageRecord):
                if (stream := channels.get(record.channel_id)) is None:
                    number = record.channel_id
                    raise RecordingError(f"{self.path}: damaged, channel {number} is used but not declared")
                stream.log_ns.append(record.log_time)
                stream.payloads.append(record.data)
                count += 1
            elif isinstance(record, Channel):
                channels[record.id] = self._stream_of(record)
            elif isinstance(record, Metadata):
                self.metadata[record.name] = record.metadata
            elif isinstance(record, Statistics) and record.message_count != count:
                counts = f"it holds {count} messages, its statistics say {record.message_count}"
                raise RecordingError(f"{self.path}: damaged, {counts}")

    def _stream_of(self, channel: Channel) -> Stream:
        """The stream of the channel's axis and topic; for a foreign channel, or not in JSON, a new one that
        nobody reads. Sets `cell`; raises RecordingError for a second cell.
        """
        ours = parse_key(channel.topic)
        if ours is None or channel.message_encoding != "json":
            return Stream()
        cell, axis, topic = ours
        if self.cell not in (None, cell):
            raise RecordingError(f"{self.path}: cells {self.cell!r} and {cell!r}, expected one cell")
        self.cell = cell
        return self._streams.setdefault((axis, topic.name), Stream())

    def count(self, axis: str, topic: Topic[Any]) -> int:
        return len(self.stream(axis, topic).payloads)

    def log_ns(self, axis: str, topic: Topic[Any]) -> NDArray[np.int64]:
        """Receive stamps of the messages, by the monotonic clock of the recording host."""
        return np.array(self.stream(axis, topic).log_ns, dtype=np.int64)

    def messages(self, axis: str, topic: Topic[M]) -> Iterator[M]:
        """The messages in the order of their arrival, decoded as they are consumed.

        Raises:
            RecordingError: one is not what its topic carries; the text says which.
        """
        return chain.from_iterable(self._blocks(axis, topic))

    def column(self, axis: str, topic: Topic[Any], name: str) -> NDArray[Any]:
        """One numeric field over all messages: float64, int64 or bool; None becomes NaN, in float64.

        Raises:
            RecordingError: see `messages`.
            ValueError: the topic has no such field, or it holds no numbers.
        """
        key = axis, topic.name
        if key not in self._columns:
            self._columns[key] = _columns(topic.message, self._blocks(axis, topic))
        if name not in self._columns[key]:
            raise ValueError(f"{topic.name}: no numbers {name!r}, it has {', '.join(self._columns[key])}")
        return self._columns[key][name]

    def to_recording(self, axis: str | None = None) -> Recording:
        """Recording of the valid force samples: readback and force, by the slave's stamps, in s from 0.

        Samples that arrived late are put in their place, doubled ones dropped. `axis` may be left out when
        there is only one; the positions of other axes that move stand beside.

        Raises:
            RecordingError: fewer than 2 valid samples, no such axis, or several to choose from.
        """
        axis = self._only_axis() if axis is None else axis
        valid = np.flatnonzero(self.column(axis, FORCE, "valid"))
        stamps_ns, first = np.unique(self.column(axis, FORCE, "stamp_ns")[valid], return_index=True)
        chosen = valid[first]
        return Recording(
            name=f"{self.path.stem}/{axis}",
            time_s=(stamps_ns - stamps_ns[:1]) * 1e-9,
            position_m=self.column(axis, FORCE, "position_m")[chosen],
            force_n=self.column(axis, FORCE, "force_n")[chosen],
            source=f"{self.path}: axis {axis}",
            notes=(CUT,) * self.truncated,
            further=tuple(self._positions(axis, stamps_ns)),
        )

    def _positions(self, axis: str, stamps_ns: NDArray[np.int64]) -> Iterator[Column]:
        """Yields the positions of the other axes, interpolated at these stamps, of those that move then."""
        for other in self.axes:
            at, first = np.unique(self.column(other, FORCE, "stamp_ns"), return_index=True)
            if other != axis and len(at):
                read_m = self.column(other, FORCE, "position_m")[first]
                values_m = np.interp(stamps_ns - at[0], at - at[0], read_m)
                if np.diff(values_m).any():
                    yield Column(other, "m", values_m)

    def impairment_trace(self, topic: str, link: str) -> tuple[tuple[int, ...], ...]:
        """The delays in ns of each message that passed `link`, by arrival; empty when it was not impaired. A
        message has none where it was lost, two where it was doubled.

        `topic` is the name of one of the two impairment topics, `link` is inbound or outbound.

        Raises:
            RecordingError: a part of the trace is missing.
        """
        messages = chain.from_iterable(self.messages(axis, _IMPAIRMENTS[topic]) for axis in self.axes)
        parts = sorted((part for part in messages if part.link == link), key=lambda part: part.first_index)
        delays_ns: list[tuple[int, ...]] = []
        for part in parts:
            if part.first_index != len(delays_ns):
                indices = f"{part.first_index} follows {len(delays_ns) - 1}"
                raise RecordingError(
                    f"{self.path}: {topic} of {link}: index {indices}, expected all of the trace"
                )
            delays_ns.extend(part.delays_ns)
        return tuple(delays_ns)

    def _only_axis(self) -> str:
        if len(self.axes) != 1:
            axes = ", ".join(self.axes) or "no axis"
            raise RecordingError(f"{self.path}: holds {axes}, expected one axis to be named")
        return self.axes[0]

    def stream(self, axis: str, topic: Topic[Any]) -> Stream:
        if axis not in self.axes:
            raise RecordingError(f"{self.path}: no axis {axis!r}, it holds {', '.join(self.axes) or 'none'}")
        return self._streams.get((axis, topic.name), Stream())

    def _blocks(self, axis: str, topic: Topic[M]) -> Iterator[list[M]]:
        payloads = self.stream(axis, topic).payloads
        where = f"{self.path}: axis {axis}, {topic.name}"
        for first in range(0, len(payloads), _BLOCK_MESSAGES):
            yield _decoded(topic.message, payloads[first : first + _BLOCK_MESSAGES], first, where)


def _decoded(kind: type[M], payloads: list[bytes], first: int, where: str) -> list[M]:
    """Messages of payloads in JSON, validated; raises RecordingError that names the first that is none.
    `first`: number of the first payload in its stream, for that text, as is `where`.
    """
    try:  # as one JSON array, which is faster than one by one
        messages: list[M] = _LIST_OF(kind).validate_json(b"[%b]" % b",".join(payloads))
    except ValidationError:
        messages = []
    if len(messages) == len(payloads):
        return messages
    return [decoded_one(kind, payload, f"{where}, message {first + i}") for i, payload in enumerate(payloads)]


def decoded_one(kind: type[M], payload: bytes, where: str) -> M:
    """Message of a payload in JSON; raises RecordingError that says `where`, and which field is wrong."""
    try:
        return kind.model_validate_json(payload)
    except ValidationError as error:
        fault = error.errors(include_url=False, include_input=False)[0]
        place = ".".join([kind.__name__, *map(str, fault["loc"])])
        raise RecordingError(f"{where}: {place}: {fault['msg']}") from error


def _columns(kind: type[M], blocks: Iterator[list[M]]) -> Columns:
    """Arrays, over all messages, of the fields that always hold numbers, None as NaN; others are left out."""
    parts: dict[str, list[NDArray[Any]]] = {name: [] for name in kind.model_fields}
    for block in blocks:
        for name in list(parts):
            values = [getattr(message, name) for message in block]
            if set(map(type, values)) <= _NUMBERS:
                if None in values:
                    values = [nan if value is None else float(value) for value in values]
                parts[name].append(np.array(values))
            else:
                del parts[name]  # text or lists: `messages` has them
    return {name: np.concatenate(arrays or [np.empty(0)]) for name, arrays in parts.items()}
