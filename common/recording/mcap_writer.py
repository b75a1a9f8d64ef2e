"""Writes a run to MCAP (https://mcap.dev/spec): a channel per axis and topic, JSON messages and their schema.

Chunks are not compressed, so that every MCAP reader reads the file without a decompressor. `mcap compress`
shrinks it later, and the reader takes that too.
"""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from mcap.writer import CompressionType, Writer

from forefeel.common.codec import decode
from forefeel.common.errors import CodecError, RecordingError, RunError
from forefeel.common.messages import Message
from forefeel.common.topics import Topic, parse_key


@dataclass(frozen=True, slots=True)
class _Channel:
    id: int
    kind: type[Message]


class RunWriter:
    """Writes payloads as they come from the wire; for one thread.

    A run that is killed keeps everything up to the last `flush`; call it about once a second.

    Raises:
        RecordingError: the file exists already, or can not be created.
        RunError: a later write fails, e.g. because the disk is full.
    """

    def __init__(self, path: Path) -> None:
        self.malformed = 0
        """Payloads that were no message of their topic, and so were not written."""
        self.written = 0
        """Messages that were."""
        self._path = path
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, _Channel] = {}
        try:
            self._file = path.open("xb")  # a measurement is never overwritten
        except OSError as error:
            raise RecordingError(
                f"{path}: {error.strerror}, expected a new file in an existing folder"
            ) from error
        self._mcap = Writer(self._file, compression=CompressionType.NONE)
        with self._failing_as_run_error():
            self._mcap.start()

    def write(self, key: str, payload: bytes, receive_ns: int) -> None:
        """Adds one payload of the topic that `key` names, received at `receive_ns` of the local clock.

        It is decoded and validated in full, which costs a third of the call: what stands in the file is a
        message of its schema. A payload that is not is counted in `malformed`.

        Raises:
            ValueError: `key` is no key of the topic table.
        """
        channel = self._channels.get(key) or self._add_channel(key)
        try:
            message = decode(channel.kind, payload)
        except CodecError:
            self.malformed += 1
            return
        self._add(channel, message, receive_ns)

    def write_message(self, key: str, message: Message, receive_ns: int) -> None:
        """Adds a message that never was a payload.

        Raises:
            ValueError: `key` is no key of the topic table.
        """
        self._add(self._channels.get(key) or self._add_channel(key), message, receive_ns)

    def _add(self, channel: _Channel, message: Message, receive_ns: int) -> None:
        with self._failing_as_run_error():
            self._mcap.add_message(
                channel.id,
                log_time=receive_ns,
                data=message.__pydantic_serializer__.to_json(message),
                publish_time=max(message.stamp_ns, 0),
                sequence=message.sequence % 2**32,
            )
        self.written += 1

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Adds a named table of texts, e.g. the settings or the software versions."""
        with self._failing_as_run_error():
            self._mcap.add_metadata(name, dict(values))

    def flush(self) -> None:
        """Ends the chunk and puts everything on the disk: it survives a kill and a loss of power."""
        with self._failing_as_run_error():
            self._mcap.flush()  # type: ignore[no-untyped-call]
            os.fsync(self._file.fileno())

    def close(self) -> None:
        """Writes index and statistics and closes the file; idempotent."""
        if self._file.closed:
            return
        with self._failing_as_run_error(), self._file:
            self._mcap.finish()  # type: ignore[no-untyped-call]
            self._file.flush()
            os.fsync(self._file.fileno())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _add_channel(self, key: str) -> _Channel:
        parsed = parse_key(key)
        if parsed is None:
            raise ValueError(f"{key!r}: expected forefeel/cell/axis/topic with a topic of the table")
        cell, axis, topic = parsed
        metadata = {"cell": cell, "axis": axis}
        channel = _Channel(
            self._mcap.register_channel(topic.key(cell, axis), "json", self._schema(topic), metadata),
            topic.message,
        )
        self._channels[key] = channel
        return channel

    def _schema(self, topic: Topic[Message]) -> int:
        name = topic.message.__name__
        if name not in self._schemas:
            schema = json.dumps(topic.message.model_json_schema(mode="serialization"))
            self._schemas[name] = self._mcap.register_schema(name, "jsonschema", schema.encode())
        return self._schemas[name]

    @contextmanager
    def _failing_as_run_error(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise RunError(
                f"{self._path}: {error.strerror or error}, the run is not recorded any more"
            ) from error
