"""Reading one file makes a conversion and gives its counts; a thread of its own waits for them."""

from forefeel.common.clock import Clock, MonotonicClock
from forefeel.common.errors import DeviceError
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.devices.shared.conversation import Conversation, Steps
from forefeel.devices.shared.force_scale import ForceScale, Native, StuckWatch
from forefeel.devices.shared.load_cell import QueuedLoadCell
from forefeel_iio.settings import IioSettings


class IioLoadCell(QueuedLoadCell):
    """Load-cell port. A thread of its own waits for the conversions, so that the control loop never does."""

    def __init__(self, settings: IioSettings, clock: Clock | None = None) -> None:
        link = DeviceLink(f"load cell iio at {settings.file}")
        super().__init__(link, settings.full_scale_n, 3.0 / settings.rate_hz + 0.02)
        self._settings, self._clock = settings, clock or MonotonicClock()

    def _open_s(self) -> float:
        return 3.0

    def _converse(self, conversation: Conversation) -> Steps:
        s, watch = self._settings, StuckWatch(noisy=True)
        self._force = ForceScale(s.full_scale_n, s.sign, s.newton_per_count, None, watch, self.link.counters)
        self._converted()
        for step in (LinkState.OPEN, LinkState.IDENTIFIED, LinkState.CONFIGURED, LinkState.READY):
            self.link.advance(step)
        while not conversation.stopping:
            self._measured(self._converted())
            yield 1.0 / s.rate_hz

    def _converted(self) -> Native:
        try:
            counts = int(self._settings.file.read_text(encoding="ascii"))
        except (OSError, ValueError) as error:
            raise DeviceError(f"{self.link.name}: {error}; expected a file with an integer") from error
        return Native(counts - self._settings.zero_counts, self._clock.now_ns())
