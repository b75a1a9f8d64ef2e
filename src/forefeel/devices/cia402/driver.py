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

# --- One cycle of a drive: controlword and setpoint, from what was received. Pure.
SILENT_PERIODS, SILENT_S = 3, 0.05
"""So many SYNC in a row without a TPDO, and for so long, are a fault: a host pauses for more than 12 ms."""
_FIRST_TPDO_S = 0.5  # s for the first TPDO and the first heartbeat
_ENABLE_S = 1.0  # s in which a reset or an enabling must be done
_STREAM_S = 0.060  # s after which a command is over and the setpoint rests: the default of `watchdog_s`
_CARRY_S = 0.002  # s by which a command is carried on with its velocity: two periods at 1 kHz


class Readback(NamedTuple):
    """A received TPDO: the host's stamp, the statusword, and position and velocity of the drive."""

    host_ns: int
    statusword: int
    position_m: float
    velocity_m_s: float


class Tracker:
    """Velocities from positions at SYNC; rejects positions that the drive can not have reached.

    A frame on a wire without a checksum may hold anything: such a position counts as not received.
    """

    def __init__(self, period_s: float, max_velocity_m_s: float, following_error_m: float) -> None:
        self._period_s, self._fastest_m_s, self._slack_m = period_s, max_velocity_m_s, following_error_m
        self._last: Readback | None = None

    def take(self, host_ns: int, statusword: int, position_m: float) -> Readback | None:
        """Returns the readback of a TPDO, with the mean velocity since the last one (0 for the first). None,
        and nothing changes, where it is further from the last position than twice the maximum velocity and
        the following error allow.
        """
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
    """Supervision and command of a drive, once for each SYNC.

    Args:
        period_s: of SYNC.
        heartbeat_s: period of the drive's heartbeat.
        setpoint: the target; starts where the drive is.

    Attributes:
        passive_cycles: readbacks received while the drive was told to stand.
    """

    def __init__(self, period_s: float, heartbeat_s: float, setpoint: Setpoint) -> None:
        self._period_s = period_s
        self.machine = DriveMachine(patience=round(_ENABLE_S / period_s))
        self.setpoint = setpoint
        self._beat_cycles = int(3.0 * heartbeat_s / period_s) + 1
        self._no_beat = self._silent = 0
        self._patience = max(SILENT_PERIODS, round(SILENT_S / period_s))
        self._grace = round(_FIRST_TPDO_S / period_s)
        self._answered = False
        self._statusword = 0
        self.passive_cycles = 0

    def step(
        self, readback: Readback | None, beat: bool, emergency: int | None, wanted: Wanted | None, now_ns: int
    ) -> int:
        """Returns the controlword of this cycle, and moves `setpoint`, whose position is the target to send
        with it. The setpoint follows `wanted` (None: comes to rest) while the drive follows, else is set to
        where the drive is. `readback`, `beat`, `emergency`: received since the last cycle.

        Raises:
            DeviceError: a fault of the drive or of the way to it.
        """
        following = self.machine.phase is Phase.FOLLOWING
        word = self.supervise(readback, beat, emergency)
        if not following:
            if readback is not None:
                self.setpoint.restart(readback.position_m)
                self.passive_cycles += self.machine.phase is Phase.PASSIVE
            return word
        self._move(wanted, now_ns)
        return word

    def supervise(self, readback: Readback | None, beat: bool, emergency: int | None) -> int:
        """Returns the controlword alone, for a drive that moves by itself; raises as `step`."""
        self._check(readback, beat, emergency)
        return self.machine.step(self._statusword) if self._answered else QUICK_STOP

    def _check(self, readback: Readback | None, beat: bool, emergency: int | None) -> None:
        """Stores the statusword, and counts cycles without TPDO and without heartbeat. DeviceError: an
        emergency unless passive, or either stays away for too long.
        """
        self._no_beat = 0 if beat else self._no_beat + 1
        self._silent = 0 if readback else self._silent + 1
        if readback is not None:
            self._statusword, self._answered = readback.statusword, True
        if emergency and self.machine.phase is not Phase.PASSIVE:
            raise DeviceError(f"drive reports emergency {emergency:04X}")
        if self._silent > (self._patience if self._answered else self._grace):
            raise DeviceError(f"no TPDO of the drive for {self._silent - 1} SYNC periods")
        if self._no_beat > max(self._beat_cycles, 0 if self._answered else self._grace):
            raise DeviceError("no heartbeat of the drive for three of its periods")

    def _move(self, wanted: Wanted | None, now_ns: int) -> None:
        age_s = 0.0 if wanted is None else max(0.0, (now_ns - wanted.stamp_ns) * 1e-9)
        if wanted is None or age_s > _STREAM_S:
            self.setpoint.hold()
        else:
            self.setpoint.follow(wanted.position_m + wanted.velocity_m_s * min(age_s, _CARRY_S))


# --- The handshake: writes everything that the drive's safety depends on.
_FOLLOWING_PERIODS = 5  # SYNC periods beyond the window after which the drive reports a following error
_SWITCH_OFF = [(transmit, number) for transmit in (False, True) for number in (2, 3, 4)]


def command_pdo(node: int) -> Pdo:
    """The RPDO with controlword and target, applied at every SYNC."""
    return Pdo(False, 1, RPDO1 + node, 1, (cia402.CONTROLWORD, cia402.TARGET_POSITION))


def state_pdo(node: int) -> Pdo:
    """The TPDO with statusword and position, sent at every SYNC."""
    return Pdo(True, 1, TPDO1 + node, 1, (cia402.STATUSWORD, cia402.POSITION_ACTUAL))


def configure(device: RemoteDevice, settings: Cia402Settings, scale: PositionScale) -> float:
    """Configures the drive for cyclic synchronous position, starts its PDOs, and returns its position in m.
    Writes PDOs, timing, software limits, reactions to faults, and mode; the drive is not enabled yet.

    Raises:
        DeviceError: no answer, or an object that is needed is refused.
        DeviceSetupError: no such mode, a value that the drive does not take, or outside of `travel_m`.
    """
    if not int(device.read(cia402.SUPPORTED_MODES)) & cia402.CSP_SUPPORTED:
        raise DeviceSetupError(
            f"{device.name}: no cyclic synchronous position (6502); expected a drive with it"
        )
    _map_pdos(device, settings)
    _set_timing(device, settings)
    _set_limits(device, settings, scale)
    _set_mode(device, cia402.CSP)
    actual_m = scale.metres(device.read(cia402.POSITION_ACTUAL))
    _require_within_travel(device, settings, actual_m)
    device.order(START)
    return actual_m


def require_homing(device: RemoteDevice, settings: Cia402Settings) -> None:
    """Writes and reads back method, speeds and acceleration of homing; nothing moves. DeviceSetupError: no
    mode of homing, a drive in a fault, or a value that is refused.
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
    """Configures the drive for the mode of homing and starts it; raises as `configure`. The software limits
    stay as they are: they belong to the count before.
    """
    _map_pdos(device, settings)
    _set_timing(device, settings)
    _set_reactions(device, settings, settings.counts_per_m)
    _set_mode(device, cia402.HOMING)
    device.order(START)


def _map_pdos(device: RemoteDevice, settings: Cia402Settings) -> None:
    for transmit, number in _SWITCH_OFF:
        device.offer(*pdo_off(transmit, number, settings.node_id))
    device.write_all(command_pdo(settings.node_id).parameters())
    device.write_all(state_pdo(settings.node_id).parameters())


def _set_timing(device: RemoteDevice, settings: Cia402Settings) -> None:
    """Writes the period of SYNC, the drive's heartbeat, and for how long it waits for ours: three periods."""
    period = cia402.interpolation_period(settings.sync_hz)
    assert period is not None, "the settings refuse it"
    device.write(cia402.PERIOD_EXPONENT, period[1])
    device.write(cia402.PERIOD_VALUE, period[0])
    device.offer(SYNC_PERIOD_US, round(1e6 / settings.sync_hz))
    device.write(HEARTBEAT_PRODUCER_MS, round(settings.heartbeat_s * 1e3))
    device.write(HEARTBEAT_CONSUMER, heartbeat_consumer(HOST_NODE, 3.0 * settings.heartbeat_s))


def _set_limits(device: RemoteDevice, settings: Cia402Settings, scale: PositionScale) -> None:
    low, high = scale.ends(settings.travel_m)
    device.write(cia402.SOFT_LIMIT_LOW, low)
    device.write(cia402.SOFT_LIMIT_HIGH, high)
    _set_reactions(device, settings, abs(scale.per_m))


def _set_reactions(device: RemoteDevice, settings: Cia402Settings, per_m: float) -> None:
    """Has a lost host and a following error stop the drive by itself."""
    device.write(cia402.ABORT_OPTION, cia402.ABORT_QUICK_STOP)
    device.write(cia402.QUICK_STOP_OPTION, cia402.STAY_IN_QUICK_STOP)
    device.write(cia402.FOLLOWING_WINDOW, round(settings.following_error_m * per_m))
    device.write(cia402.FOLLOWING_TIMEOUT_MS, round(1e3 * _FOLLOWING_PERIODS / settings.sync_hz))


def _set_mode(device: RemoteDevice, mode: int) -> None:
    """Writes the mode and waits until it is displayed; DeviceError after 0.3 s."""
    device.write(cia402.MODE, mode)
    for _ in range(30):
        shown = int(device.read(cia402.MODE_DISPLAY))
        if shown == mode:
            return
        time.sleep(0.01)
    raise DeviceError(f"{device.name}: mode {shown} is displayed, expected {mode}")


def _require_within_travel(device: RemoteDevice, settings: Cia402Settings, actual_m: float) -> None:
    """Raises DeviceSetupError for a drive outside of its travel by more than the following error."""
    (low, high), slack_m = settings.travel_m, settings.following_error_m
    if not low - slack_m <= actual_m <= high + slack_m:
        raise DeviceSetupError(
            f"{device.name}: it is at {actual_m:.4g} m, expected within travel_m = [{low:g}, {high:g}]; "
            "run `forefeel home`"
        )


# --- The PDOs of a drive.
_RANK = 1  # a drive's SYNC goes before a load cell's

Decode = Callable[[int, int, float], Readback | None]
"""Readback of a TPDO (host_ns, statusword, position in counts); None: not plausible."""


class DriveWire:
    """PDOs, SYNC and heartbeats of one drive: `take` and `send` once a cycle, from one thread, within `with
    wire:`, whose end sends a quick stop.
    """

    def __init__(
        self,
        shared: SharedNetwork,
        settings: Cia402Settings,
        link: DeviceLink,
        clock: Clock,
        decode: Decode,
        target: int,
    ) -> None:
        """`target`: in counts, beside the quick stop of a drive that was sent nothing yet."""
        node = settings.node_id
        self._shared, self._link, self._clock, self._decode = shared, link, clock, decode
        self._command, self._state = command_pdo(node), state_pdo(node)
        self._handlers = (
            (self._state.can_id, self._on_state),
            (HEARTBEAT + node, self._on_heartbeat),
            (EMERGENCY + node, self._on_emergency),
        )
        self._readback: Readback | None = None
        self._beat = False
        self._emergency: int | None = None
        self.period_ns = round(1e9 / settings.sync_hz)
        self._beat_ns, self._next_beat_ns = round(settings.heartbeat_s * 1e9), 0
        self._sync_ns: int | None = None  # of the newest SYNC of ours
        self._target = target

    def __enter__(self) -> "DriveWire":
        for can_id, handler in self._handlers:
            self._shared.subscribe(can_id, handler)
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
            for can_id, handler in self._handlers:
                self._shared.unsubscribe(can_id, handler)

    def take(self) -> tuple[Readback | None, bool, int | None]:
        """Returns and clears what has come since the last call: readback, heartbeat, emergency code."""
        received = self._readback, self._beat, self._emergency
        self._readback, self._beat, self._emergency = None, False, None
        return received

    def _on_state(self, can_id: int, data: bytearray, stamp: float) -> None:
        """Stores the readback of a TPDO for `take`, and its delay after our SYNC in the link; only counts one
        of a wrong length or with an implausible position.
        """
        del can_id, stamp
        values = self._state.unpack(data)
        counters, now_ns = self._link.counters, self._clock.now_ns()
        counters["tpdos"] += 1
        if values is None:
            counters["bad_length"] += 1
            return
        readback = self._decode(now_ns, int(values[0]), values[1])
        if readback is None:
            counters["implausible"] += 1
            return
        self._readback = readback
        self._link.exchanged(None if self._sync_ns is None else now_ns - self._sync_ns)

    def _on_heartbeat(self, can_id: int, data: bytearray, stamp: float) -> None:
        del can_id, stamp
        self._beat = self._beat or data[:1] == bytes([OPERATIONAL])

    def _on_emergency(self, can_id: int, data: bytearray, stamp: float) -> None:
        del can_id, stamp
        self._link.counters["emergencies"] += 1
        self._emergency = emergency(data) or self._emergency

    def send(self, word: int, target: int) -> None:
        """Sends the PDO, then SYNC if it is ours to send, and our heartbeat when due; `target`: in counts.
        Updates the bus counters of the link. DeviceError: the bus failed.
        """
        self._target, now_ns = target, self._clock.now_ns()
        self._shared.send(self._command.can_id, self._command.pack(word, target))
        if self._shared.sends_sync(self, _RANK):
            self._sync_ns = now_ns
            self._shared.send(SYNC, b"")
        if now_ns >= self._next_beat_ns:
            self._next_beat_ns = now_ns + self._beat_ns - self.period_ns // 2
            self._shared.send(HEARTBEAT + HOST_NODE, bytes([OPERATIONAL]))
        self._shared.update_counters(self._link)


# --- The stage port.
_OPEN_S = 8.0  # s for the handshake
_DECELERATION_M_S2 = 4.0  # m/s^2, of `hold`: the default of the slave's `stop_deceleration_m_s2`
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
        """After a fault of the link: resets the drive's fault and enables it; it holds until commanded.

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
        readback = self._readback
        if readback is None:
            raise DeviceError(f"{self.link.name}: no position yet")
        return StageReading(readback.position_m, readback.velocity_m_s).carried_on(readback.host_ns, now_ns)

    # --- the conversation ---

    def _converse(self, conversation: Conversation) -> Steps:
        settings = self._settings
        with talking_to(settings.can, settings.node_id, self.link) as (shared, device):
            yield from self._talk(conversation, shared, device)

    def _talk(self, conversation: Conversation, shared: SharedNetwork, device: RemoteDevice) -> Steps:
        """Identifies and configures the drive (CONFIGURED), runs its cycles until the conversation ends, and
        sends a quick stop. Loads `calibration` where the settings name one, unless a scale was given.
        """
        device.identify(cia402.PROFILE)
        scale = self._scale
        if scale is None:
            self.calibration, scale = calibrated(self._settings, self.link.serial)
        actual_m = configure(device, self._settings, scale)
        self.link.advance(LinkState.CONFIGURED)
        s = self._settings
        tracker = Tracker(1.0 / s.sync_hz, s.max_velocity_m_s, s.following_error_m)

        def decode(host_ns: int, statusword: int, counts: float) -> Readback | None:
            readback = tracker.take(host_ns, statusword, scale.metres(counts))
            self._readback = readback or self._readback
            return readback

        with DriveWire(shared, s, self.link, self._clock, decode, scale.native(actual_m)) as wire:
            yield from self._cycles(conversation, wire, scale, actual_m)

    def _cycles(
        self, conversation: Conversation, wire: DriveWire, scale: PositionScale, actual_m: float
    ) -> Steps:
        """Runs a cycle at each deadline: takes what was received, commands the drive, counts silent and late
        ones. When the conversation is stopping it goes on until the drive is at rest. DeviceError: a fault.
        """
        settings, link, clock, setpoint = self._settings, self.link, self._clock, self._new_setpoint()
        setpoint.restart(actual_m)
        cycle = DriveCycle(1.0 / settings.sync_hz, settings.heartbeat_s, setpoint)
        machine, first, pacer = cycle.machine, link.inhibited is None, Pacer(clock, wire.period_ns)

        def may_end() -> bool:
            at_rest = setpoint.velocity_m_s == 0.0 or machine.phase is not Phase.FOLLOWING
            return conversation.stopping and at_rest

        while not may_end():
            readback, beat, alarm = wire.take()
            link.counters["silent_periods"] += readback is None and self._readback is not None
            wanted = None if conversation.stopping else self._wanted
            word = cycle.step(readback, beat, alarm, wanted, clock.now_ns())
            wire.send(word, scale.native(setpoint.position_m))
            self._enable(cycle, first)
            yield pacer.wait_s()
            link.counters["late_cycles"] += pacer.missed
            pacer.missed = 0

    def _enable(self, cycle: DriveCycle, first: bool) -> None:
        """Enables a new drive after some answers, resets a fault after `rearm`, keeps an inhibited drive
        passive. The link becomes READY once a new drive follows. `first`: no fault before.
        """
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
