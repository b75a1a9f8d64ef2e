"""The handle port on an Inverse3 of Haply with a Verse Grip, by their maker's service."""

from contextlib import ExitStack, suppress
from math import isfinite
from typing import NamedTuple

from forefeel.common.clock import Clock, MonotonicClock
from forefeel.common.errors import ConfigurationError, DeviceError, DeviceSetupError
from forefeel.common.events.text import quantity
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.common.messages import Grip
from forefeel.devices.haply.service import (
    FULL_STATE,
    CursorState,
    GripStatus,
    Inverse3Status,
    VerseGrip,
    decoded,
    force_command,
)
from forefeel.devices.haply.settings import HaplySettings
from forefeel.devices.shared.conversation import Conversation, Pacer, Steps
from forefeel.devices.shared.handle import Deadman, ThreadedHandle
from forefeel.master.handle import HandleReading, Indication

# --- The host's half of the exchange: handshake, then a force each period.
_ASK_NS = 200_000_000  # ns between two requests of the status, which comes by itself but once
_PATIENCE_NS = 3_000_000_000  # ns for the handshake: a device that sleeps wakes up in less
_MORE_FORCE = 1.1  # of the limit, that the device may say it gives
_CARRIED_PERIODS = 2.0  # for which a state is carried on with its velocity; then the hand rests


class HandState(NamedTuple):
    """Place of the hand along the direction, and what it presses; `stamp_ns`: when it came, host's clock."""

    stamp_ns: int
    position_m: float
    velocity_m_s: float
    pressed: frozenset[str]


class ForceSetpoint(NamedTuple):
    """The force that the haptic loop wants, and when it wanted it."""

    force_n: float
    stamp_ns: int


_NO_FORCE = ForceSetpoint(0.0, 0)


class HaplyTalk:
    """Exchange with one service after the other: `begin`, then `commands` and `hear` in turn in one thread.

    Attributes:
        newest: the newest state since the handshake began, None before.
        setpoint: the force of the next command; only ever sent while the link is READY.
        deadman: what it told since the handshake.
    """

    def __init__(self, settings: HaplySettings, link: DeviceLink) -> None:
        self._settings, self._link = settings, link
        self._watchdog_ns = round(settings.watchdog_s * 1e9)
        self.setpoint = _NO_FORCE
        self.begin(0)

    def begin(self, now_ns: int) -> None:
        self._begun_ns, self._asked_ns, self._sent_ns = now_ns, 0, 0
        self._status, self._grip_status = Inverse3Status(ready=False), GripStatus(connected=False)
        self._missing = "no answer; expected Haply's service, 3.1 or later"
        self.newest: HandState | None = None
        self.deadman = Deadman()

    def commands(self, now_ns: int) -> list[str]:
        """Returns the messages to send now: a request of the status when due, and once the device is known
        the negative of the setpoint's force; 0 while the link is not READY, which wakes the device up.
        """
        due = list[str]()
        if now_ns - self._asked_ns >= _ASK_NS:
            self._asked_ns = now_ns
            due.append(FULL_STATE)
        if self._link.state >= LinkState.IDENTIFIED:
            ready = self._link.state is LinkState.READY
            due.append(self._command(-self.setpoint.force_n if ready else 0.0))
            self._sent_ns = now_ns
        return due

    def clear_setpoint(self) -> None:
        self.setpoint = _NO_FORCE

    def farewell(self) -> list[str]:
        """The last command: no force; empty before the device is known."""
        return [self._command(0.0)] if self._link.serial else []

    def _command(self, force_n: float) -> str:
        return force_command(self._link.serial, self._settings.direction, force_n)

    def hear(self, text: str | bytes, now_ns: int) -> None:
        """Takes a message of the service and stores the state of the device; ignores one without it. A device
        that is powered, calibrated and awake, with a grip connected, makes the link READY, or after a fault
        CONFIGURED.

        Raises:
            DeviceSetupError: several devices and no `device_id`, or another one than before.
            DeviceError: no message of this service, or a fault that the device reports.
        """
        message, wanted = decoded(text), self._settings.device_id
        devices = [device for device in message.inverse3 if wanted in (None, device.device_id)]
        if not devices:
            named = "an Inverse3" if wanted is None else f"the Inverse3 {wanted}"
            self._missing = f"the service does not have {named}; expected it plugged in"
            return
        if len(devices) > 1:
            ids = ", ".join(device.device_id for device in devices)
            raise DeviceSetupError(f"{self._settings.url}: several devices, {ids}; expected device_id")
        device = devices[0]
        self._identify(device.device_id)
        self._status = device.status or self._status
        pressed = self._pressed(message.wireless_verse_grip)
        if device.state is not None:
            self._take_state(device.state, pressed, now_ns)

    def require_in_time(self, now_ns: int) -> None:
        """Raises DeviceSetupError: the handshake is not done within 3 s; DeviceError: silence for the
        watchdog's time, or a haptic loop that stands still with a force.
        """
        if self._link.state < LinkState.CONFIGURED:
            if now_ns - self._begun_ns > _PATIENCE_NS:
                raise DeviceSetupError(f"{self._settings.url}: {self._missing}")
            return
        assert self.newest is not None
        age_ns, late_ns = now_ns - self.newest.stamp_ns, now_ns - self.setpoint.stamp_ns
        if age_ns > self._watchdog_ns:
            raise DeviceError(f"no state for {quantity(age_ns * 1e-9, 's')}")
        if self._link.state is LinkState.READY and self.setpoint.force_n and late_ns > self._watchdog_ns:
            raise DeviceError(f"the haptic loop stands still for {quantity(late_ns * 1e-9, 's')}")

    def _identify(self, device_id: str) -> None:
        """Stores the id in the link as serial number and identity: IDENTIFIED; nothing unless it is OPEN.
        DeviceSetupError: another device than before, at any time.
        """
        if self._link.serial not in ("", device_id):
            raise DeviceSetupError(
                f"{self._settings.url}: {device_id}; expected {self._link.serial}, as before"
            )
        if self._link.state is not LinkState.OPEN:
            return
        self._link.serial = device_id
        self._link.identity = f"Inverse3 {device_id}"
        self._link.advance(LinkState.IDENTIFIED)

    def _pressed(self, grips: list[VerseGrip]) -> frozenset[str] | None:
        """Names of the buttons that are pressed; None where no grip is there, or it is asleep or out of
        reach. Stores the status of the grip.
        """
        if not grips:
            return None
        status = self._grip_status = grips[0].status or self._grip_status
        state = grips[0].state
        if state is None or not (status.awake and status.connected):
            return None
        return frozenset(name for name, pressed in state.buttons.items() if pressed)

    def _take_state(self, state: CursorState, pressed: frozenset[str] | None, now_ns: int) -> None:
        """Stores a state as `newest`, and passes its button to `deadman`. During the handshake the first one
        of a usable device makes the link READY. DeviceError, later: an unusable one, or too much force.
        """
        self._link.counters["states"] += 1
        self._link.exchanged(now_ns - self._sent_ns if self._sent_ns else None)
        along = self._settings.direction
        self.newest = HandState(
            now_ns,
            state.cursor_position.along(along),
            state.cursor_velocity.along(along),
            pressed or frozenset(),
        )
        self.deadman.take(None if pressed is None else self._settings.deadman in pressed)
        unfit = self._unfit()
        if self._link.state is LinkState.IDENTIFIED:
            self._missing = unfit or self._missing
            if unfit is None:
                self._link.advance(LinkState.CONFIGURED)
                self._link.advance(LinkState.READY)
            return
        if unfit is not None:
            raise DeviceError(unfit)
        force_n, limit_n = state.current_cursor_force.size, self._settings.max_force_n
        if force_n > _MORE_FORCE * limit_n:
            raise DeviceError(
                f"it gives {quantity(force_n, 'N')}; expected at most {quantity(limit_n, 'N')} (max_force_n)"
            )

    def _unfit(self) -> str | None:
        """Reason for which device and grip are no usable handle now; None if they are."""
        if not self._status.power_supply:
            return "no power: expected its supply plugged in"
        if not self._status.calibrated:
            return "not calibrated: expected it put as its maker's manual says"
        if not self._status.ready:
            return "the device is asleep: expected it to wake up at a command, or at its button"
        if not self._grip_status.connected:
            return "no Verse Grip: expected one, for its buttons are the deadman"
        return None


# --- The WebSocket.
_CONNECT_S = 2.0  # s for connecting
_LEAVE_S = 0.2  # s for the farewell of the socket
_LARGEST_BYTES = 1 << 16  # of a message
_MOST_MESSAGES = 64  # heard in a period: a service that never pauses must not keep the force from it


class ServiceStream:
    """The WebSocket of the service.

    Raises:
        ConfigurationError: websockets is not installed. DeviceSetupError: nobody answers there.
    """

    def __init__(self, url: str) -> None:
        try:
            from websockets.exceptions import WebSocketException  # noqa: PLC0415
            from websockets.sync.client import connect  # noqa: PLC0415
        except ImportError as error:
            raise ConfigurationError("driver haply: needs an extra: pip install 'forefeel[haply]'") from error
        self._url, self._broken, self._leave = url, (OSError, WebSocketException), ExitStack()
        try:
            self._socket = self._leave.enter_context(
                connect(
                    url, open_timeout=_CONNECT_S, close_timeout=_LEAVE_S, ping_interval=None,
                    compression=None, max_size=_LARGEST_BYTES, proxy=None,
                )
            )  # fmt: skip
        except self._broken as error:
            raise DeviceSetupError(f"{url}: {error}; expected Haply's service to run there") from error

    def receive(self, timeout_s: float) -> str | bytes | None:
        """Returns the oldest message that waits; None if none comes in time. DeviceError: connection lost."""
        try:
            return self._socket.recv(timeout_s)
        except TimeoutError:
            return None
        except self._broken as error:
            raise DeviceError(f"{self._url}: the service is gone ({error})") from error

    def send(self, text: str) -> None:
        """Sends a message. DeviceError: the service is gone."""
        try:
            self._socket.send(text)
        except self._broken as error:
            raise DeviceError(f"{self._url}: the service is gone ({error})") from error

    def close(self) -> None:
        with suppress(*self._broken):  # it is gone: as closed as it will be
            self._leave.close()


# --- The handle port.
_OPEN_S = 6.0  # s until the link is ready: `_CONNECT_S`, `_PATIENCE_NS`, and one for the threads


class HaplyHandle(ThreadedHandle[HaplyTalk]):
    """Handle port on an Inverse3. `read` and `render` never wait. A fault is no service, silence, a device
    that is asleep or says that it gives more than the limit, or a message that is none.
    """

    actuator_delay_s = 0.0
    """The service does not say it."""

    def __init__(self, settings: HaplySettings, clock: Clock | None = None) -> None:
        self._settings, self._clock = settings, clock or MonotonicClock()
        self._period_s = 1.0 / settings.rate_hz
        link = DeviceLink(f"handle haply on {settings.url}")
        super().__init__(link, HaplyTalk(settings, link), _OPEN_S)

    def read(self, now_ns: int) -> HandleReading:
        """Returns position, velocity and buttons by the newest state, carried on by its velocity for at most
        two periods, after which the velocity is 0. A state older than the watchdog's time faults the link.

        Raises:
            DeviceError: a fault, now or before, that nobody has re-armed after.
        """
        self.link.require_ready()
        hand, settings = self._talk.newest, self._settings
        assert hand is not None
        age_s = max(0.0, (now_ns - hand.stamp_ns) * 1e-9)
        if age_s > settings.watchdog_s:
            self.link.fault(f"no state for {quantity(age_s, 's')}")
            self.link.require_ready()
        carried_s = _CARRIED_PERIODS * self._period_s
        position_m = hand.position_m + hand.velocity_m_s * min(age_s, carried_s)
        velocity_m_s = hand.velocity_m_s if age_s <= carried_s else 0.0
        grip = Grip.OPEN if settings.gripper in hand.pressed else Grip.CLOSED
        return HandleReading(position_m, velocity_m_s, settings.deadman in hand.pressed, grip)

    def render(self, force_n: float, now_ns: int) -> float:
        """Sets the force of the next command, clamped to the limit; returns it. One that is not finite gives
        none.

        Raises:
            DeviceError: as `read`; there is no force then.
        """
        self.link.require_ready()
        limit_n = self._settings.max_force_n
        applied_n = max(-limit_n, min(limit_n, force_n)) if isfinite(force_n) else 0.0
        self._talk.setpoint = ForceSetpoint(applied_n, now_ns)
        return applied_n

    def show(self, indication: Indication) -> None:
        """Shows nothing: the device has no lamp of ours."""

    def _converse(self, conversation: Conversation) -> Steps:
        """Connects and exchanges until the conversation ends or the link closes; then sends a force of 0."""
        stream = ServiceStream(self._settings.url)
        try:
            self.link.advance(LinkState.OPEN)
            self._talk.begin(self._clock.now_ns())
            pacer = Pacer(self._clock, round(self._period_s * 1e9))
            while not conversation.stopping and self.link.state is not LinkState.CLOSED:
                for text in self._talk.commands(self._clock.now_ns()):
                    stream.send(text)
                wait_s = self._period_s
                for _ in range(_MOST_MESSAGES):
                    if (message := stream.receive(wait_s)) is None:
                        break
                    self._talk.hear(message, self._clock.now_ns())
                    wait_s = 0.0
                self._talk.require_in_time(self._clock.now_ns())
                yield pacer.wait_s()
        finally:
            with suppress(DeviceError):  # it is gone, and its force with it
                for text in self._talk.farewell():
                    stream.send(text)
            stream.close()
