"""The driver of a Zaber stage that speaks ASCII.

The device has no watchdog: it would finish any motion that it was given. So it is only ever given absolute
targets, at most `lead_s` ahead of the newest setpoint and of where it is: when the host dies it comes to rest
by itself.
"""

from datetime import date

from forefeel.common.clock import Clock, MonotonicClock
from forefeel.common.errors import DeviceError
from forefeel.common.hardware.calibration import StageCalibration
from forefeel.common.hardware.conversation import Conversation
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.common.hardware.streams import SerialStream
from forefeel.slave.stages.port import StageReading, require_finite
from forefeel.slave.stages.setpoint import Wanted
from forefeel.slave.stages.setpoint_mailbox import SetpointMailbox
from forefeel.slave.stages.settings import ZaberSettings
from forefeel.slave.stages.zaber_exchange import ZaberExchange
from forefeel.slave.stages.zaber_setup import OpenStream, connect, link_name, require_homed, require_travel

_OPEN_S = 8.0
_WATCH_S = 0.05


class ZaberStage:
    """Stage port on a Zaber device.

    Attributes:
        link: state, identity and counters.
        calibration: as it was loaded; None: there is none.
    """

    def __init__(
        self, settings: ZaberSettings, clock: Clock | None = None, open_stream: OpenStream = SerialStream
    ) -> None:
        self.settings, self._clock = settings, clock or MonotonicClock()
        self.link = DeviceLink(link_name(settings))
        self.calibration: StageCalibration | None = None
        self._open_stream = open_stream
        self._orders = SetpointMailbox()
        self._conversation: Conversation | None = None
        self._exchange: ZaberExchange | None = None

    # --- the control loop ---

    def open(self) -> None:
        """See `Stage`; waits for the handshake.

        Raises:
            DeviceSetupError: no such port, no such device, or it is not homed; the stage was not moved.
        """
        self.close()
        self._conversation = Conversation(self.link, self._converse)
        self._conversation.start(_OPEN_S)

    def close(self) -> None:
        """See `Stage`."""
        conversation, self._conversation = self._conversation, None
        if conversation is not None:
            conversation.stop()

    def rearm(self) -> None:
        """See `Stage`; what was commanded before is forgotten."""
        self._orders.hold()
        self.link.rearm()

    def command(self, position_m: float, velocity_m_s: float, now_ns: int) -> float:
        """See `Stage`; a number that is not finite is refused with `DeviceError`."""
        self.link.require_ready()
        require_finite(position_m, velocity_m_s)
        applied_m = self._within_travel(position_m)
        self._orders.command(Wanted(applied_m, velocity_m_s, now_ns))
        return applied_m

    def hold(self, now_ns: int) -> None:
        """See `Stage`."""
        del now_ns
        self._orders.hold()
        self.link.require_ready()

    def read(self, now_ns: int) -> StageReading:
        """See `Stage`."""
        self.link.require_ready()
        if self._exchange is None:
            raise DeviceError(f"{self.link.name}: used while closed, expected open() before")
        stamp_ns, _, reading = self._exchange.reading
        return reading.carried_on(stamp_ns, now_ns)

    def _within_travel(self, position_m: float) -> float:
        low_m, high_m = self.settings.travel_m
        return max(low_m, min(high_m, position_m))

    # --- the conversation's thread ---

    def _converse(self, conversation: Conversation) -> None:
        stream = self._open_stream(self.settings)
        try:
            self.link.advance(LinkState.OPEN)
            device = connect(self.settings, self._clock, self.link, stream, date.today())
            self.calibration = device.calibration
            require_travel(device, self.settings)
            require_homed(device.talk, self.link)
            exchange = ZaberExchange(device, self.settings, self._clock, self.link, self._orders)
            exchange.watch()  # before CONFIGURED: from there on anybody may re-arm, and read where it is
            self._exchange = exchange
            self._serve(conversation, exchange)
        finally:
            stream.close()

    def _serve(self, conversation: Conversation, exchange: ZaberExchange) -> None:
        """After a fault it looks on only, until somebody re-arms the link."""
        begun = self.link.inhibited is None
        self.link.advance(LinkState.CONFIGURED)
        try:
            if begun:
                exchange.begin()
                self.link.advance(LinkState.READY)
            conversation.settled()
            while not conversation.stopping:
                if self.link.state is not LinkState.READY:
                    exchange.watch()
                    conversation.pause(_WATCH_S)
                elif begun:
                    exchange.step()
                else:
                    exchange.begin()
                    begun = True
        except BaseException:
            exchange.try_stop()
            raise
        exchange.rest()
