"""Spans of a recorded run by time, for who looks at a piece of a file that is too long for the memory."""

import struct
from bisect import bisect_left
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import lru_cache
from operator import attrgetter
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel
from mcap.writer import MCAP0_MAGIC
from pydantic import ValidationError

from forefeel.common.errors import RecordingError
from forefeel.common.messages import Message
from forefeel.common.recording.mcap_records import DAMAGE, HEAD, MessageRecord, records_of_chunk, unpacked
from forefeel.common.recording.recording import opened, room_of
from forefeel.common.topics import Topic, parse_key

_TIMES = struct.Struct("<QQ")
_CHANNEL_ID = struct.Struct("<H")
# unpacked chunks in memory; chosen, not measured: fewer are unpacked more often, more take more memory
_KEPT_CHUNKS = 4
_LOG_NS = attrgetter("log_ns")


class Logged(NamedTuple):
    """A message of an axis, and when it was received, by the monotonic clock of the recording host."""

    log_ns: int
    axis: str
    topic: Topic[Message]
    message: Message


@dataclass(frozen=True, slots=True)
class _Chunk:
    """Where the body of a chunk stands, what time it spans, which channels it has messages of."""

    at: int
    size: int
    start_ns: int
    end_ns: int
    channels: frozenset[int]


class RunSpans:
    """A run, read a span at a time: the file is gone through once, from head to head, to learn what is where.

    For several threads. In memory stand the places of the chunks, and the last few chunks that were read.
    A file whose writer was killed ends with its last whole chunk.

    Attributes:
        start_ns, end_ns: when the first and the last message were received.
        cell: whose run it is.
        axes: by name.

    Raises:
        RecordingError: unreadable, not MCAP, damaged, of several cells, without messages, or not in chunks.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._topics: dict[int, tuple[str, Topic[Message]] | None] = {}
        self._cells: set[str] = set()
        with opened(path) as file:
            self._room = room_of(path)
            if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise RecordingError(f"{path}: does not start as an MCAP file, expected one")
            self._chunks = self._indexed(file)
        if len(self._cells) > 1:
            raise RecordingError(f"{path}: cells {', '.join(sorted(self._cells))}, expected one cell")
        if not self._chunks or not self._cells:
            raise RecordingError(f"{path}: holds no messages of a cell, expected a recorded run")
        self.cell = next(iter(self._cells))
        self.axes = tuple(sorted({found[0] for found in self._topics.values() if found}))
        self.start_ns = min(chunk.start_ns for chunk in self._chunks)
        self.end_ns = max(chunk.end_ns for chunk in self._chunks)
        self._records = lru_cache(maxsize=_KEPT_CHUNKS)(self._read)

    def between(self, start_ns: int, end_ns: int, topics: Collection[Topic[Message]]) -> Iterator[Logged]:
        """The messages of the topics that were received from `start_ns` on and before `end_ns`.

        In the order of their arrival, where the chunks of the file do not overlap.

        Raises:
            RecordingError: damaged, or a message is not what its topic carries.
        """
        names = {topic.name for topic in topics}
        wanted = {number: found for number, found in self._topics.items() if found and found[1].name in names}
        for chunk in self._chunks:
            if (
                chunk.end_ns < start_ns
                or chunk.start_ns >= end_ns
                or wanted.keys().isdisjoint(chunk.channels)
            ):
                continue
            records = self._records(chunk)
            first, last = (bisect_left(records, ns, key=_LOG_NS) for ns in (start_ns, end_ns))
            for record in records[first:last]:
                if record.channel_id in wanted:
                    yield self._decoded(record, *wanted[record.channel_id])

    def _decoded(self, record: MessageRecord, axis: str, topic: Topic[Message]) -> Logged:
        try:
            message = topic.message.model_validate_json(record.payload)
        except ValidationError as error:
            fault = error.errors(include_url=False, include_input=False)[0]
            raise RecordingError(f"{self.path}: axis {axis}, {topic.name}: {fault['msg']}") from error
        return Logged(record.log_ns, axis, topic, message)

    def _indexed(self, file: BinaryIO) -> list[_Chunk]:
        """The chunks, from the heads of the records."""
        chunks: list[_Chunk] = []
        size = self.path.stat().st_size
        channels: set[int] = set()
        place: tuple[int, int, int, int] | None = None
        while len(head := file.read(HEAD.size)) == HEAD.size:
            opcode, length = HEAD.unpack(head)
            at = file.tell()
            if length > size - at or opcode in {Opcode.FOOTER, Opcode.DATA_END}:
                break
            if opcode == Opcode.MESSAGE_INDEX:
                channels.add(*_CHANNEL_ID.unpack(file.read(_CHANNEL_ID.size)))
            elif opcode == Opcode.CHUNK:
                self._close(file, chunks, place, channels)
                place, channels = (at, length, *_TIMES.unpack(file.read(_TIMES.size))), set()
            elif opcode == Opcode.MESSAGE:
                raise RecordingError(f"{self.path}: messages outside of chunks, expected them in chunks")
            file.seek(at + length)
        self._close(file, chunks, place, channels)
        return chunks

    def _close(
        self,
        file: BinaryIO,
        chunks: list[_Chunk],
        place: tuple[int, int, int, int] | None,
        channels: set[int],
    ) -> None:
        """Keeps a chunk once the indices behind it have told its channels; learns those that are new.

        Without indices, as behind the last chunk of a killed writer, the chunk itself tells them.
        """
        if place is None:
            return
        if not channels or not channels <= self._topics.keys():
            back = file.tell()
            channels = self._learn(file, place)
            file.seek(back)
        chunks.append(_Chunk(*place, frozenset(channels)))

    def _learn(self, file: BinaryIO, place: tuple[int, int, int, int]) -> set[int]:
        """Takes in the channels that a chunk declares; those that it has messages of."""
        used: set[int] = set()
        for record in self._cut(file, *place[:2]):
            if isinstance(record, MessageRecord):
                used.add(record.channel_id)
            elif record.id not in self._topics:
                parsed = parse_key(record.topic) if record.message_encoding == "json" else None
                self._topics[record.id] = None if parsed is None else parsed[1:]
                self._cells |= set() if parsed is None else {parsed[0]}
        if not used <= self._topics.keys():
            raise RecordingError(f"{self.path}: damaged at byte {place[0]}, a channel is not declared")
        return used

    def _read(self, chunk: _Chunk) -> list[MessageRecord]:
        with opened(self.path) as file:
            records = [r for r in self._cut(file, chunk.at, chunk.size) if isinstance(r, MessageRecord)]
        return sorted(records, key=_LOG_NS)

    def _cut(self, file: BinaryIO, at: int, size: int) -> list[MessageRecord | Channel]:
        file.seek(at)
        try:
            return list(records_of_chunk(unpacked(file.read(size), self._room)))
        except DAMAGE as error:
            reason = str(error) or type(error).__name__
            raise RecordingError(f"{self.path}: damaged at byte {at} ({reason}), expected a chunk") from error
