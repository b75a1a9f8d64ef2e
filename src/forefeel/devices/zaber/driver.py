"""The driver of a Zaber stage that speaks ASCII.

The device has no watchdog: it would finish any motion that it was given. So it is only ever given absolute
targets, at most `lead_s` ahead of the newest setpoint and of where it is: when the host dies it comes to rest
by itself.
"""

from collections import Counter, deque
from collections.abc import Sequence
from math import isfinite, nan
from typing import Generic, NamedTuple, TypeVar

from forefeel.common.clock import Clock, MonotonicClock
from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.hardware.calibration import StageCalibration
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.devices.shared.conversation import Conversation, Steps
from forefeel.devices.shared.stage import PositionScale, SetpointMailbox, Wanted, calibrated
from forefeel.devices.shared.stream import SerialStream
from forefeel.devices.zaber.protocol import (
    ACCELERATION_DATA,
    DRIVER_OFF,
    SPEED_DATA,
    UNHOMED,
    CommandEncoder,
    Parser,
    Reply,
    in_words,
    is_fault,
)
from forefeel.devices.zaber.settings import ZaberSettings
from forefeel.slave.stage import StageReading, require_finite

T = TypeVar("T")

# --- Commands and replies, over a byte stream. One thread.
_SLACK_S = 0.05  # of the device, the adapter and the host, beside the bytes' own time
_BITS_PER_BYTE = 10  # bits of a byte on the wire: start, eight data bits, stop
_USUAL_REPLY_BYTES = 40  # bytes of a reply, for the time that it is waited for
_MOST_SILENT = 3  # unanswered exchanges in a row that are a fault
# attempts at a command outside of the control loop: a second, as `_IDENTIFY_S` of a serial cell. Linux
# carries a terminal's bytes by a worker of normal priority, which was seen 0.33 s late on a busy machine
_MOST_ASKED = 20


class Timed(NamedTuple, Generic[T]):
    """A value, and the host's stamp of it."""

    host_ns: int
    value: T


class SilenceError(DeviceError):
    """The device does not answer."""


class RejectedError(DeviceError):
    """The device does not take a command; `reason`: its word for why, BADDATA for example."""

    def __init__(self, text: str, reason: str) -> None:
        super().__init__(text)
        self.reason = reason


class ZaberTalk:
    """Commands to one device and one of its axes.

    Attributes:
        parser: what it dropped tells a wrong baud rate from silence.
        others: addresses of other devices that spoke.
    """

    def __init__(
        self, stream: SerialStream, clock: Clock, address: tuple[int, int], baud: int, link: DeviceLink
    ) -> None:
        self._stream, self._clock, self._byte_s = stream, clock, _BITS_PER_BYTE / baud
        self._device, self._axis = address
        self._name, self._counters = link.name, link.counters
        self._encoder = CommandEncoder(self._device)
        self._silent = 0
        self._dropped: Counter[str] = Counter()
        self.parser = Parser(checksums=False)
        self.others: set[int] = set()

    def ask(self, text: str, axis: int | None = None, tries: int = _MOST_ASKED) -> str:
        """Sends a command, again when no reply comes; returns the data of the reply. SilenceError: no answer
        that often. RejectedError: the device does not take it.
        """
        for _ in range(tries):
            (reply,) = self.exchange([text], axis, patient=True)
            if reply is not None:
                return self.accepted(text, reply.value).data
        raise SilenceError(f"{self._name}: no answer to {text!r}")

    def number(self, text: str, axis: int | None = None) -> float:
        """Asks for one number; DeviceError where the reply is none."""
        return self.as_number(text, self.ask(text, axis))

    def as_number(self, text: str, data: str) -> float:
        """Parses the reply `data` to the command `text` as a number; DeviceError: none, or not finite."""
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
        """Sends commands in one write and returns their replies in that order, rejections too; None: none in
        time. Counts `lost_replies`. SilenceError: three exchanges in a row without any reply (unless
        `patient`). DeviceError: the port is gone. `axis`: None for that of this object, 0 for the device
        itself.
        """
        sent_ns, ids = self._clock.now_ns(), self.post(texts, axis)
        received = self._collect(ids, sent_ns)
        replies = [received.get(message_id) for message_id in ids]
        self._counters["lost_replies"] += replies.count(None)
        self._silent = 0 if received else self._silent + 1
        if self._silent >= _MOST_SILENT and not patient:
            raise SilenceError(f"{self._name}: no answer {_MOST_SILENT} times in a row")
        return replies

    def post(self, texts: Sequence[str], axis: int | None = None) -> list[int]:
        """Sends commands in one write without waiting for replies; returns their message ids. Counts
        `commands`. DeviceError: the port is gone. `axis`: None for that of this object.
        """
        lines = [self._encoder.encode(self._axis if axis is None else axis, text) for text in texts]
        data = b"".join(line for _, line in lines)
        self._counters["commands"] += len(lines)
        self._sent = len(data)
        self._stream.write(data)
        return [message_id for message_id, _ in lines]

    def _collect(self, ids: Sequence[int], sent_ns: int) -> dict[int, Timed[Reply]]:
        """Reads until all `ids` are answered or time is up; returns the replies that came, by message id.
        They are stamped half way between `sent_ns` and arrival. Counts replies of other devices (`foreign`,
        their address is added to `others`), `unexpected_replies`, and what the parser dropped.
        """
        wire_s = (self._sent + _USUAL_REPLY_BYTES * len(ids)) * self._byte_s
        deadline_ns = sent_ns + int((wire_s + _SLACK_S) * 1e9)
        received: dict[int, Timed[Reply]] = {}
        while len(received) < len(ids):
            replies = self.parser.feed(self._stream.read())
            now_ns = self._clock.now_ns()
            for reply in replies:
                if reply.device != self._device:
                    self.others.add(reply.device)
                    self._counters["foreign"] += 1
                elif reply.message_id is None or reply.message_id not in ids:
                    self._counters["unexpected_replies"] += 1
                else:
                    received[reply.message_id] = Timed((sent_ns + now_ns) // 2, reply)
            if now_ns >= deadline_ns:
                break
        self._count_dropped()
        return received

    def _count_dropped(self) -> None:
        fresh = self.parser.dropped - self._dropped
        if fresh:
            self._counters.update(fresh)
            self._dropped = self.parser.dropped.copy()


# --- The handshake: identity, set-up, reference.
_ROUNDING = 1.0  # microsteps


class ConfiguredStage(NamedTuple):
    """A stage that was identified and set up. `limits`: of the device, in microsteps."""

    talk: ZaberTalk
    scale: PositionScale
    limits: tuple[int, int]
    calibration: StageCalibration | None


def link_name(settings: ZaberSettings) -> str:
    return f"stage zaber_ascii on {settings.port}"


def connect(settings: ZaberSettings, clock: Clock, link: DeviceLink, stream: SerialStream) -> ConfiguredStage:
    """Identifies the stage behind an open stream and sets it up: checksums, speed and acceleration limits;
    loads the calibration. Nothing moves. The link becomes IDENTIFIED, with identity and serial number.

    Raises:
        DeviceSetupError: silent, another device, wrong baud rate, no checksums, a limit that it does not
            take, or a calibration of another stage.
    """
    talk = ZaberTalk(stream, clock, (settings.device, settings.axis), settings.baud, link)
    try:
        serial = link.serial = _identify(talk, settings, link)
        link.advance(LinkState.IDENTIFIED)
        calibration, scale = calibrated(settings, serial)
        _set_limits(talk, settings, scale)
        low, high = (round(talk.number(f"get {name}")) for name in ("limit.min", "limit.max"))
    except DeviceSetupError:
        raise
    except DeviceError as error:
        raise DeviceSetupError(f"{error}; expected a stage that takes its settings") from error
    return ConfiguredStage(talk, scale, (low, high), calibration)


def require_travel(device: ConfiguredStage, settings: ZaberSettings) -> None:
    """Raises DeviceSetupError unless the settings' `travel_m` lies within the limits in the device."""
    low, high = device.scale.ends(settings.travel_m)
    lowest, highest = device.limits
    if low < lowest - _ROUNDING or high > highest + _ROUNDING:
        ends_m = sorted(device.scale.metres(end) for end in device.limits)
        raise DeviceSetupError(
            f"{link_name(settings)}: stage.travel_m = [{settings.travel_m[0]:g}, {settings.travel_m[1]:g}]: "
            f"expected within [{ends_m[0]:g}, {ends_m[1]:g}], the limits in the stage"
        )


def require_homed(talk: ZaberTalk, link: DeviceLink) -> None:
    """Raises DeviceSetupError for a stage that has no reference: absolute targets mean nothing."""
    unhomed = sorted(UNHOMED & set(flags(talk)))
    if unhomed:
        raise DeviceSetupError(
            f"{link.name}: {in_words(unhomed[0])}; expected a homed stage: run `forefeel home`"
        )


def clear_faults(talk: ZaberTalk, link: DeviceLink) -> None:
    """Clears the stage's warnings and enables a driver that is off; to be called on an explicit act only.
    DeviceSetupError: a fault stays set, other than that it is not homed.
    """
    talk.ask("warnings clear")
    if DRIVER_OFF & set(flags(talk)):
        talk.ask("driver enable")
    left = [flag for flag in flags(talk) if is_fault(flag) and flag not in UNHOMED]
    if left:
        raise DeviceSetupError(f"{link.name}: {in_words(left[0])}; expected a stage without faults")


def flags(talk: ZaberTalk) -> list[str]:
    """The warning flags that are set, the gravest first."""
    return talk.ask("warnings").split()[1:]


def _identify(talk: ZaberTalk, settings: ZaberSettings, link: DeviceLink) -> str:
    """Turns checksums on and writes what the device is into `link.identity`; returns the serial number.
    DeviceSetupError: no answer, or the checksums stay off.
    """
    try:
        device_id = _device_id(talk)
    except SilenceError as error:
        raise DeviceSetupError(_why_silent(talk, settings)) from error
    _checksums_on(talk, settings)
    serial, version = talk.ask("get system.serial", axis=0), talk.ask("get version", axis=0)
    link.identity = f"Zaber device id {device_id}, serial {serial}, firmware {version}"
    return serial


def _device_id(talk: ZaberTalk) -> str:
    try:
        return talk.ask("get device.id", axis=0)
    except RejectedError:  # firmware 6 calls it otherwise
        return talk.ask("get deviceid", axis=0)


def _why_silent(talk: ZaberTalk, settings: ZaberSettings) -> str:
    """Returns the error text for no answer: another device answers, bytes are no Zaber ASCII, or silence."""
    expected = f"expected Zaber device {settings.device} in ASCII at {settings.baud} baud"
    if talk.others:
        cause = f"answers come from device {min(talk.others)}"
    elif talk.parser.dropped.total():
        cause = "bytes that are no Zaber ASCII: another device, or another baud rate"
    else:
        cause = "silence: no power, another baud rate, or another device"
    return f"{link_name(settings)}: {cause}; {expected}"


def _set_limits(talk: ZaberTalk, settings: ZaberSettings, scale: PositionScale) -> None:
    """Sets maximum speed and acceleration in the stage, from the settings, where they differ.
    DeviceSetupError: the stage rejects the value (BADDATA). RejectedError: another rejection.
    """
    per_m = abs(scale.per_m)
    limits = {
        "maxspeed": (settings.max_velocity_m_s * per_m * SPEED_DATA, "max_velocity_m_s"),
        "accel": (settings.max_acceleration_m_s2 * per_m * ACCELERATION_DATA, "max_acceleration_m_s2"),
    }
    for name, (value, key) in limits.items():
        try:
            _ensure(talk, name, max(1, int(value)))
        except RejectedError as error:
            if error.reason != "BADDATA":
                raise
            raise DeviceSetupError(
                f"{link_name(settings)}: stage.{key} = {getattr(settings, key):g}: rejected "
                f"({error.reason}), expected what the stage can do"
            ) from error


def _checksums_on(talk: ZaberTalk, settings: ZaberSettings) -> None:
    """Turns checksums on in the device, and requires them in every reply from now on. DeviceSetupError: the
    device rejects it, or its replies come without.
    """
    try:
        _ensure(talk, "comm.checksum", 1, axis=0)
        talk.parser.checksums = True
        talk.ask("get comm.checksum", axis=0)
    except (RejectedError, SilenceError) as error:
        why = f"rejected, {error.reason}" if isinstance(error, RejectedError) else "replies come without"
        raise DeviceSetupError(
            f"{link_name(settings)}: checksums stay off ({why}); expected a device with comm.checksum "
            "(without it a damaged digit is a valid position)"
        ) from error


def _ensure(talk: ZaberTalk, name: str, value: int, axis: int | None = None) -> None:
    """Sets a value that is another yet, for the device writes every `set` to its flash."""
    if talk.number(f"get {name}", axis) != value:
        talk.ask(f"set {name} {value}", axis)


# --- Exchanges with a configured stage: targets out, positions in. One thread.
_REST_NS = 2_000_000_000  # ns that a stage may take to rest after a stop
_SMOOTHED = 0.1  # weight of the newest exchange in the usual time of one
_READINGS = 3  # a velocity is taken over: two exchanges
_GAP_NS = 100_000_000  # ns between two positions after which older ones give no velocity


class ZaberExchange:
    """Targets out, positions in: the only place that commands a motion; it asks the link every time.

    Attributes:
        reading: the last position and velocity, with the host's stamp; replaced as a whole.
    """

    def __init__(
        self,
        device: ConfiguredStage,
        settings: ZaberSettings,
        clock: Clock,
        link: DeviceLink,
        orders: SetpointMailbox,
    ) -> None:
        self._talk, self._scale, self._limits = device.talk, device.scale, device.limits
        self._settings, self._clock, self._link, self._orders = settings, clock, link, orders
        self._positions: deque[tuple[int, float]] = deque(maxlen=_READINGS)
        self._usual_s = 0.0
        self._last_ns: int | None = None
        self._since_ns = 0
        self.reading = Timed(0, StageReading(0.0, 0.0))

    def begin(self) -> None:
        """Acknowledges old faults and reads the position, at the start and after an explicit re-arming.
        DeviceSetupError: one stays, or the stage is not homed.
        """
        self._last_ns = None
        clear_faults(self._talk, self._link)
        require_homed(self._talk, self._link)
        self.watch()

    def watch(self) -> None:
        asked_ns = self._clock.now_ns()
        x_m = self._scale.metres(self._talk.number("get pos"))
        self._store((asked_ns + self._clock.now_ns()) // 2, x_m)

    def step(self) -> None:
        """Sends a stop or the newest target, if either is due, and asks for the position in the same
        exchange. Updates `reading`; clears a stop once it is answered. DeviceError: a rejected command, a
        warning flag that forbids motion, silence, the port is gone, or a target while the link is not READY.
        """
        began_ns = self._clock.now_ns()
        stop_due, setpoint = self._due(began_ns)
        order = ["stop"] if stop_due else [] if setpoint is None else [self._move(setpoint, began_ns)]
        texts = [*order, "get pos"]
        replies = self._talk.exchange(texts)
        for text, reply in zip(texts, replies, strict=True):
            if reply is not None:
                self._check(text, reply.value)
        if stop_due and replies[0] is not None:
            self._orders.stopped()
        where = replies[-1]
        if where is not None:
            x_m = self._scale.metres(self._talk.as_number("get pos", where.value.data))
            self._store(where.host_ns, x_m)
        took_s = (self._clock.now_ns() - began_ns) * 1e-9
        if where is not None:
            self._link.exchanged(round(took_s * 1e9))
        self._usual_s += (took_s - self._usual_s) * _SMOOTHED

    def _due(self, now_ns: int) -> tuple[bool, Wanted | None]:
        """Returns (a stop is due, the newest setpoint, or None for no motion) and notes `now_ns` as the last
        call. If the last call was more than `lead_s` ago, the stage has come to rest: counts `stood_still`
        and drops older setpoints; a stop is due if there was one.
        """
        if self._last_ns is not None and now_ns - self._last_ns > self._settings.lead_s * 1e9:
            self._link.counters["stood_still"] += 1
            self._orders.hold()
            self._since_ns = now_ns
        self._last_ns = now_ns
        stop_due, setpoint = self._orders.now()
        over = setpoint is not None and setpoint.stamp_ns < self._since_ns
        return stop_due, None if over else setpoint

    def try_stop(self) -> None:
        """Sends a stop after a fault, and waits for no answer; counts one that can not be sent."""
        try:
            self._talk.post(["stop"])
        except DeviceError:
            self._link.counters["stops_not_sent"] += 1  # the bounded target stops it

    def rest(self) -> None:
        """Sends a stop, waits up to 2 s until the stage is idle. DeviceError: no answer, or still busy."""
        self._talk.ask("stop", tries=_MOST_SILENT)
        until_ns = self._clock.now_ns() + _REST_NS
        while self._clock.now_ns() < until_ns:
            (reply,) = self._talk.exchange([""])
            if reply is not None and not reply.value.busy:
                return
        raise DeviceError(f"{self._link.name}: still busy {_REST_NS * 1e-9:g} s after a stop")

    def _move(self, setpoint: Wanted, now_ns: int) -> str:
        self._link.require_ready()
        return f"move abs {self.target(setpoint, now_ns)}"

    def target(self, setpoint: Wanted, now_ns: int) -> int:
        """Returns the target in microsteps for a setpoint: at most `lead_s` ahead of it, and no further from
        where the stage is than that at full speed. It is clamped to the travel and the limits of the device.

        The setpoint is extrapolated by its age, by the time that the device needs to get it, and by half the
        time that it brakes, v / 2A, so that a steady motion is not braked at each target.
        """
        settings, (position_m, velocity_m_s, stamp_ns) = self._settings, setpoint
        braking_s = 0.5 * abs(velocity_m_s) / settings.max_acceleration_m_s2
        ahead_s = max(0, now_ns - stamp_ns) * 1e-9 + self._usual_s + braking_s
        low_m, high_m = settings.travel_m
        target_m = position_m + velocity_m_s * min(ahead_s, settings.lead_s)
        target_m = max(low_m, min(high_m, target_m))
        reach_m = settings.max_velocity_m_s * settings.lead_s
        read_ns, reading = self.reading
        here_m = reading.carried_on(read_ns, now_ns).position_m
        target_m = max(here_m - reach_m, min(here_m + reach_m, target_m))
        lowest, highest = self._limits
        return max(lowest, min(highest, self._scale.native(target_m)))

    def _check(self, text: str, reply: Reply) -> None:
        flag = self._talk.accepted(text, reply).warning
        if is_fault(flag):
            raise DeviceError(f"{self._link.name}: {in_words(flag)}")
        if flag.startswith("W"):
            self._link.counters[f"warning_{flag}"] += 1

    def _store(self, stamp_ns: int, position_m: float) -> None:
        """Sets `reading` to a position with its velocity, the mean over the last three positions. A gap of
        more than 0.1 s drops the older ones; a position alone has velocity 0.
        """
        if self._positions and stamp_ns - self._positions[-1][0] > _GAP_NS:
            self._positions.clear()
        self._positions.append((stamp_ns, position_m))
        first_ns, first_m = self._positions[0]
        elapsed_s = (stamp_ns - first_ns) * 1e-9
        velocity_m_s = (position_m - first_m) / elapsed_s if elapsed_s > 0 else 0.0
        self.reading = Timed(stamp_ns, StageReading(position_m, velocity_m_s))


# --- The stage port.
_OPEN_S = 8.0  # s for the handshake
_WATCH_S = 0.05  # s between two readings while motion is inhibited


class ZaberStage:
    """Stage port on a Zaber device.

    Attributes:
        link: state, identity and counters.
        calibration: as it was loaded; None: there is none.
    """

    def __init__(self, settings: ZaberSettings, clock: Clock | None = None) -> None:
        self.settings, self._clock = settings, clock or MonotonicClock()
        self.link = DeviceLink(link_name(settings))
        self.calibration: StageCalibration | None = None
        self._orders = SetpointMailbox()
        self._conversation: Conversation | None = None
        self._exchange: ZaberExchange | None = None

    # --- the control loop ---

    def open(self) -> None:
        """Starts the conversation and waits for the end of the handshake.

        Raises:
            DeviceSetupError: no such port, no such device, or it is not homed; the stage was not moved.
        """
        self.close()
        self._orders.hold()  # a setpoint of before moves nothing
        self._conversation = Conversation(self.link, self._converse)
        self._conversation.start(_OPEN_S)

    def close(self) -> None:
        conversation, self._conversation = self._conversation, None
        if conversation is not None:
            conversation.stop()

    def rearm(self) -> None:
        """Permits motion again; drops the setpoint."""
        self._orders.hold()
        self.link.rearm()

    def command(self, position_m: float, velocity_m_s: float, now_ns: int) -> float:
        """Hands the newest setpoint, within the travel, to the thread that talks to the device.

        Raises:
            DeviceError: the device is not ready, or a number is not finite.
        """
        self.link.require_ready()
        require_finite(position_m, velocity_m_s)
        applied_m = self._within_travel(position_m)
        self._orders.command(Wanted(applied_m, velocity_m_s, now_ns))
        return applied_m

    def hold(self, now_ns: int) -> None:
        del now_ns
        self._orders.hold()
        self.link.require_ready()

    def read(self, now_ns: int) -> StageReading:
        self.link.require_ready()
        if self._exchange is None:
            raise DeviceError(f"{self.link.name}: used while closed, expected open() before")
        stamp_ns, reading = self._exchange.reading
        return reading.carried_on(stamp_ns, now_ns)

    def _within_travel(self, position_m: float) -> float:
        low_m, high_m = self.settings.travel_m
        return max(low_m, min(high_m, position_m))

    # --- the conversation's thread ---

    def _converse(self, conversation: Conversation) -> Steps:
        """Opens the port, sets the stage up, and exchanges setpoints and positions until the conversation
        ends. Sets `calibration`; closes the port in any case. DeviceSetupError: travel beyond its limits, not
        homed.
        """
        stream = SerialStream(self.settings)
        try:
            self.link.advance(LinkState.OPEN)
            device = connect(self.settings, self._clock, self.link, stream)
            self.calibration = device.calibration
            require_travel(device, self.settings)
            require_homed(device.talk, self.link)
            exchange = ZaberExchange(device, self.settings, self._clock, self.link, self._orders)
            exchange.watch()  # before CONFIGURED: from there on anybody may re-arm, and read where it is
            self._exchange = exchange
            yield from self._serve(conversation, exchange)
        finally:
            stream.close()

    def _serve(self, conversation: Conversation, exchange: ZaberExchange) -> Steps:
        """Exchanges targets and positions until the conversation ends, then brings the stage to rest. After a
        fault of the link it only reads positions until re-armed, then clears the stage's faults and goes on.
        An exception sends a stop and passes.
        """
        begun = self.link.inhibited is None
        self.link.advance(LinkState.CONFIGURED)
        try:
            if begun:
                exchange.begin()
                self.link.advance(LinkState.READY)
            yield 0.0
            while not conversation.stopping:
                ready = self.link.state is LinkState.READY
                if not ready:
                    exchange.watch()
                elif begun:
                    exchange.step()
                else:
                    exchange.begin()
                    begun = True
                yield 0.0 if ready else _WATCH_S
        except BaseException:
            exchange.try_stop()
            raise
        exchange.rest()
