"""State of a cell for the page: its axes, time of the last message, refused payloads. Pure, bounded."""

from collections import Counter

from forefeel.common.bus import observed
from forefeel.common.errors import CodecError
from forefeel.common.messages import Message
from forefeel.common.topics import COMMAND, MASTER_HEARTBEAT, SLAVE_HEARTBEAT, Topic, parse_key
from forefeel.dashboard.axis_view import AxisView

MOST_AXES = 16  # axes that are shown
BEYOND = f"refused_beyond_{MOST_AXES}_axes"
UNREAD = {COMMAND.name, MASTER_HEARTBEAT.name, SLAVE_HEARTBEAT.name}
"""Topics whose content is not shown, or stands in a message that is: decoding it would be in vain."""


class CellView:
    """Fed with payloads from the network, or with messages of a recording.

    Attributes:
        axes: by name, in the order in which they were heard first.
        heard_ns: when anything was heard last, None before.
        refused: payloads that were no message of their topic, and those of axes beyond the first `MOST_AXES`.
    """

    def __init__(self) -> None:
        self.axes: dict[str, AxisView] = {}
        self.heard_ns: int | None = None
        self.refused: Counter[str] = Counter()

    def hear(self, key: str, payload: bytes, receive_ns: int) -> None:
        """Decodes a payload of the network and takes its messages for its axis; counts a malformed one,
        ignores an unknown key. Of topics in `UNREAD` only the receipt is noted.
        """
        parsed = parse_key(key)
        if parsed is None:
            return
        _, axis, topic = parsed
        if topic.name in UNREAD:
            self._note_receipt(receive_ns)
            return
        try:
            messages = observed(topic, payload, receive_ns)
        except CodecError:
            self.refused["malformed"] += 1
            return
        for message, message_ns in messages:
            self.take(axis, topic, message, message_ns)

    def take(self, axis: str, topic: Topic[Message], message: Message, receive_ns: int) -> None:
        """Hands a message to the view of its axis, a new one for a new axis; beyond `MOST_AXES` axes only
        counts it as refused.
        """
        view = self.axes.get(axis)
        if view is None:
            if len(self.axes) == MOST_AXES:
                self.refused[BEYOND] += 1
                return
            view = self.axes[axis] = AxisView()
        self._note_receipt(receive_ns)
        view.take(topic, message, receive_ns)

    def _note_receipt(self, receive_ns: int) -> None:
        self.heard_ns = receive_ns if self.heard_ns is None else max(receive_ns, self.heard_ns)
