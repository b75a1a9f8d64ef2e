"""The handle with a voice coil and an encoder behind a microcontroller on a serial port."""

from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from math import isfinite

from forefeel.common.clock import Clock, MonotonicClock
from forefeel.common.errors import DeviceError
from forefeel.common.hardware.coil import Button
from forefeel.common.hardware.conversation import Conversation
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.common.hardware.streams import ByteStream, SerialStream
from forefeel.common.messages import Grip
from forefeel.master.handles.coil_talk import CoilTalk, CurrentSetpoint
from forefeel.master.handles.port import HandleReading, Indication
from forefeel.master.settings import CoilSettings

_OPEN_S = 3.0
_CARRIED_S = 0.005
_READ_S = 0.25  # of the watchdog's time: how long a read may wait for a byte


class CoilHandle:
    """Handle port on a coil. `read`, `render` and `show` never wait: a thread of its own owns the device.

    Any fault (silence, a flag of the device, a haptic loop that stands still) takes the force away and the
    readings with it, until the handshake has been done again and `rearm` is called.

    Attributes:
        link: its state, what the device is, and what was counted.
    """

    finished = False
    clutched_out_s = 0.0
    """A hand does not say whether it means to wait."""

    def __init__(
        self,
        settings: CoilSettings,
        clock: Clock | None = None,
        open_stream: Callable[[], ByteStream] | None = None,
    ) -> None:
        self._settings, self._clock = settings, clock or MonotonicClock()
        self.link = DeviceLink(f"handle coil_serial on {settings.port}")
        self._talk = CoilTalk(settings, self.link)
        self._open_stream = open_stream or self._serial
        self._limit_ma = round(settings.max_current_a * 1e3)
        self._conversation = Conversation(self.link, self._converse)

    @property
    def counters(self) -> Counter[str]:
        """Frames, faults, and what was lost or dropped."""
        return self.link.counters

    @property
    def pressed_anew(self) -> bool:
        """See `Handle`."""
        return self.link.state is LinkState.CONFIGURED and self._talk.pressed_anew

    def open(self) -> None:
        """Opens the port and shakes hands.

        Raises:
            DeviceSetupError: no such port, or no coil handle of this protocol behind it.
            DeviceError: it does not get ready.
        """
        self._conversation.start(_OPEN_S)

    def close(self) -> None:
        """Takes the current away and lets the port go; idempotent."""
        self._talk.forget_wish()
        self._conversation.stop()

    def rearm(self) -> None:
        """The explicit act after a fault; no current before the next `render`.

        Raises:
            DeviceError: the handshake has not been done again.
        """
        self._talk.forget_wish()
        self.link.rearm()

    def read(self, now_ns: int) -> HandleReading:
        """The newest state, carried on by its velocity for at most 5 ms.

        Raises:
            DeviceError: a fault, now or before, that nobody has re-armed after.
        """
        self.link.require_ready()
        newest = self._talk.newest
        assert newest is not None
        age_s = max(0.0, (now_ns - newest.stamp_ns) * 1e-9)
        if age_s > self._settings.watchdog_s:
            self.link.fault(f"no state for {age_s * 1e3:.0f} ms")
            self.link.require_ready()
        per_m, state = self._settings.sign * self._settings.counts_per_m, newest.state
        pressed = Button.DEADMAN in state.buttons
        grip = Grip.OPEN if Button.GRIPPER in state.buttons else Grip.CLOSED
        position_m = (state.counts + state.velocity * min(age_s, _CARRIED_S)) / per_m
        velocity_m_s = state.velocity / per_m if age_s <= _CARRIED_S else 0.0
        stop = Button.ESTOP in state.buttons
        return HandleReading(position_m, velocity_m_s, pressed, grip, estop=stop)

    def render(self, force_n: float, now_ns: int) -> float:
        """The current of a force, within the limit and to the milliampere; the force of that current.

        Raises:
            DeviceError: as `read`; there is no force then.
        """
        self.link.require_ready()
        per_ampere = self._settings.newton_per_ampere
        asked_ma = round(force_n / per_ampere * 1e3) if isfinite(force_n) else 0
        current_ma = max(-self._limit_ma, min(self._limit_ma, asked_ma))
        self._talk.setpoint = CurrentSetpoint(self._settings.sign * current_ma, now_ns)
        return current_ma * 1e-3 * per_ampere

    def show(self, indication: Indication) -> None:
        """On the lamp and the display, with the next command."""
        self._talk.shown = indication

    def _serial(self) -> ByteStream:
        return SerialStream(self._settings, _READ_S * self._settings.watchdog_s)

    def _converse(self, conversation: Conversation) -> None:
        """The device's thread; a fault that the haptic thread found (the link is closed) ends it, too."""
        stream = self._open_stream()
        try:
            self._greet(stream)
            while not conversation.stopping and self.link.state is not LinkState.CLOSED:
                self._round(stream)
                if self._talk.settled:
                    conversation.settled()
        finally:
            self._part(stream)

    def _greet(self, stream: ByteStream) -> None:
        self.link.advance(LinkState.OPEN)
        stream.write(self._talk.begin(self._clock.now_ns()))

    def _round(self, stream: ByteStream) -> None:
        answer = self._talk.hear(stream.read(), self._clock.now_ns())
        if answer:
            stream.write(answer)

    def _part(self, stream: ByteStream) -> None:
        with suppress(DeviceError):  # it is gone: its own watchdog takes the current away
            stream.write(self._talk.farewell())
        stream.close()
