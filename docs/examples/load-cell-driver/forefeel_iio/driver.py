"""Reading one file makes a conversion and gives its counts; a thread of its own waits for them."""

from collections.abc import Sequence

from forefeel.common.clock import Clock, MonotonicClock
from forefeel.common.errors import DeviceError
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.common.slots import BoundedQueue
from forefeel.devices.shared.conversation import Conversation, Steps
from forefeel.devices.shared.force_scale import ForceScale, Native, StuckWatch
from forefeel.slave.load_cell import LoadCellReading
from forefeel_iio.settings import IioSettings


class IioLoadCell:
    """Load-cell port. A thread of its own waits for the conversions, so that the control loop never does."""

    def __init__(self, settings: IioSettings, clock: Clock | None = None) -> None:
        self.full_scale_n = settings.full_scale_n
        self.link, self.stale_s = (
            DeviceLink(f"load cell iio at {settings.file}"),
            3.0 / settings.rate_hz + 0.02,
        )
        self._settings, self._clock = settings, clock or MonotonicClock()
        self._queue, self._watch = BoundedQueue[LoadCellReading](1024), StuckWatch(noisy=True)
        self._conversation = Conversation(self.link, self._converse)

    def open(self) -> None:
        """Returns when the cell has given a value; DeviceError says why it has not."""
        self._conversation = Conversation(self.link, self._converse)
        self._conversation.start(timeout_s=3.0)

    def close(self) -> None:
        """See the port."""
        self._conversation.stop()

    def rearm(self) -> None:
        """See the port: what was measured before the fault is forgotten."""
        if self.link.inhibited is not None:
            self._queue.drain()
            self.link.rearm()

    def read(self, now_ns: int, recording_time_s: float | None) -> Sequence[LoadCellReading]:
        """See the port."""
        self.link.require_ready()
        return self._queue.drain()

    def _converse(self, conversation: Conversation) -> Steps:
        s = self._settings
        scale = ForceScale(s.full_scale_n, s.sign, s.newton_per_count, None, self._watch, self.link.counters)
        self._measured()
        for step in (LinkState.OPEN, LinkState.IDENTIFIED, LinkState.CONFIGURED, LinkState.READY):
            self.link.advance(step)
        while not conversation.stopping:
            native = self._measured()
            if self.link.state is LinkState.READY:
                self._queue.put(scale.reading(scale.checked(native)))
                self.link.exchanged()
            yield 1.0 / s.rate_hz

    def _measured(self) -> Native:
        try:
            counts = int(self._settings.file.read_text(encoding="ascii"))
        except (OSError, ValueError) as error:
            raise DeviceError(f"{self.link.name}: {error}; expected a file with an integer") from error
        return Native(counts - self._settings.zero_counts, self._clock.now_ns())
