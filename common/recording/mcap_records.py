"""The records of an MCAP file in order, also of one whose writer was killed.

The library's readers stop with various errors at the first byte that is missing, or hand out half a record.
Here a record is whole, or it is the end of the file. The library parses the few large records; the
many messages are cut in place.
"""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Statistics
from mcap.writer import MCAP0_MAGIC

from forefeel.common.errors import RecordingError
from forefeel.common.recording.recording import room_of

HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")

DAMAGE = (struct.error, ValueError, OverflowError, MemoryError, RuntimeError, McapError, zstandard.ZstdError)
"""What the library and its decompressors raise for bytes that are no record."""

_PARSED = {
    Opcode.CHANNEL: Channel.read,
    Opcode.METADATA: Metadata.read,
    Opcode.ATTACHMENT: Attachment.read,
    Opcode.STATISTICS: Statistics.read,
}


class MessageRecord(NamedTuple):
    """One message: its channel, when it was received, its bytes."""

    channel_id: int
    log_ns: int
    payload: bytes


Record = MessageRecord | Channel | Metadata | Attachment | Statistics


class RecordReader:
    """Iterates once over the records that a run is made of, those inside chunks too.

    Raises:
        RecordingError: not an MCAP file, or damaged: a checksum or a record that does not fit.
    """

    def __init__(self, file: BinaryIO, path: Path) -> None:
        self._file = file
        self._path = path
        self._size = path.stat().st_size
        self._room = room_of(path)
        self.truncated = True
        """Whether the file ends before its footer; known after the iteration."""
        if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise RecordingError(f"{path}: does not start as an MCAP file, expected one")

    def __iter__(self) -> Iterator[Record]:
        while (whole := self._next()) is not None:
            opcode, start, body = whole
            if opcode == Opcode.FOOTER:
                self.truncated = self._file.read() != MCAP0_MAGIC
                return
            try:
                yield from self._parse(opcode, body)
            except DAMAGE as error:
                reason = str(error) or type(error).__name__
                raise RecordingError(
                    f"{self._path}: damaged at byte {start} ({reason}), expected a record"
                ) from error

    def _next(self) -> tuple[int, int, bytes] | None:
        start = self._file.tell()
        head = self._file.read(HEAD.size)
        if len(head) < HEAD.size:
            return None
        opcode, length = HEAD.unpack(head)
        if length > self._size - self._file.tell():
            return None
        return opcode, start, self._file.read(length)

    def _parse(self, opcode: int, body: bytes) -> Iterator[Record]:
        if opcode == Opcode.CHUNK:
            data = unpacked(body, self._room)
            self._room -= len(data)
            yield from records_of_chunk(data)
        elif opcode == Opcode.MESSAGE:
            yield _message(body, 0, len(body))
        elif opcode in _PARSED:
            yield _PARSED[Opcode(opcode)](ReadDataStream(BytesIO(body)))


def unpacked(body: bytes, room: int) -> bytes:
    """The records in the body of a chunk record.

    Raises one of `DAMAGE` where it is none, or unpacks to more than `room` bytes.
    """
    chunk = Chunk.read(ReadDataStream(BytesIO(body)))
    size = chunk.uncompressed_size
    if size > room:
        raise ValueError(f"a chunk of {len(body)} bytes unpacks to {size}, allowed {room}")
    if chunk.compression == "zstd":
        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as stream:
            data = stream.read(size + 1)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
    elif chunk.compression:
        raise ValueError(f"compression {chunk.compression!r}, expected zstd, lz4 or none")
    else:
        data = chunk.data
    if len(data) != size:
        raise ValueError(f"a chunk of {size} bytes by its head has {len(data)} or more")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("checksum of a chunk")
    return data


def records_of_chunk(data: bytes) -> Iterator[MessageRecord | Channel]:
    """The messages and channels in what `unpacked` gave; raises one of `DAMAGE` where it is none."""
    at = 0
    while at < len(data):
        opcode, length = HEAD.unpack_from(data, at)
        start, at = at + HEAD.size, at + HEAD.size + length
        if at > len(data):
            raise ValueError("record longer than its chunk")
        if opcode == Opcode.MESSAGE:
            yield _message(data, start, at)
        elif opcode == Opcode.CHANNEL:
            yield Channel.read(ReadDataStream(BytesIO(data[start:at])))


def _message(data: bytes, start: int, stop: int) -> MessageRecord:
    channel_id, _, log_ns, _ = _MESSAGE.unpack_from(data, start)
    return MessageRecord(channel_id, log_ns, data[start + _MESSAGE.size : stop])
