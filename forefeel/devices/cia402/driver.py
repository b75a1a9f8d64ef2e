"""A CiA 402 drive in cyclic synchronous position mode behind the stage port."""

import time
from collections.abc import Callable
from typing import NamedTuple

from forefeel.common.clock import Clock, MonotonicClock
from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.hardware.calibration import StageCalibration
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.devices.canopen.cia301 import (
    EMERGENCY,
    HEARTBEAT,
    HEARTBEAT_CONSUMER,
    HEARTBEAT_PRODUCER_MS,
    OPERATIONAL,
    RPDO1,
    START,
    SYNC,
    SYNC_PERIOD_US,
    TPDO1,
    Pdo,
    emergency,
    heartbeat_consumer,
    pdo_off,
)
from forefeel.devices.canopen.network import HOST_NODE, SharedNetwork
from forefeel.devices.canopen.sdo import RemoteDevice, can_link, talking_to
from forefeel.devices.cia402 import protocol as cia402
from forefeel.devices.cia402.protocol import QUICK_STOP, DriveMachine, DriveState, Phase, drive_state
from forefeel.devices.cia402.settings import Cia402Settings
from forefeel.devices.shared.conversation import Conversation, Pacer, Steps
from forefeel.devices.shared.stage import PositionScale, Setpoint, Wanted, calibrated
from forefeel.slave.stage import StageReading, require_finite

# --- What one cycle of a CiA 402 drive decides: controlword and setpoint out of what was heard. Pure.
SILENT_PERIODS, SILENT_S = 3, 0.05
"""So many SYNC in a row without a TPDO, and for so long, are a fault: a host pauses for more than 12 ms."""
_FIRST_TPDO_S = 0.5  # s for the first TPDO and the first heartbeat
_ENABLE_S = 1.0  # s in which a reset or an enabling must be done
# s after which a command is over and the setpoint comes to rest: the default of the slave's `watchdog_s`
_STREAM_S = 0.060
_CARRY_S = 0.002  # s by which a command is carried on with its velocity: two periods at 1 kHz


class Readback(NamedTuple):
    """A received TPDO: the host's stamp, the statusword, and position and velocity of the drive."""

    host_ns: int
    statusword: int
    position_m: float
    velocity_m_s: float


class Tracker:
    """Velocity from positions at SYNC, and whether they can be true.

    A frame on a wire without a checksum may say anything: a position further from the last than the drive
    can go counts as not received.
    """

    def __init__(self, period_s: float, max_velocity_m_s: float, following_error_m: float) -> None:
        self._period_s, self._fastest_m_s, self._slack_m = period_s, max_velocity_m_s, following_error_m
        self._last: Readback | None = None

    def take(self, host_ns: int, statusword: int, position_m: float) -> Readback | None:
        """The readback of a TPDO; None: it can not be believed."""
        velocity_m_s = 0.0
        if self._last is not None:
            periods = max(1, round((host_ns - self._last.host_ns) * 1e-9 / self._period_s))
            went_m, elapsed_s = position_m - self._last.position_m, periods * self._period_s
            if abs(went_m) > 2.0 * self._fastest_m_s * elapsed_s + self._slack_m:
                return None
            velocity_m_s = went_m / elapsed_s
        self._last = Readback(host_ns, statusword, position_m, velocity_m_s)
        return self._last


class DriveCycle:
    """Supervises and commands, once for each SYNC.

    Args:
        period_s: of SYNC.
        heartbeat_s: how often the drive is to say that it lives.
        setpoint: what it is led by; starts where the drive is.

    Attributes:
        passive_cycles: how often the drive has answered while it was told to stand.
    """

    def __init__(self, period_s: float, heartbeat_s: float, setpoint: Setpoint) -> None:
        self._period_s = period_s
        self.machine = DriveMachine(patience=round(_ENABLE_S / period_s))
        self.setpoint = setpoint
        self._beat_cycles = int(3.0 * heartbeat_s / period_s) + 1
        self._no_beat = self._silent = 0
        self._patience = max(SILENT_PERIODS, round(SILENT_S / period_s))
        self._grace = round(_FIRST_TPDO_S / period_s)
        self._heard_once = False
        self._statusword = 0
        self.passive_cycles = 0

    def step(
        self, heard: Readback | None, beat: bool, emergency: int | None, wanted: Wanted | None, now_ns: int
    ) -> int:
        """The controlword; `setpoint.position_m` is the target beside it.

        `heard`, `beat`, `emergency`: since the last cycle; `wanted`: None to hold.

        Raises:
            DeviceError: a fault of the drive or of the way to it.
        """
        following = self.machine.phase is Phase.FOLLOWING
        word = self.supervise(heard, beat, emergency)
        if not following:
            if heard is not None:
                self.setpoint.restart(heard.position_m)
                self.passive_cycles += self.machine.phase is Phase.PASSIVE
            return word
        self._move(wanted, now_ns)
        return word

    def supervise(self, heard: Readback | None, beat: bool, emergency: int | None) -> int:
        """The controlword alone, for a drive that moves by itself; raises as `step`."""
        self._listen(heard, beat, emergency)
        return self.machine.step(self._statusword) if self._heard_once else QUICK_STOP

    def _listen(self, heard: Readback | None, beat: bool, emergency: int | None) -> None:
        self._no_beat = 0 if beat else self._no_beat + 1
        self._silent = 0 if heard else self._silent + 1
        if heard is not None:
            self._statusword, self._heard_once = heard.statusword, True
        if emergency and self.machine.phase is not Phase.PASSIVE:
            raise DeviceError(f"drive reports emergency {emergency:04X}")
        if self._silent > (self._patience if self._heard_once else self._grace):
            raise DeviceError(f"no TPDO of the drive for {self._silent - 1} SYNC periods")
        if self._no_beat > max(self._beat_cycles, 0 if self._heard_once else self._grace):
            raise DeviceError("no heartbeat of the drive for three of its periods")

    def _move(self, wanted: Wanted | None, now_ns: int) -> None:
        age_s = 0.0 if wanted is None else max(0.0, (now_ns - wanted.stamp_ns) * 1e-9)
        if wanted is None or age_s > _STREAM_S:
            self.setpoint.hold()
        else:
            self.setpoint.follow(wanted.position_m + wanted.velocity_m_s * min(age_s, _CARRY_S))


# --- The handshake of a CiA 402 drive: who it is, and everything that its safety depends on written by us.
# SYNC periods beyond the window after which the drive itself reports a following error
_FOLLOWING_PERIODS = 5
_SWITCH_OFF = [(transmit, number) for transmit in (False, True) for number in (2, 3, 4)]


def command_pdo(node: int) -> Pdo:
    """The RPDO with controlword and target, applied at every SYNC."""
    return Pdo(False, 1, RPDO1 + node, 1, (cia402.CONTROLWORD, cia402.TARGET_POSITION))


def state_pdo(node: int) -> Pdo:
    """The TPDO with statusword and position, sent at every SYNC."""
    return Pdo(True, 1, TPDO1 + node, 1, (cia402.STATUSWORD, cia402.POSITION_ACTUAL))


def configure(device: RemoteDevice, settings: Cia402Settings, scale: PositionScale) -> float:
    """Writes and reads back the whole configuration, in PRE-OPERATIONAL, and starts it; where the drive is.

    Raises:
        DeviceError: no answer, or an object that is needed is refused.
        DeviceSetupError: it is no drive for us.
    """
    if not int(device.read(cia402.SUPPORTED_MODES)) & cia402.CSP_SUPPORTED:
        raise DeviceSetupError(
            f"{device.name}: no cyclic synchronous position (6502); expected a drive with it"
        )
    _exchanged(device, settings)
    _timing(device, settings)
    _protection(device, settings, scale)
    _mode(device, cia402.CSP)
    actual_m = scale.metres(device.read(cia402.POSITION_ACTUAL))
    _within_travel(device, settings, actual_m)
    device.order(START)
    return actual_m


def require_homing(device: RemoteDevice, settings: Cia402Settings) -> None:
    """Asks and tells the drive how it is to be homed; nothing moves.

    Raises:
        DeviceSetupError: it can not be homed, or not so, or is in a fault.
    """
    homing, per_m = settings.homing, settings.counts_per_m
    if not int(device.read(cia402.SUPPORTED_MODES)) & cia402.HOMING_SUPPORTED:
        raise DeviceSetupError(f"{device.name}: no homing (6502); home it with its maker's tool")
    if drive_state(int(device.read(cia402.STATUSWORD))) is DriveState.FAULT:
        raise DeviceSetupError(
            f"{device.name}: the drive is in a fault; expected none: clear it at the drive"
        )
    wanted = (
        (cia402.HOMING_METHOD, homing.method, "method"),
        (cia402.HOMING_SEARCH_SPEED, round(homing.search_velocity_m_s * per_m), "search_velocity_m_s"),
        (cia402.HOMING_ZERO_SPEED, round(homing.zero_velocity_m_s * per_m), "zero_velocity_m_s"),
        (cia402.HOMING_ACCELERATION, round(homing.acceleration_m_s2 * per_m), "acceleration_m_s2"),
    )
    for entry, value, name in wanted:
        if not device.offer(entry, value) or device.read(entry) != value:
            raise DeviceSetupError(
                f"{device.name}: stage.homing.{name} = {getattr(homing, name):g} is refused ({entry}); "
                "expected what the drive can do"
            )


def configure_homing(device: RemoteDevice, settings: Cia402Settings) -> None:
    """Configures as `configure` does, for the mode of homing. The software limits stay as they are: they
    belong to the count before.

    Raises:
        DeviceError, DeviceSetupError: as `configure`.
    """
    _exchanged(device, settings)
    _timing(device, settings)
    _watched(device, settings, settings.counts_per_m)
    _mode(device, cia402.HOMING)
    device.order(START)


def _exchanged(device: RemoteDevice, settings: Cia402Settings) -> None:
    for transmit, number in _SWITCH_OFF:
        device.offer(*pdo_off(transmit, number, settings.node_id))
    device.write_all(command_pdo(settings.node_id).parameters())
    device.write_all(state_pdo(settings.node_id).parameters())


def _timing(device: RemoteDevice, settings: Cia402Settings) -> None:
    period = cia402.interpolation_period(settings.sync_hz)
    assert period is not None, "the settings refuse it"
    device.write(cia402.PERIOD_EXPONENT, period[1])
    device.write(cia402.PERIOD_VALUE, period[0])
    device.offer(SYNC_PERIOD_US, round(1e6 / settings.sync_hz))
    device.write(HEARTBEAT_PRODUCER_MS, round(settings.heartbeat_s * 1e3))
    device.write(HEARTBEAT_CONSUMER, heartbeat_consumer(HOST_NODE, 3.0 * settings.heartbeat_s))


def _protection(device: RemoteDevice, settings: Cia402Settings, scale: PositionScale) -> None:
    low, high = scale.ends(settings.travel_m)
    device.write(cia402.SOFT_LIMIT_LOW, low)
    device.write(cia402.SOFT_LIMIT_HIGH, high)
    _watched(device, settings, abs(scale.per_m))


def _watched(device: RemoteDevice, settings: Cia402Settings, per_m: float) -> None:
    """What the drive does by itself: a lost host and a following error stop it."""
    device.write(cia402.ABORT_OPTION, cia402.ABORT_QUICK_STOP)
    device.write(cia402.QUICK_STOP_OPTION, cia402.STAY_IN_QUICK_STOP)
    device.write(cia402.FOLLOWING_WINDOW, round(settings.following_error_m * per_m))
    device.write(cia402.FOLLOWING_TIMEOUT_MS, round(1e3 * _FOLLOWING_PERIODS / settings.sync_hz))


def _mode(device: RemoteDevice, mode: int) -> None:
    device.write(cia402.MODE, mode)
    for _ in range(30):
        shown = int(device.read(cia402.MODE_DISPLAY))
        if shown == mode:
            return
        time.sleep(0.01)
    raise DeviceError(f"{device.name}: mode {shown} is displayed, expected {mode}")


def _within_travel(device: RemoteDevice, settings: Cia402Settings, actual_m: float) -> None:
    (low, high), slack_m = settings.travel_m, settings.following_error_m
    if not low - slack_m <= actual_m <= high + slack_m:
        raise DeviceSetupError(
            f"{device.name}: it is at {actual_m:.4g} m, expected within travel_m = [{low:g}, {high:g}]; "
            "home it, or `forefeel calibrate stage`"
        )


# --- What is heard of a CiA 402 drive, and what it is sent at every cycle.
_RANK = 1  # a drive's SYNC goes before a load cell's

Believe = Callable[[int, int, float], Readback | None]
"""A TPDO (host_ns, statusword, position in counts) as it is to be taken; None: it can not be true."""


class DriveWire:
    """What is heard of one drive, and what it is sent: `take` and `send` once a cycle, from one thread. Use:
    `with wire:`; at its end the drive is told to stop.
    """

    def __init__(
        self,
        shared: SharedNetwork,
        settings: Cia402Settings,
        link: DeviceLink,
        clock: Clock,
        believe: Believe,
        target: int,
    ) -> None:
        """`target`: in counts, beside the quick stop of a drive that was sent nothing yet."""
        node = settings.node_id
        self._shared, self._link, self._clock, self._believe = shared, link, clock, believe
        self._command, self._state = command_pdo(node), state_pdo(node)
        self._hears = (
            (self._state.can_id, self._on_state),
            (HEARTBEAT + node, self._on_heartbeat),
            (EMERGENCY + node, self._on_emergency),
        )
        self._heard: Readback | None = None
        self._beat = False
        self._emergency: int | None = None
        self.period_ns = round(1e9 / settings.sync_hz)
        self._beat_ns, self._next_beat_ns = round(settings.heartbeat_s * 1e9), 0
        self._asked_ns: int | None = None  # when the newest SYNC of ours went out
        self._target = target

    def __enter__(self) -> "DriveWire":
        for can_id, heard in self._hears:
            self._shared.subscribe(can_id, heard)
        return self

    def __exit__(self, *_error: object) -> None:
        """Quick stop, as far as the bus still carries it; silence does the same three heartbeats later."""
        try:
            for _ in range(2):
                self.send(cia402.QUICK_STOP, self._target)
        except DeviceError:
            self._link.counters["quick_stop_failed"] += 1
        finally:
            self._shared.leave_sync(self)
            for can_id, heard in self._hears:
                self._shared.unsubscribe(can_id, heard)

    def take(self) -> tuple[Readback | None, bool, int | None]:
        found = self._heard, self._beat, self._emergency
        self._heard, self._beat, self._emergency = None, False, None
        return found

    def _on_state(self, can_id: int, data: bytearray, stamp: float) -> None:
        del can_id, stamp
        values = self._state.unpack(data)
        counters, now_ns = self._link.counters, self._clock.now_ns()
        counters["tpdos"] += 1
        if values is None:
            counters["bad_length"] += 1
            return
        heard = self._believe(now_ns, int(values[0]), values[1])
        if heard is None:
            counters["implausible"] += 1
            return
        self._heard = heard
        self._link.exchanged(None if self._asked_ns is None else now_ns - self._asked_ns)

    def _on_heartbeat(self, can_id: int, data: bytearray, stamp: float) -> None:
        del can_id, stamp
        self._beat = self._beat or data[:1] == bytes([OPERATIONAL])

    def _on_emergency(self, can_id: int, data: bytearray, stamp: float) -> None:
        del can_id, stamp
        self._link.counters["emergencies"] += 1
        self._emergency = emergency(data) or self._emergency

    def send(self, word: int, target: int) -> None:
        """Sends one cycle: the PDO, SYNC, and our heartbeat when it is due.

        Raises:
            DeviceError: the bus failed.
        """
        self._target, now_ns = target, self._clock.now_ns()
        self._shared.send(self._command.can_id, self._command.pack(word, target))
        if self._shared.sends_sync(self, _RANK):
            self._asked_ns = now_ns
            self._shared.send(SYNC, b"")
        if now_ns >= self._next_beat_ns:
            self._next_beat_ns = now_ns + self._beat_ns - self.period_ns // 2
            self._shared.send(HEARTBEAT + HOST_NODE, bytes([OPERATIONAL]))
        self._shared.tell(self._link)


# --- A CiA 402 drive in cyclic synchronous position mode behind the stage port.
_OPEN_S = 8.0  # s for the handshake
# m/s^2 with which `hold` comes to rest: the default of the slave's `stop_deceleration_m_s2`
_DECELERATION_M_S2 = 4.0
STAND_CYCLES = 3  # answers of a drive that was told to stand, before it is enabled


class Cia402Stage:
    """Stage port on a CANopen drive.

    One thread sends setpoint, SYNC and our heartbeat and judges what the drive says; after any fault it sends
    quick stops until `rearm`. The network of the bus is shared with the other drivers of this process.
    """

    def __init__(
        self, settings: Cia402Settings, clock: Clock | None = None, scale: PositionScale | None = None
    ) -> None:
        """`scale`: in place of that of settings and calibration."""
        self._settings, self._scale = settings, scale
        self._clock = clock or MonotonicClock()
        self.link = can_link("stage", settings.driver, settings.can, settings.node_id)
        self.calibration: StageCalibration | None = None
        self._conversation: Conversation | None = None
        self._wanted: Wanted | None = None
        self._rearm = False
        self._readback: Readback | None = None
        self._limits = self._new_setpoint()

    # --- the port ---

    def open(self) -> None:
        """Identifies, configures and enables the drive; it holds where it is.

        Raises:
            DeviceSetupError: it is not the drive that the settings describe.
            DeviceError: it does not answer, or is in a fault: only a fault reset at the drive helps then.
        """
        self._wanted, self._rearm = None, False
        self._conversation = Conversation(self.link, self._converse)
        self._conversation.start(_OPEN_S)

    def close(self) -> None:
        """Comes to rest, sends a quick stop, and releases the bus."""
        if self._conversation is not None:
            self._conversation.stop()

    def rearm(self) -> None:
        """Resets a fault of the drive and enables it; it holds where it is until commanded.

        The drive follows some cycles later; if it does not within a second, that is a new fault.
        """
        if self.link.inhibited is not None:
            self._wanted = None
            self.link.rearm()
            self._rearm = True

    def command(self, position_m: float, velocity_m_s: float, now_ns: int) -> float:
        require_finite(position_m, velocity_m_s)
        self.link.require_ready()
        applied_m = self._limits.within_travel(position_m)
        self._wanted = Wanted(applied_m, velocity_m_s, now_ns)
        return applied_m

    def hold(self, now_ns: int) -> None:
        del now_ns
        self._wanted = None
        self.link.require_ready()

    def read(self, now_ns: int) -> StageReading:
        """The newest readback, carried on to now; its velocity is the difference of two positions at SYNC."""
        self.link.require_ready()
        found = self._readback
        if found is None:
            raise DeviceError(f"{self.link.name}: no position yet")
        return StageReading(found.position_m, found.velocity_m_s).carried_on(found.host_ns, now_ns)

    # --- the conversation ---

    def _converse(self, conversation: Conversation) -> Steps:
        settings = self._settings
        with talking_to(settings.can, settings.node_id, self.link) as (shared, device):
            yield from self._talk(conversation, shared, device)

    def _talk(self, conversation: Conversation, shared: SharedNetwork, device: RemoteDevice) -> Steps:
        device.introduce(cia402.PROFILE)
        scale = self._scale
        if scale is None:
            self.calibration, scale = calibrated(self._settings, self.link.serial)
        actual_m = configure(device, self._settings, scale)
        self.link.advance(LinkState.CONFIGURED)
        s = self._settings
        tracker = Tracker(1.0 / s.sync_hz, s.max_velocity_m_s, s.following_error_m)

        def believe(host_ns: int, statusword: int, counts: float) -> Readback | None:
            heard = tracker.take(host_ns, statusword, scale.metres(counts))
            self._readback = heard or self._readback
            return heard

        with DriveWire(shared, s, self.link, self._clock, believe, scale.native(actual_m)) as wire:
            yield from self._cycles(conversation, wire, scale, actual_m)

    def _cycles(
        self, conversation: Conversation, wire: DriveWire, scale: PositionScale, actual_m: float
    ) -> Steps:
        """From CONFIGURED until the conversation ends or a fault is raised, at absolute deadlines; comes to
        rest before it returns.
        """
        settings, link, clock, setpoint = self._settings, self.link, self._clock, self._new_setpoint()
        setpoint.restart(actual_m)
        cycle = DriveCycle(1.0 / settings.sync_hz, settings.heartbeat_s, setpoint)
        machine, first, pacer = cycle.machine, link.inhibited is None, Pacer(clock, wire.period_ns)

        def may_end() -> bool:
            at_rest = setpoint.velocity_m_s == 0.0 or machine.phase is not Phase.FOLLOWING
            return conversation.stopping and at_rest

        while not may_end():
            heard, beat, alarm = wire.take()
            link.counters["silent_periods"] += heard is None and self._readback is not None
            wanted = None if conversation.stopping else self._wanted
            word = cycle.step(heard, beat, alarm, wanted, clock.now_ns())
            wire.send(word, scale.native(setpoint.position_m))
            self._enable(cycle, first)
            yield pacer.wait_s()
            link.counters["late_cycles"] += pacer.missed
            pacer.missed = 0

    def _enable(self, cycle: DriveCycle, first: bool) -> None:
        """Enables at the start, re-arms when asked to; READY once the drive follows. Else it stands."""
        link, machine = self.link, cycle.machine
        rearm, self._rearm = self._rearm, False
        if link.inhibited is not None:
            machine.stop()
        elif rearm:
            machine.rearm()
        elif first and link.state is LinkState.CONFIGURED and cycle.passive_cycles >= STAND_CYCLES:
            machine.enable()
            if machine.phase is Phase.FOLLOWING:
                link.advance(LinkState.READY)

    def _new_setpoint(self) -> Setpoint:
        s = self._settings
        return Setpoint(1.0 / s.sync_hz, s.travel_m, s.max_velocity_m_s, _DECELERATION_M_S2)
