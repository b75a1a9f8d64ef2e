"""The records of an MCAP file in order (library `mcap`); of a killed writer's file, those before its cut."""

import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import lz4.frame
import zstandard
from mcap.exceptions import McapError
from mcap.records import Chunk, McapRecord
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC

from forefeel.common.errors import RecordingError
from forefeel.common.recording.recording import reason_of, room_of

DAMAGE = (struct.error, ValueError, OverflowError, MemoryError, RuntimeError, McapError, zstandard.ZstdError)
"""Exceptions of the library and its decompressors for bytes that are no record."""


class _CutError(Exception):
    """The file ends inside a record."""


class _WholeReads:
    """A file for the library, which would take what is left of a file as a whole record."""

    def __init__(self, file: BinaryIO, size: int) -> None:
        self._file, self._left = file, size - file.tell()

    def read(self, length: int) -> bytes:
        """Reads all `length` bytes; raises _CutError where fewer are left, ValueError for a negative one."""
        if length < 0:
            raise ValueError("a record shorter than its head")
        if length > self._left:
            raise _CutError
        self._left -= length
        return self._file.read(length)


class RecordReader:
    """Iterates once over the records: each chunk, followed by the records in it.

    Raises:
        RecordingError: not an MCAP file, or damaged: a checksum or a record that does not fit.
    """

    def __init__(self, file: BinaryIO, path: Path) -> None:
        self._file, self._path = file, path
        self.at = 0
        """The byte where the record, or the chunk that holds it, begins."""
        self.truncated = True
        """True if the file ends before its footer; known after the iteration."""
        if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise RecordingError(f"{path}: does not start as an MCAP file, expected one")

    def __iter__(self) -> Iterator[McapRecord]:
        room = room_of(self._path)
        stream: Any = _WholeReads(self._file, self._path.stat().st_size)
        self.at = self._file.tell()
        try:
            for record in StreamReader(stream, skip_magic=True, emit_chunks=True).records:
                yield record
                if isinstance(record, Chunk):
                    yield from unpacked(record, room)
                    room -= record.uncompressed_size
                self.at = self._file.tell()
            self.truncated = False
        except _CutError:
            return
        except DAMAGE as error:
            raise damaged(self._path, self.at, error) from error


def damaged(path: Path, at: int, error: BaseException) -> RecordingError:
    """The error for one of `DAMAGE` in the record at that byte."""
    return RecordingError(f"{path}: damaged at byte {at} ({reason_of(error)}), expected a record")


def unpacked(chunk: Chunk, room: int) -> list[McapRecord]:
    """The records in a chunk, which may be compressed by zstd or lz4. Raises one of `DAMAGE` where it is
    damaged, or would take over `room` bytes.
    """
    size = chunk.uncompressed_size
    if size > room:
        raise ValueError(f"a chunk of {len(chunk.data)} bytes unpacks to {size}, allowed {room}")
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
    return breakup_chunk(replace(chunk, data=data, compression=""), validate_crc=True)
