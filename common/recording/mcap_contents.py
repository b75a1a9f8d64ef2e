"""What a run's MCAP file holds, sorted by axis and topic, the messages still as bytes."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from mcap.records import Attachment, Channel, Metadata, Statistics

from forefeel.common.errors import RecordingError
from forefeel.common.recording.mcap_records import MessageRecord, Record, RecordReader
from forefeel.common.recording.recording import opened
from forefeel.common.topics import parse_key


@dataclass(frozen=True, slots=True)
class Stream:
    """The messages of one axis and topic in the order of the file: receive stamps in ns, and JSON."""

    log_ns: list[int] = field(default_factory=list)
    payloads: list[bytes] = field(default_factory=list)


@dataclass(slots=True)
class Contents:
    """The streams by (axis, topic name), and what else the file holds; `cell` is None without a stream."""

    path: Path
    truncated: bool = True
    cell: str | None = None
    streams: dict[tuple[str, str], Stream] = field(default_factory=dict)
    metadata: dict[str, Mapping[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    _channels: dict[int, Stream] = field(default_factory=dict)
    _messages: int = 0

    def add(self, record: Record) -> None:
        """Takes the next record of the file."""
        match record:
            case MessageRecord():
                self._add_message(record)
            case Channel():
                self._channels[record.id] = self._stream_of(record)
            case Metadata():
                self.metadata[record.name] = record.metadata
            case Attachment():
                self.attachments[record.name] = record.data
            case Statistics() if record.message_count != self._messages:
                counts = f"it holds {self._messages} messages, its statistics say {record.message_count}"
                raise RecordingError(f"{self.path}: damaged, {counts}")

    def _stream_of(self, channel: Channel) -> Stream:
        ours = parse_key(channel.topic)
        if ours is None or channel.message_encoding != "json":
            return Stream()  # another program's channel: passed over
        cell, axis, topic = ours
        if self.cell not in (None, cell):
            raise RecordingError(f"{self.path}: cells {self.cell!r} and {cell!r}, expected one cell")
        self.cell = cell
        return self.streams.setdefault((axis, topic.name), Stream())

    def _add_message(self, record: MessageRecord) -> None:
        stream = self._channels.get(record.channel_id)
        if stream is None:
            raise RecordingError(
                f"{self.path}: damaged, channel {record.channel_id} is used but not declared"
            )
        stream.log_ns.append(record.log_ns)
        stream.payloads.append(record.payload)
        self._messages += 1


def read_contents(path: Path) -> Contents:
    """The contents of an MCAP file; of a killed writer's file, what is whole.

    Raises:
        RecordingError: unreadable, not MCAP, damaged, or of several cells.
    """
    contents = Contents(path)
    with opened(path) as file:
        records = RecordReader(file, path)
        for record in records:
            contents.add(record)
    contents.truncated = records.truncated
    return contents
