"""Spans of a recorded run by time, for who looks at a piece of a file that is too long for the memory."""

from bisect import bisect_left
from collections.abc import Collection, Iterator, Mapping
from functools import lru_cache
from operator import attrgetter
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Metadata
from mcap.records import Message as MessageRecord

from forefeel.common.errors import RecordingError
from forefeel.common.messages import Message
from forefeel.common.recording.mcap_reader import decoded_one
from forefeel.common.recording.mcap_records import DAMAGE, RecordReader, damaged, unpacked
from forefeel.common.recording.recording import opened, room_of
from forefeel.common.topics import Topic, parse_key

_RECORD_HEAD_BYTES = 9  # opcode and length
_KEPT_CHUNKS = 4  # unpacked, in memory
_LOG_NS = attrgetter("log_time")


class Logged(NamedTuple):
    """A message of an axis, and when it was received, by the monotonic clock of the recording host."""

    log_ns: int
    axis: str
    topic: Topic[Message]
    message: Message


class _Chunk(NamedTuple):
    """The byte where a chunk begins, and the time that it spans."""

    at: int
    start_ns: int
    end_ns: int


class RunSpans:
    """Reads a recorded run a span of time at once; for several threads.

    In memory stand the places of the chunks, and the last few chunks that were read. The places come from the
    file's summary; a file whose writer was killed has none, and is gone through once.

    Attributes:
        start_ns, end_ns: when the first and the last message were received.
        cell: whose run it is.
        axes: by name.
        metadata: tables by name.

    Raises:
        RecordingError: unreadable, not MCAP, damaged, of several cells, without messages, or not in chunks.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with opened(path) as file:
            channels, self._chunks, tables = _index(file, path)
        self.metadata: Mapping[str, Mapping[str, str]] = {table.name: table.metadata for table in tables}
        keys = {c.id: parse_key(c.topic) for c in channels if c.message_encoding == "json"}
        cells = {key[0] for key in keys.values() if key}
        if len(cells) > 1:
            raise RecordingError(f"{path}: cells {', '.join(sorted(cells))}, expected one cell")
        if not self._chunks or not cells:
            raise RecordingError(f"{path}: holds no messages of a cell in chunks, expected a recorded run")
        (self.cell,) = cells
        self._topics = {number: key[1:] for number, key in keys.items() if key}
        self.axes = tuple(sorted({axis for axis, _ in self._topics.values()}))
        self.start_ns = min(chunk.start_ns for chunk in self._chunks)
        self.end_ns = max(chunk.end_ns for chunk in self._chunks)
        self._messages = lru_cache(maxsize=_KEPT_CHUNKS)(self._read)

    def between(self, start_ns: int, end_ns: int, topics: Collection[Topic[Message]]) -> Iterator[Logged]:
        """The messages of the topics that were received from `start_ns` on and before `end_ns`.

        In the order of their arrival, where the chunks of the file do not overlap.

        Raises:
            RecordingError: damaged, or a message is not what its topic carries.
        """
        names = {topic.name for topic in topics}
        wanted = {number: place for number, place in self._topics.items() if place[1].name in names}
        for chunk in self._chunks:
            if chunk.end_ns < start_ns or chunk.start_ns >= end_ns:
                continue
            messages = self._messages(chunk.at)
            first, last = (bisect_left(messages, ns, key=_LOG_NS) for ns in (start_ns, end_ns))
            for message in messages[first:last]:
                if message.channel_id in wanted:
                    axis, topic = wanted[message.channel_id]
                    where = f"{self.path}: axis {axis}, {topic.name}"
                    decoded = decoded_one(topic.message, message.data, where)
                    yield Logged(message.log_time, axis, topic, decoded)

    def _read(self, at: int) -> list[MessageRecord]:
        """Undecoded messages of the chunk that begins at byte `at` of the file, sorted by log time; raises
        RecordingError where it is damaged.
        """
        with opened(self.path) as file:
            try:
                file.seek(at + _RECORD_HEAD_BYTES)
                records = unpacked(Chunk.read(ReadDataStream(file)), room_of(self.path))
            except DAMAGE as error:
                raise damaged(self.path, at, error) from error
        return sorted((record for record in records if isinstance(record, MessageRecord)), key=_LOG_NS)


def _index(file: BinaryIO, path: Path) -> tuple[list[Channel], list[_Chunk], list[Metadata]]:
    """Channels, chunks and metadata, from the summary of the file; where that is missing, damaged or lists no
    chunks, by going through the file once.
    """
    try:
        reader = make_reader(file)
        summary, tables = reader.get_summary(), list(reader.iter_metadata())
    except DAMAGE:
        summary, tables = None, []
    if summary is not None and summary.chunk_indexes:
        chunks = [
            _Chunk(index.chunk_start_offset, index.message_start_time, index.message_end_time)
            for index in summary.chunk_indexes
        ]
        return list(summary.channels.values()), chunks, tables
    file.seek(0)
    records, channels, chunks, tables = RecordReader(file, path), [], [], []
    for record in records:
        if isinstance(record, Chunk):
            chunks.append(_Chunk(records.at, record.message_start_time, record.message_end_time))
        elif isinstance(record, Channel):
            channels.append(record)
        elif isinstance(record, Metadata):
            tables.append(record)
    return channels, chunks, tables
