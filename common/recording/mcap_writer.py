"""Writes a run to MCAP (https://mcap.dev/spec): a channel per axis and topic, JSON messages and their schema.

Chunks are compressed by zstd at its quickest level: a fifth of the size for 0.3 % of a processor.
"""

import json
import os
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self
from zlib import crc32

import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.writer import LIBRARY_IDENTIFIER, MCAP0_MAGIC

from forefeel.common.codec import decode
from forefeel.common.errors import CodecError, RecordingError, RunError
from forefeel.common.messages import Message
from forefeel.common.topics import parse_key

_CHUNK_BYTES = 1 << 20  # bytes of records after which a chunk ends by itself, as by the library
_MESSAGE = struct.Struct("<BQHIQQ")  # opcode, length behind it, channel, sequence, log time, publish time
_MESSAGE_HEAD = _MESSAGE.size - 9  # bytes of it that count for the length


class _Topic:
    """A channel with its messages in the chunk: log time and place of each in turn."""

    def __init__(self, channel: records.Channel, kind: type[Message]) -> None:
        self.channel, self.kind = channel, kind
        self.index: list[int] = []
        self.written = 0


class _ChunkedFile:
    """MCAP records in chunks with their indexes and a summary. Records are the library's, except messages and
    their index, thousands a second: packed here in a tenth of its time (0.4 us a message, 4.3 us).
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._chunk = bytearray()
        # of levels 1 to 5 the first leaves least, 0.77 GB an hour of chunks (0.79 to 0.85): a chunk is mostly
        # digits of floats, and the short matches that the others find in them take more than the digits
        self._compressor = zstandard.ZstdCompressor(level=1)
        self._topics: list[_Topic] = []
        self._schemas: dict[str, records.Schema] = {}
        self._chunks: list[bytes] = []  # index records; as objects they would take ten times the memory
        self._span_ns: tuple[int, int] | None = None
        self._metadata: list[records.MetadataIndex] = []
        stream.write(MCAP0_MAGIC)
        self._put(records.Header("", LIBRARY_IDENTIFIER))

    def topic(self, key: str, kind: type[Message], metadata: dict[str, str]) -> _Topic:
        """Declares a channel in the chunk in progress, with its schema where that is new, and returns it."""
        name = kind.__name__
        if name not in self._schemas:
            text = json.dumps(kind.model_json_schema(mode="serialization"))
            self._schemas[name] = records.Schema(len(self._schemas) + 1, text.encode(), "jsonschema", name)
            self._chunk += _bytes(self._schemas[name])
        channel = records.Channel(len(self._topics) + 1, key, "json", metadata, self._schemas[name].id)
        self._chunk += _bytes(channel)
        self._topics.append(_Topic(channel, kind))
        return self._topics[-1]

    def add(self, topic: _Topic, sequence: int, log_ns: int, publish_ns: int, data: bytes) -> None:
        """Adds a message to the chunk in progress; ends one that has grown beyond 1 MiB."""
        length = _MESSAGE_HEAD + len(data)
        head = _MESSAGE.pack(Opcode.MESSAGE, length, topic.channel.id, sequence, log_ns, publish_ns)
        topic.index += (log_ns, len(self._chunk))
        self._chunk += head
        self._chunk += data
        if len(self._chunk) > _CHUNK_BYTES:
            self.end_chunk()

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        at, length = self._put(records.Metadata(name, values))
        self._metadata.append(records.MetadataIndex(at, length, name))

    def end_chunk(self) -> None:
        """Writes the chunk in progress, with its message indexes, and begins another; does nothing where it
        holds no message. Counts its messages and keeps its index for the summary.
        """
        inside = [topic for topic in self._topics if topic.index]
        if not inside:
            return
        first_ns = min(min(topic.index[::2]) for topic in inside)
        last_ns = max(max(topic.index[::2]) for topic in inside)
        data, size, checksum = self._compressor.compress(self._chunk), len(self._chunk), crc32(self._chunk)
        at, length = self._put(records.Chunk("zstd", data, last_ns, first_ns, checksum, size))
        # a sixth of the file, which the specification lets go and readers do not: Foxglove's (@mcap/core,
        # ChunkCursor) raises at a chunk with messages and no index, mcap before 1.4 finds no message in it
        places, index_at = {}, self._stream.tell()
        for topic in inside:
            places[topic.channel.id] = self._stream.tell()
            count, index_bytes = len(topic.index), 8 * len(topic.index)
            head = (Opcode.MESSAGE_INDEX, 6 + index_bytes, topic.channel.id, index_bytes)
            self._stream.write(struct.pack(f"<BQHI{count}Q", *head, *topic.index))
            topic.written += count // 2
            topic.index.clear()
        index_length = self._stream.tell() - index_at
        index = records.ChunkIndex(
            length, at, "zstd", len(data), last_ns, index_length, places, first_ns, size
        )
        self._chunks.append(_bytes(index))
        before_ns = self._span_ns or (first_ns, last_ns)
        self._span_ns = min(first_ns, before_ns[0]), max(last_ns, before_ns[1])
        self._chunk.clear()

    def finish(self) -> None:
        """Ends the last chunk and writes index, summary and footer; does not close the stream."""
        self.end_chunk()
        self._put(records.DataEnd(0))
        channels = [topic.channel for topic in self._topics]
        before = map(_bytes, (*self._schemas.values(), *channels, self._statistics()))
        start = self._stream.tell()
        data = b"".join((*before, *self._chunks, *map(_bytes, self._metadata)))
        footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, 0)  # what its checksum covers
        self._stream.write(data)
        self._put(records.Footer(start, 0, crc32(footer, crc32(data))))
        self._stream.write(MCAP0_MAGIC)

    def _statistics(self) -> records.Statistics:
        """Record of what the chunks hold: number of messages by channel, first and last log time, or 0."""
        counts = {topic.channel.id: topic.written for topic in self._topics if topic.written}
        first_ns, last_ns = self._span_ns or (0, 0)
        return records.Statistics(
            attachment_count=0,
            channel_count=len(self._topics),
            channel_message_counts=counts,
            chunk_count=len(self._chunks),
            message_count=sum(counts.values()),
            message_end_time=last_ns,
            message_start_time=first_ns,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _put(self, record: records.McapRecord) -> tuple[int, int]:
        """Place and length of a record that is written now."""
        at, data = self._stream.tell(), _bytes(record)
        self._stream.write(data)
        return at, len(data)


def _bytes(record: records.McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


class RunWriter:
    """Writes messages, or payloads as they come from the wire, to a new file; for one thread.

    A process that is killed leaves everything up to the last `end_chunk`, a host without power up to the last
    `flush`: of a file without its summary the reader takes the whole chunks.

    Raises:
        RecordingError: the file exists already, or can not be created.
        RunError: a later write fails, e.g. because the disk is full.
    """

    def __init__(self, path: Path, mode: int = 0o666) -> None:
        """`mode`: of the new file, less what the user's umask takes."""
        self.malformed = 0
        """Payloads that were no message of their topic, and so were not written."""
        self.written = 0
        """Messages that were."""
        self._path = path
        self._topics: dict[str, _Topic] = {}
        try:
            # O_EXCL: a measurement is never overwritten
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode)
            self._file = os.fdopen(descriptor, "wb")
        except OSError as error:
            raise RecordingError(
                f"{path}: {error.strerror}, expected a new file in an existing folder"
            ) from error
        with self._failing_as_run_error():
            self._mcap = _ChunkedFile(self._file)

    def write(self, key: str, payload: bytes, receive_ns: int) -> None:
        """Adds one payload of the topic that `key` names, received at `receive_ns` of the local clock.

        It is decoded and validated in full, which costs a third of the call: what stands in the file is a
        message of its schema. A payload that is not is counted in `malformed`.

        Raises:
            ValueError: `key` is no key of the topic table.
            RunError: the file can not be written.
        """
        topic = self._topics.get(key) or self._add_topic(key)
        try:
            message = decode(topic.kind, payload)
        except CodecError:
            self.malformed += 1
            return
        self._add(topic, message, receive_ns)

    def write_message(self, key: str, message: Message, receive_ns: int) -> None:
        """Adds a message.

        Raises:
            ValueError: `key` is no key of the topic table.
        """
        self._add(self._topics.get(key) or self._add_topic(key), message, receive_ns)

    def _add(self, topic: _Topic, message: Message, receive_ns: int) -> None:
        """Writes a message as JSON and counts it; raises RunError where that fails."""
        data = message.__pydantic_serializer__.to_json(message)
        try:
            self._mcap.add(topic, message.sequence % 2**32, receive_ns, max(message.stamp_ns, 0), data)
        except OSError as error:
            raise self._run_error(error) from error
        self.written += 1

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Adds a named table of texts, e.g. the settings or the software versions."""
        with self._failing_as_run_error():
            self._mcap.add_metadata(name, dict(values))

    def end_chunk(self) -> None:
        """Ends the chunk and hands it to the operating system: it survives the end of this process."""
        with self._failing_as_run_error():
            self._mcap.end_chunk()
            self._file.flush()

    def flush(self) -> None:
        """Ends the chunk and puts everything on the disk: it survives a loss of power."""
        self.end_chunk()
        with self._failing_as_run_error():
            os.fsync(self._file.fileno())

    def close(self) -> None:
        """Writes last chunk and summary, puts them on the disk and closes; idempotent. Raises RunError."""
        if self._file.closed:
            return
        with self._failing_as_run_error(), self._file:
            self._mcap.finish()
            self._file.flush()
            os.fsync(self._file.fileno())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _add_topic(self, key: str) -> _Topic:
        """Declares and keeps the channel of a key; raises ValueError where it is none of the topic table."""
        parsed = parse_key(key)
        if parsed is None:
            raise ValueError(f"{key!r}: expected forefeel/cell/axis/topic with a topic of the table")
        cell, axis, topic = parsed
        self._topics[key] = self._mcap.topic(
            topic.key(cell, axis), topic.message, {"cell": cell, "axis": axis}
        )
        return self._topics[key]

    @contextmanager
    def _failing_as_run_error(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise self._run_error(error) from error

    def _run_error(self, error: OSError) -> RunError:
        return RunError(f"{self._path}: {error.strerror or error}, the run is not recorded any more")
