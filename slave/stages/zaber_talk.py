"""Commands to a Zaber device and its replies, over a byte stream. One thread."""

from collections import Counter
from collections.abc import Sequence
from math import isfinite, nan

from forefeel.common.clock import Clock
from forefeel.common.errors import DeviceError
from forefeel.common.hardware.conversation import Timed
from forefeel.common.hardware.link import DeviceLink
from forefeel.common.hardware.streams import ByteStream
from forefeel.common.hardware.zaber import Alert, CommandEncoder, Message, Parser, Reply, in_words, is_fault

_SLACK_S = 0.05  # of the device, the adapter and the host, beside the bytes' own time
_BITS = 10
_USUAL_REPLY = 40
_MOST_SILENT = 3


class SilenceError(DeviceError):
    """The device does not answer."""


class RejectedError(DeviceError):
    """The device does not take a command; `reason`: its word for why, BADDATA for example."""

    def __init__(self, text: str, reason: str) -> None:
        super().__init__(text)
        self.reason = reason


class ZaberTalk:
    """One device and one of its axes.

    Attributes:
        parser: what it dropped tells a wrong baud rate from silence.
        others: addresses of other devices that spoke.
    """

    def __init__(
        self, stream: ByteStream, clock: Clock, address: tuple[int, int], baud: int, link: DeviceLink
    ) -> None:
        self._stream, self._clock, self._byte_s = stream, clock, _BITS / baud
        self._device, self._axis = address
        self._name, self._counters = link.name, link.counters
        self._encoder = CommandEncoder(self._device)
        self._silent = 0
        self._dropped: Counter[str] = Counter()
        self.parser = Parser(checksums=False)
        self.others: set[int] = set()

    def ask(self, text: str, axis: int | None = None, tries: int = _MOST_SILENT) -> str:
        """The data of the reply; a lost one is asked for again.

        Raises:
            SilenceError: no answer that often.
            RejectedError: the device does not take it.
        """
        for _ in range(tries):
            (reply,) = self.exchange([text], axis, patient=True)
            if reply is not None:
                return self.accepted(text, reply.value).data
        raise SilenceError(f"{self._name}: no answer to {text!r}")

    def number(self, text: str, axis: int | None = None) -> float:
        """As `ask`, of a reply that is one number; DeviceError if it is none."""
        return self.as_number(text, self.ask(text, axis))

    def as_number(self, text: str, data: str) -> float:
        """The number in a reply; DeviceError if it is none, or not finite."""
        try:
            value = float(data)
        except ValueError:
            value = nan
        if not isfinite(value):
            raise DeviceError(f"{self._name}: {data[:40]!r} for {text!r}: expected one number")
        return value

    def accepted(self, text: str, reply: Reply) -> Reply:
        """The reply, unless it is a rejection: RejectedError."""
        if not reply.accepted:
            raise RejectedError(f"{self._name}: {text!r} rejected: {reply.data}", reply.data)
        return reply

    def exchange(
        self, texts: Sequence[str], axis: int | None = None, patient: bool = False
    ) -> list[Timed[Reply] | None]:
        """Sends commands in one go; their replies, None where none came in time.

        Raises:
            SilenceError: nothing came three times in a row (unless `patient`).
            DeviceError: the device is gone; or an alert said that the axis has a fault.
        """
        sent_ns, ids = self._clock.now_ns(), self.post(texts, axis)
        found = self._collect(ids, sent_ns)
        replies = [found.get(each) for each in ids]
        self._counters["lost_replies"] += replies.count(None)
        self._silent = 0 if found else self._silent + 1
        if self._silent >= _MOST_SILENT and not patient:
            raise SilenceError(f"{self._name}: no answer {_MOST_SILENT} times in a row")
        return replies

    def post(self, texts: Sequence[str], axis: int | None = None) -> list[int]:
        """Sends commands without waiting; their message ids."""
        lines = [self._encoder.encode(self._axis if axis is None else axis, text) for text in texts]
        data = b"".join(line for _, line in lines)
        self._counters["commands"] += len(lines)
        self._sent = len(data)
        self._stream.write(data)
        return [message_id for message_id, _ in lines]

    def _collect(self, ids: Sequence[int], sent_ns: int) -> dict[int, Timed[Reply]]:
        wire_s = (self._sent + _USUAL_REPLY * len(ids)) * self._byte_s
        deadline_ns = sent_ns + int((wire_s + _SLACK_S) * 1e9)
        found: dict[int, Timed[Reply]] = {}
        while len(found) < len(ids):
            messages = self.parser.feed(self._stream.read())
            now_ns = self._clock.now_ns()
            for message in messages:
                self._sort(message, ids, found, Timed((sent_ns + now_ns) // 2, None, message))
            if now_ns >= deadline_ns:
                break
        self._count_dropped()
        return found

    def _sort(
        self, message: Message, ids: Sequence[int], found: dict[int, Timed[Reply]], timed: Timed[Message]
    ) -> None:
        """Replies to what was asked are stamped half way between question and answer."""
        if message.device != self._device:
            self.others.add(message.device)
            self._counters["foreign"] += 1
        elif isinstance(message, Reply) and message.message_id is not None and message.message_id in ids:
            found[message.message_id] = Timed(timed.host_ns, None, message)
        elif isinstance(message, Reply):
            self._counters["unexpected_replies"] += 1
        elif isinstance(message, Alert):
            self._counters["alerts"] += 1
            if message.axis == self._axis and is_fault(message.warning):
                raise DeviceError(f"{self._name}: {in_words(message.warning)}, says an alert")

    def _count_dropped(self) -> None:
        fresh = self.parser.dropped - self._dropped
        if fresh:
            self._counters.update(fresh)
            self._dropped = self.parser.dropped.copy()
