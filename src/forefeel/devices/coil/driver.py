"""The handle with a voice coil and an encoder behind a microcontroller on a serial port."""

from contextlib import suppress
from math import isfinite
from typing import NamedTuple

from forefeel.common.clock import Clock, MonotonicClock
from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.events.text import quantity
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.common.messages import Grip
from forefeel.devices.coil.protocol import (
    COMMAND_BYTES,
    NAME,
    PROTOCOL,
    Button,
    CoilCommand,
    CoilIdentity,
    CoilParser,
    CoilState,
    Flag,
    Identify,
    encode,
)
from forefeel.devices.coil.settings import CoilSettings
from forefeel.devices.shared.conversation import Conversation, Steps
from forefeel.devices.shared.device_time import DeviceTime
from forefeel.devices.shared.handle import Deadman, ThreadedHandle
from forefeel.devices.shared.stream import SerialStream
from forefeel.master.handle import HandleReading, Indication

# --- The host's half of the exchange: handshake, then a command for each state.
_ASK_NS = 100_000_000  # ns between two requests for the identity
_PATIENCE_NS = 1_000_000_000  # ns for the handshake
_BITS = 10  # start, eight data bits, stop
_LEAST_PERIODS = 5  # between two states, that the watchdog's time has to hold
_LATEST_S = 0.02  # s that a force may be late at most, as in the settings
_FAULTS = {
    Flag.WATCHDOG: "its watchdog took the current away: no command in time",
    Flag.OVER_TEMPERATURE: "the coil is too hot",
    Flag.OVERCURRENT: "overcurrent",
    Flag.NOT_HOMED: "the encoder has lost its zero",
}


class Stamped(NamedTuple):
    """A state of the device; `stamp_ns`: when it was measured, `arrived_ns`: when it came; host's clock."""

    stamp_ns: int
    arrived_ns: int
    state: CoilState


class CurrentSetpoint(NamedTuple):
    """The current that the haptic loop wants, and when it wanted it."""

    current_ma: int
    stamp_ns: int


_NO_CURRENT = CurrentSetpoint(0, 0)


class CoilTalk:
    """Exchange with one device after the other on one link: `begin` starts a handshake, `hear` does all else.

    `hear` runs in one thread. The haptic thread reads `newest` and `deadman`, and sets `setpoint` and
    `shown`: each one reference.

    Attributes:
        newest: the newest state since the handshake, None before.
        setpoint, shown: what the next command carries. A current is only ever sent while the link is READY.
        settled: whether the handshake is done.
        deadman: what it told since the handshake.
        period_s, counts_per_m, actuator_delay_s, limit_ma: as the device says, since the first handshake; the
            counts by the settings where it does not know them.
    """

    def __init__(self, settings: CoilSettings, link: DeviceLink) -> None:
        self._settings, self._link = settings, link
        self._watchdog_ns = round(settings.watchdog_s * 1e9)
        self._identity: CoilIdentity | None = None
        self.period_s, self.counts_per_m, self.actuator_delay_s = 0.0, 0.0, 0.0
        self.limit_ma = 0
        self.setpoint, self.shown = _NO_CURRENT, Indication(None, None)
        self._restart(0)

    def _restart(self, now_ns: int) -> None:
        self._parser = CoilParser(self._link.counters)
        self._begun_ns = self._asked_ns = now_ns
        self._bytes = self._sequence = 0
        self.newest: Stamped | None = None
        self.settled, self.deadman = False, Deadman()

    def begin(self, now_ns: int) -> bytes:
        """Starts a new handshake with any device on the line; returns bytes to send."""
        self._restart(now_ns)
        return self._ask()

    def hear(self, data: bytes, now_ns: int) -> bytes:
        """Takes the bytes that came, if any; returns bytes to send, often none: a request, or a command if a
        new state came.

        Raises:
            DeviceSetupError: nobody answers, or not the device that is expected.
            DeviceError: silence for the watchdog's time, a fault that the device reports, or a haptic loop
                that stands still with a current.
        """
        self._bytes += len(data)
        fresh = False
        for frame in self._parser.feed(data):
            if isinstance(frame, CoilIdentity):
                self._take_identity(frame)
            elif isinstance(frame, CoilState):
                fresh |= self._take_state(frame, now_ns)
        if not self.settled:
            return self._handshake(now_ns, fresh)
        self._require_in_time(now_ns)
        return self._command() if fresh else b""

    def clear_setpoint(self) -> None:
        self.setpoint = _NO_CURRENT

    def farewell(self) -> bytes:
        """The last command: no current, nothing shown."""
        return encode(CoilCommand(self._next(), 0, None, None, False))

    # --- the handshake ---

    def _ask(self) -> bytes:
        settings = self._settings
        watchdog_ms, limit_ma = round(settings.watchdog_s * 1e3), round(settings.max_current_a * 1e3)
        return encode(Identify(PROTOCOL, watchdog_ms, limit_ma))

    def _take_identity(self, identity: CoilIdentity) -> None:
        """Checks an identity, stores it here and in the link, with the current limit and `_set_measures`, and
        makes the link IDENTIFIED; ignores it unless the link is OPEN. DeviceSetupError: no such device or
        protocol, another one than before, a watchdog or limit above the settings, or wrong measures.
        """
        if self._link.state is not LinkState.OPEN:
            return
        port, settings = self._settings.port, self._settings
        name, serial, firmware = (
            "".join(c if c.isprintable() else "?" for c in text)
            for text in (identity.name, identity.serial, identity.firmware)
        )
        if name != NAME:
            raise DeviceSetupError(f"{port}: {name!r} answers; expected {NAME!r}, a coil handle")
        if identity.protocol != PROTOCOL:
            raise DeviceSetupError(
                f"{port}: firmware {firmware} speaks protocol {identity.protocol}; expected {PROTOCOL}"
            )
        if self._identity not in (None, identity):
            raise DeviceSetupError(f"{port}: {identity} answers; expected {self._identity}, as before")
        watchdog_ms, limit_ma = round(settings.watchdog_s * 1e3), round(settings.max_current_a * 1e3)
        if identity.watchdog_ms > watchdog_ms or identity.limit_ma > limit_ma:
            raise DeviceSetupError(
                f"{port}: watchdog {identity.watchdog_ms} ms, limit {identity.limit_ma} mA; "
                f"expected at most {watchdog_ms} ms and {limit_ma} mA (watchdog_s, max_current_a)"
            )
        measures = self._set_measures(identity)
        self._identity, self._link.serial, self.limit_ma = identity, serial, identity.limit_ma
        self._time = DeviceTime(self.period_s)
        self._link.identity = f"{name} {serial}, firmware {firmware}: {measures}"
        self._link.advance(LinkState.IDENTIFIED)

    def _set_measures(self, identity: CoilIdentity) -> str:
        """Sets the period, the counts per metre (the settings' where the device has none) and the delay of
        the force (period, wire and amplifier) from an identity; returns them as text. DeviceSetupError: a
        watchdog's time of less than five periods, a force later than 20 ms, counts that neither device nor
        settings know, or both and not the same.
        """
        settings = self._settings
        self.period_s = identity.period_us * 1e-6
        self.counts_per_m = identity.counts_per_m or settings.counts_per_m or 0.0
        # a force waits for the next state, its command crosses the wire, the device makes a current of it
        wire_s = COMMAND_BYTES * _BITS / settings.baud
        self.actuator_delay_s = self.period_s + wire_s + identity.late_us * 1e-6
        period, late = quantity(self.period_s, "s"), quantity(self.actuator_delay_s, "s")
        if not 0.0 < _LEAST_PERIODS * self.period_s <= settings.watchdog_s:
            raise DeviceSetupError(
                f"{settings.port}: a state each {period}; expected {_LEAST_PERIODS} within watchdog_s"
            )
        if self.actuator_delay_s > _LATEST_S:
            raise DeviceSetupError(
                f"{settings.port}: its force is up to {late} late; expected {_LATEST_S * 1e3:g} ms at most"
            )
        if settings.counts_per_m not in (None, self.counts_per_m) or not self.counts_per_m:
            raise DeviceSetupError(
                f"{settings.port}: the device says {identity.counts_per_m} counts/m (0: not known), "
                f"counts_per_m is {settings.counts_per_m}; expected one of them, or the same"
            )
        return f"a state each {period}, force up to {late} late, {self.counts_per_m:.9g} counts/m"

    def _handshake(self, now_ns: int, fresh: bool) -> bytes:
        """Returns the next bytes of the handshake: the request again each 0.1 s, then a command when a new
        state came. The first state without fault makes the link READY and sets `settled`; after a fault it
        stays CONFIGURED. DeviceSetupError: not done within a second.
        """
        if now_ns - self._begun_ns > _PATIENCE_NS:
            raise DeviceSetupError(self._refusal())
        if self._link.state is LinkState.OPEN:
            if now_ns - self._asked_ns < _ASK_NS:
                return b""
            self._asked_ns = now_ns
            return self._ask()
        if not fresh or self.newest is None:
            return b""
        if not self.newest.state.flags:
            self._link.advance(LinkState.CONFIGURED)
            self._link.advance(LinkState.READY)
            self.settled = True
        return self._command()

    def _refusal(self) -> str:
        """Returns the error text for a handshake not done in time: a fault, no states, or no answer."""
        settings = self._settings
        if self.newest is not None and self.newest.state.flags:
            flags = self.newest.state.flags
            if flags == Flag.NOT_HOMED:
                return (
                    f"{settings.port}: the encoder has no zero yet; expected the handle moved over its index"
                )
            return f"{settings.port}: {_in_words(flags)}; expected a handle without a fault"
        if self._link.state is LinkState.IDENTIFIED:
            return f"{settings.port}: no states; expected them of {self._link.identity}"
        received = f"{self._bytes} bytes, no answer among them" if self._bytes else "no answer"
        return (
            f"{settings.port}: {received} at {settings.baud} baud; expected a coil handle (wrong port, baud?)"
        )

    # --- the exchange ---

    def _take_state(self, state: CoilState, now_ns: int) -> bool:
        """Stores a state, stamped, as `newest`; True if it is new. False before IDENTIFIED, or for the last
        one again. Counts frames and lost ones. DeviceError: a fault that the device reports, once the
        handshake is done.
        """
        if self._link.state < LinkState.IDENTIFIED:
            return False
        before = self.newest
        if before is not None:
            if (state.sequence, state.time_us) == (before.state.sequence, before.state.time_us):
                return False
            self._link.counters["frames_lost"] += (state.sequence - before.state.sequence - 1) % 2**16
        self._link.counters["frames"] += 1
        self._link.exchanged()
        (stamp_ns,) = self._time.stamps([state.time_us], now_ns)
        self.newest = Stamped(stamp_ns, now_ns, state)
        if self.settled:
            self._watch(state)
        return True

    def _watch(self, state: CoilState) -> None:
        """Raises DeviceError for a flag; else has the deadman take its button."""
        if state.flags:
            raise DeviceError(_in_words(state.flags))
        self.deadman.take(Button.DEADMAN in state.buttons)

    def _require_in_time(self, now_ns: int) -> None:
        """Raises DeviceError when the newest state, or in READY a setpoint that is not 0, is older than the
        watchdog's time.
        """
        assert self.newest is not None
        setpoint, age_ns = self.setpoint, now_ns - self.newest.stamp_ns
        if age_ns > self._watchdog_ns:
            raise DeviceError(_age_reason(self.newest, now_ns))
        late_ns = now_ns - setpoint.stamp_ns
        if self._link.state is LinkState.READY and setpoint.current_ma and late_ns > self._watchdog_ns:
            raise DeviceError(f"the haptic loop stands still for {quantity(late_ns * 1e-9, 's')}")

    def _command(self) -> bytes:
        ready, shown = self._link.state is LinkState.READY, self.shown
        stage_um = None if shown.stage_position_m is None else round(shown.stage_position_m * 1e6)
        current_ma = self.setpoint.current_ma if ready else 0
        return encode(CoilCommand(self._next(), current_ma, shown.state, stage_um, ready))

    def _next(self) -> int:
        self._sequence = (self._sequence + 1) & 0xFFFF
        return self._sequence


def _age_reason(newest: Stamped, now_ns: int) -> str:
    """Reason for which a state is too old: none came since, or it was old when it came."""
    age_ns, since_ns = now_ns - newest.stamp_ns, now_ns - newest.arrived_ns
    if age_ns < 2 * since_ns:
        return f"no state for {quantity(age_ns * 1e-9, 's')}"
    old = quantity(age_ns * 1e-9, "s")
    return (
        f"its newest state is {old} old by its own clock: that clock is slow, or the line holds states back"
    )


def _in_words(flags: Flag) -> str:
    named = [text for flag, text in _FAULTS.items() if flag in flags]
    return "; ".join(named) or f"it reports a fault of number {int(flags)}"


# --- The handle port.
_OPEN_S = 3.0  # s until the link is ready: the second of `_PATIENCE_NS`, and two for opening the port
_CARRIED_PERIODS = 5  # by which a state is carried on with its velocity; then the hand rests
_READ_S = 0.25  # of the watchdog's time: how long a read may wait for a byte


class CoilHandle(ThreadedHandle[CoilTalk]):
    """Handle port on a coil. `read`, `render` and `show` never wait. A fault is silence, a flag of the
    device, or a haptic loop that stands still.
    """

    def __init__(self, settings: CoilSettings, clock: Clock | None = None) -> None:
        self._settings, self._clock = settings, clock or MonotonicClock()
        link = DeviceLink(f"handle coil_serial on {settings.port}")
        super().__init__(link, CoilTalk(settings, link), _OPEN_S)

    @property
    def actuator_delay_s(self) -> float:
        """By what the device says of itself."""
        return self._talk.actuator_delay_s

    def read(self, now_ns: int) -> HandleReading:
        """Returns position, velocity and buttons by the newest state, carried on by its velocity for at most
        five periods, after which the velocity is 0. A state older than the watchdog's time faults the link.

        Raises:
            DeviceError: a fault, now or before, that nobody has re-armed after.
        """
        self.link.require_ready()
        newest = self._talk.newest
        assert newest is not None
        age_s = max(0.0, (now_ns - newest.stamp_ns) * 1e-9)
        if age_s > self._settings.watchdog_s:
            self.link.fault(_age_reason(newest, now_ns))
            self.link.require_ready()
        per_m, state = self._settings.sign * self._talk.counts_per_m, newest.state
        carried_s = _CARRIED_PERIODS * self._talk.period_s
        pressed = Button.DEADMAN in state.buttons
        grip = Grip.OPEN if Button.GRIPPER in state.buttons else Grip.CLOSED
        position_m = (state.counts + state.velocity * min(age_s, carried_s)) / per_m
        velocity_m_s = state.velocity / per_m if age_s <= carried_s else 0.0
        stop = Button.ESTOP in state.buttons
        return HandleReading(position_m, velocity_m_s, pressed, grip, estop=stop)

    def render(self, force_n: float, now_ns: int) -> float:
        """Sets the current for a force, clamped to the limit that the device has set, which may be below that
        of the settings; returns the force in N of that current. A force that is not finite gives no current.

        Raises:
            DeviceError: as `read`; there is no force then.
        """
        self.link.require_ready()
        per_ampere = self._settings.newton_per_ampere
        asked_ma = round(force_n / per_ampere * 1e3) if isfinite(force_n) else 0
        limit_ma = self._talk.limit_ma
        current_ma = max(-limit_ma, min(limit_ma, asked_ma))
        self._talk.setpoint = CurrentSetpoint(self._settings.sign * current_ma, now_ns)
        return current_ma * 1e-3 * per_ampere

    def show(self, indication: Indication) -> None:
        """Shows it on the lamp and the display, with the next command."""
        self._talk.shown = indication

    def _converse(self, conversation: Conversation) -> Steps:
        """Opens the port, shakes hands and exchanges until the conversation ends, or a fault closes the link.
        At the end it sends a command without current and closes the port.
        """
        stream = SerialStream(self._settings, _READ_S * self._settings.watchdog_s)
        try:
            self.link.advance(LinkState.OPEN)
            stream.write(self._talk.begin(self._clock.now_ns()))
            while not conversation.stopping and self.link.state is not LinkState.CLOSED:
                answer = self._talk.hear(stream.read(), self._clock.now_ns())
                if answer:
                    stream.write(answer)
                yield 0.0
        finally:
            with suppress(DeviceError):  # it is gone: its own watchdog takes the current away
                stream.write(self._talk.farewell())
            stream.close()
