"""Memory that a MAT-file of level 5 takes, before scipy reads it (MAT-File Format, MathWorks, chapter 1)."""

import struct
import zlib
from math import prod
from pathlib import Path
from typing import BinaryIO

from forefeel.common.recording.recording import require_room, unpacked

_MATRIX, _COMPRESSED = 14, 15  # kinds of elements
_TEXTS = {1: 0, 2: 2, 3: 3}  # elements before the matrices in a cell, a structure, an object; the last: names
_OPAQUE = 17  # class of a matrix without dimensions
_OBJECT_BYTES = 128  # of an empty array of numpy


def require_matlab_room(path: Path, file: BinaryIO) -> None:
    """Raises RecordingError where its variables, with what cells and structures hold, have no room."""
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
    """Goes from element to element, whatever length a matrix states, as scipy does."""
    words, at, size = struct.Struct(f"{order}II"), 0, 0

    def element() -> tuple[int, memoryview]:
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
