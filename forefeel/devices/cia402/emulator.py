"""A CiA 402 drive in the modes of cyclic synchronous position and homing on any python-can bus."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from enum import Enum

import can
import canopen

from forefeel.devices.canopen import cia301
from forefeel.devices.canopen.bus import open_until
from forefeel.devices.canopen.cia301 import ObjectEntry
from forefeel.devices.canopen.emulator import CanopenDevice, pdo_contents, unpacked
from forefeel.devices.cia402 import protocol as cia402
from forefeel.devices.cia402.protocol import (
    HERE,
    HOMING_ATTAINED,
    HOMING_ERROR,
    NEGATIVE_SWITCH,
    PATTERNS,
    POSITIVE_SWITCH,
    TARGET_REACHED,
    DriveState,
)
from forefeel.devices.cia402.settings import Cia402Settings
from forefeel.devices.emulation.bench import (
    TRAVEL_M,
    Emulation,
    Surroundings,
    moved,
)
from forefeel.slave.plant.settings import StageSettings
from forefeel.slave.plant.stage import PlantStage

# --- The mode of homing of an emulated CiA 402 drive: onto a limit switch, off it again. Pure.
SWITCH_M = 0.5e-3  # m from a limit switch to the end of the mechanics, and from the travel to its switch
METHODS = frozenset({NEGATIVE_SWITCH, POSITIVE_SWITCH}) | HERE


_HOMED_AT_REST_M_S = 1e-6  # m/s, below which a homing that stops is at rest


class HomingPhase(Enum):
    IDLE = "not begun, or interrupted"
    SEARCHING = "towards the switch"
    LEAVING = "off the switch"
    STOPPING = "coming to rest behind its edge"
    ATTAINED = "done"
    FAILED = "error"


_MOVING = HomingPhase.SEARCHING, HomingPhase.LEAVING, HomingPhase.STOPPING


class DriveHoming:
    """The reference that the servo follows, and the edge of the switch. Positions are of the motor, in m.

    Args:
        ends_m: of the mechanics: a drive that gets there without its switch gives up.
        dt_s: of the servo.

    Attributes:
        method, search_m_s, zero_m_s, acceleration_m_s2: as its objects 6098, 6099 and 609A have them.
        switches_m: the negative limit switch answers at and below the first, the positive one from
            the second on; at first half a millimetre before the ends.
        no_switch: the switches do not answer.
        reference_m, velocity_m_s: where the servo is to be, and how fast it is to go there.
    """

    def __init__(self, ends_m: tuple[float, float], dt_s: float) -> None:
        self._ends_m, self._dt_s = ends_m, dt_s
        self.switches_m = ends_m[0] + SWITCH_M, ends_m[1] - SWITCH_M
        self.method = 0
        self.search_m_s = self.zero_m_s = self.acceleration_m_s2 = 0.0
        self.no_switch = False
        self.phase = HomingPhase.IDLE
        self.reference_m = self.velocity_m_s = 0.0

    def hold(self, position_m: float) -> None:
        """Rests at that position: the drive is switched on there."""
        self.reference_m, self.velocity_m_s = position_m, 0.0

    def start(self, position_m: float) -> float | None:
        """Begins to home; the reference, where the method moves nothing."""
        if self.method in HERE:
            self.phase = HomingPhase.ATTAINED
            return position_m
        possible = self.method in METHODS and min(self.search_m_s, self.zero_m_s, self.acceleration_m_s2) > 0
        self.phase = HomingPhase.SEARCHING if possible else HomingPhase.FAILED
        return None

    def interrupt(self) -> None:
        """Ends homing before its time; the reference slows down to rest."""
        if self.phase in _MOVING:
            self.phase = HomingPhase.IDLE

    def step(self, position_m: float, velocity_m_s: float) -> float | None:
        """Makes one step, given the servo's position and velocity; returns the reference when it finds it."""
        found = None
        if self.phase is HomingPhase.SEARCHING:
            if self._active(position_m):
                self.phase = HomingPhase.LEAVING
            elif not self._ends_m[0] < self.reference_m < self._ends_m[1]:
                self.phase = HomingPhase.FAILED
                self.hold(position_m)
        elif self.phase is HomingPhase.LEAVING and not self._active(position_m):
            self.phase, found = HomingPhase.STOPPING, position_m
        elif self.phase is HomingPhase.STOPPING and abs(velocity_m_s) < _HOMED_AT_REST_M_S:
            self.phase = HomingPhase.ATTAINED
        self._follow()
        return found

    def status(self, at_rest: bool) -> int:
        """The bits of the statusword that the mode of homing has."""
        match self.phase:
            case HomingPhase.IDLE:
                return TARGET_REACHED
            case HomingPhase.STOPPING:
                return HOMING_ATTAINED
            case HomingPhase.ATTAINED:
                return HOMING_ATTAINED | TARGET_REACHED
            case HomingPhase.FAILED:
                return HOMING_ERROR | (TARGET_REACHED if at_rest else 0)
            case _:
                return 0

    @property
    def _way(self) -> int:
        return -1 if self.method == NEGATIVE_SWITCH else 1

    def _active(self, position_m: float) -> bool:
        low_m, high_m = self.switches_m
        on = position_m <= low_m if self._way < 0 else position_m >= high_m
        return on and not self.no_switch

    def _follow(self) -> None:
        wanted_m_s = 0.0
        if self.phase is HomingPhase.SEARCHING:
            wanted_m_s = self._way * self.search_m_s
        elif self.phase is HomingPhase.LEAVING:
            wanted_m_s = -self._way * self.zero_m_s
        most = self.acceleration_m_s2 * self._dt_s
        self.velocity_m_s += max(-most, min(most, wanted_m_s - self.velocity_m_s))
        self.reference_m += self.velocity_m_s * self._dt_s


# --- A CiA 402 drive without its bus: the state machine, the cyclic setpoint and the servo. Pure.
# emergency codes: current at the output (CiA 402), lost heartbeat (CiA 301), following error (CiA 402)
OVERCURRENT, HEARTBEAT_LOST, FOLLOWING = 0x2310, 0x8130, 0x8611
# statusword (CiA 402): voltage enabled, no quick stop, remote, and in the cyclic mode: follows the target
_VOLTAGE, _QUICK_STOP_OFF, _REMOTE, _FOLLOWS = 1 << 4, 1 << 5, 1 << 9, 1 << 12
_AT_REST_M_S = 1e-9  # m/s, below which the motor is at rest
_POWERED = frozenset({DriveState.ENABLED, DriveState.QUICK_STOP, DriveState.FAULT_REACTION})

Moved = Callable[[float, float, float, float], None]
"""Called at every step of the servo: t_s, and x_m, v_m_s, a_m_s2 of the carriage."""


class DriveModel:
    """Controlwords and targets in, statusword and motion out.

    Args:
        settings: the mechanics: travel, limits, bandwidth, where it starts.
        counts_per_m: of its encoder; zero at x = 0, until it is homed.
        rate_hz: of its servo.
        moved: the hook of every step.

    Attributes:
        homing: what the mode of homing does.
        origin_m: where its count is 0.
        home_offset: its count at the reference, once it is homed.
        state, velocity_m_s, position_m: what it is about.
        alarms: emergency codes that have not been sent yet.
    """

    def __init__(
        self, settings: StageSettings, counts_per_m: float, rate_hz: int = 2000, moved: Moved | None = None
    ) -> None:
        self._dt_s = 1.0 / rate_hz
        self._servo = PlantStage(settings, self._dt_s)
        self._counts_per_m, self._moved = counts_per_m, moved
        self.state = DriveState.DISABLED
        self.mode = 0
        self.period_s = 0.004
        self.soft_limits = (-(2**31), 2**31 - 1)
        self.window, self.timeout_s = 2**31, 0.0
        self.quick_stop_option, self.abort_option = 2, 1
        self.alarms: list[int] = []
        self.error_code = 0
        self.stuck = self._limited = False
        self._control = 0
        self._target: int | None = None
        self._from_m = self._to_m = settings.start_m
        self._synced_s = self._t_s = self._behind_s = 0.0
        self._broken = False
        self.homing = DriveHoming((settings.travel_lower_m, settings.travel_upper_m), self._dt_s)
        self.origin_m, self.home_offset = 0.0, 0
        self.carriage = (settings.start_m, 0.0, 0.0)

    # --- what it shows ---

    @property
    def position_m(self) -> float:
        """Position of the motor, from the servo's own zero."""
        return self._servo.position_m

    @property
    def velocity_m_s(self) -> float:
        """Velocity of the motor; 0 while it is stuck."""
        return 0.0 if self.stuck else self._servo.velocity_m_s

    @property
    def position(self) -> int:
        """Position of the motor in counts, object 6064."""
        return round((self._servo.position_m - self.origin_m) * self._counts_per_m)

    @property
    def velocity(self) -> int:
        """Velocity of the motor in counts/s, object 606C."""
        return round(self.velocity_m_s * self._counts_per_m)

    @property
    def following_error(self) -> int:
        """The following error in counts, object 60F4; 0 while the drive does not follow."""
        if self.state is not DriveState.ENABLED:
            return 0
        return round((self._reference_m(self._t_s)[0] - self._servo.position_m) * self._counts_per_m)

    @property
    def statusword(self) -> int:
        word = PATTERNS[self.state][1] | _VOLTAGE | _REMOTE
        if self.state is DriveState.DISABLED:
            word |= _QUICK_STOP_OFF
        if self.state is DriveState.ENABLED and self.mode == cia402.CSP:
            word |= _FOLLOWS
        if self._limited:
            word |= cia402.LIMIT_ACTIVE
        if self.mode == cia402.HOMING:
            word |= self.homing.status(at_rest=abs(self.velocity_m_s) <= _AT_REST_M_S)
        elif self._behind_s > 0.0:
            word |= cia402.FOLLOWING_BIT
        return word

    # --- what it is told ---

    def control(self, word: int) -> None:
        """Obeys a controlword, object 6040."""
        rising = word & ~self._control
        self._control = word
        if self.state is DriveState.FAULT:
            if rising & cia402.FAULT_RESET and not self._broken:
                self.state, self.error_code = DriveState.DISABLED, 0
            return
        if self.state is not DriveState.FAULT_REACTION:
            self._switch(word)
        if self.mode == cia402.HOMING:
            self._home(bool(rising & cia402.HOMING_START), word)

    def _home(self, start: bool, word: int) -> None:
        enabled = self.state is DriveState.ENABLED
        if not enabled or not word & cia402.HOMING_START or word & cia402.HALT:
            self.homing.interrupt()
        elif start:
            self._found(self.homing.start(self._servo.position_m))

    def _found(self, reference_m: float | None) -> None:
        """The reference, when it has just been found: the count begins anew."""
        if reference_m is not None:
            self.origin_m = reference_m - self.home_offset / self._counts_per_m

    def target(self, counts: int) -> None:
        """Keeps a target position, object 607A, for the next SYNC."""
        self._target = counts

    def sync(self, t_s: float) -> None:
        """At SYNC the target becomes valid; the drive interpolates to it over one period."""
        self._from_m = self._reference_m(t_s)[0]
        if self._target is not None and self.mode == cia402.CSP:
            low, high = self.soft_limits
            kept = max(low, min(high, self._target))
            self._limited = kept != self._target
            self._to_m = self.origin_m + kept / self._counts_per_m
        self._synced_s = t_s

    def lose_host(self) -> None:
        """Reacts, as object 6007 says, to the end of the host's heartbeat or of the PDOs."""
        if self.state is not DriveState.ENABLED:
            return
        if self.abort_option == cia402.ABORT_QUICK_STOP:
            self.state = DriveState.QUICK_STOP
        elif self.abort_option == 2:
            self.state = DriveState.DISABLED
        elif self.abort_option == 1:
            self.fail(HEARTBEAT_LOST)

    def fail(self, code: int, broken: bool = False) -> None:
        """Begins a fault; a broken drive stays in it whatever it is told."""
        self._broken = self._broken or broken
        if self.state not in (DriveState.FAULT, DriveState.FAULT_REACTION):
            self.state, self.error_code = DriveState.FAULT_REACTION, code
            self.alarms.append(code)

    # --- time ---

    def advance(self, t_s: float) -> None:
        """Makes the servo's steps up to that time."""
        while self._t_s + self._dt_s <= t_s:
            self._t_s += self._dt_s
            self._step(self._t_s)

    def _switch(self, word: int) -> None:
        state, enabled = self.state, DriveState.ENABLED
        if not word & 0x02:
            self.state = DriveState.DISABLED
        elif not word & 0x04:
            self._stop_quickly()
        elif state is DriveState.QUICK_STOP:
            if word & 0x0F == cia402.ENABLE and self.quick_stop_option >= 5:
                self._start()
        elif not word & 0x01:
            self.state = DriveState.READY
        elif state is not DriveState.DISABLED and not (state is enabled and word & 0x08):
            if word & 0x08 and state is DriveState.SWITCHED_ON:
                self._start()
            else:
                self.state = DriveState.SWITCHED_ON

    def _stop_quickly(self) -> None:
        if self.state is DriveState.ENABLED:
            self.state = DriveState.QUICK_STOP
        elif self.state is not DriveState.QUICK_STOP:
            self.state = DriveState.DISABLED

    def _start(self) -> None:
        """Follows at once whatever the target says: a drive in this mode has no ramp."""
        self.state = DriveState.ENABLED
        if self._target is None or self.mode == cia402.HOMING:
            self._from_m = self._to_m = self._servo.position_m
            self.homing.hold(self._servo.position_m)
        else:
            self._from_m = self._to_m = self.origin_m + self._target / self._counts_per_m

    def _reference_m(self, t_s: float) -> tuple[float, float]:
        if self.mode == cia402.HOMING:
            return self.homing.reference_m, self.homing.velocity_m_s
        share = (t_s - self._synced_s) / self.period_s
        if share >= 1.0:
            return self._to_m, 0.0
        span_m = self._to_m - self._from_m
        return self._from_m + span_m * max(0.0, share), span_m / self.period_s

    def _step(self, t_s: float) -> None:
        if self.state is DriveState.ENABLED:
            if self.mode == cia402.HOMING:
                self._found(self.homing.step(self._servo.position_m, self.velocity_m_s))
                self._from_m = self._to_m = self.homing.reference_m
            reference_m, feed_m_s = self._reference_m(t_s)
            self._servo.command(reference_m, feed_m_s, t_s)
            self._watch(reference_m)
        else:
            self._servo.hold()
            self.homing.interrupt()
            self._behind_s = 0.0
        if self.stuck:
            self._servo.velocity_m_s = 0.0
            self.carriage = (self.carriage[0], 0.0, 0.0)
        else:
            self.carriage = self._servo.step(t_s)
        if abs(self.velocity_m_s) <= _AT_REST_M_S:
            self._at_rest()
        if self._moved is not None:
            self._moved(t_s, *self.carriage)

    def _at_rest(self) -> None:
        if self.state is DriveState.FAULT_REACTION:
            self.state = DriveState.FAULT
        elif self.state is DriveState.QUICK_STOP and self.quick_stop_option < 5:
            self.state = DriveState.DISABLED

    def _watch(self, reference_m: float) -> None:
        error = abs(reference_m - self._servo.position_m) * self._counts_per_m
        self._behind_s = self._behind_s + self._dt_s if error > self.window else 0.0
        if self._behind_s > self.timeout_s:
            self.fail(FOLLOWING)


# --- A CiA 402 drive in the modes of cyclic synchronous position and homing on any python-can bus.
SERIAL = 0x0402_0001  # serial number of the emulated drive, object 1018:04; made up
_INVALID = 0x0609_0030  # value of a parameter
_SHOWN = {
    cia402.STATUSWORD.index: "statusword",
    cia402.POSITION_ACTUAL.index: "position",
    cia402.VELOCITY_ACTUAL.index: "velocity",
    cia402.MODE_DISPLAY.index: "mode",
    cia402.ERROR_CODE.index: "error_code",
    cia402.FOLLOWING_ERROR.index: "following_error",
}
_SIGNED = frozenset(
    {(0x6007, 0), (0x607C, 0), (0x6098, 0), (0x605A, 0), (0x607D, 1), (0x607D, 2), (0x60C2, 2)}
)


def contents(node: int) -> dict[ObjectEntry, float]:
    return {
        cia301.DEVICE_TYPE: 0x0002_0000 | cia402.PROFILE,  # a servo drive
        cia301.ERROR_REGISTER: 0,
        cia301.SYNC_PERIOD_US: 0,
        ObjectEntry(0x1016, 0, "B"): 1,
        cia301.HEARTBEAT_CONSUMER: 0,
        cia301.HEARTBEAT_PRODUCER_MS: 0,
        ObjectEntry(0x1018, 0, "B"): 4,
        cia301.VENDOR: 0x0000_FEE1,
        cia301.PRODUCT: 0x402,
        cia301.REVISION: 0x0001_0000,
        cia301.SERIAL: SERIAL,
        **pdo_contents(node),
        cia402.ABORT_OPTION: 1,
        cia402.ERROR_CODE: 0,
        cia402.CONTROLWORD: 0,
        cia402.STATUSWORD: 0,
        cia402.QUICK_STOP_OPTION: 2,
        cia402.MODE: 0,
        cia402.MODE_DISPLAY: 0,
        cia402.POSITION_ACTUAL: 0,
        cia402.FOLLOWING_WINDOW: 2**31,
        cia402.FOLLOWING_TIMEOUT_MS: 0,
        cia402.VELOCITY_ACTUAL: 0,
        cia402.TARGET_POSITION: 0,
        ObjectEntry(0x607D, 0, "B"): 2,
        cia402.HOME_OFFSET: 0,
        cia402.SOFT_LIMIT_LOW: -(2**31),
        cia402.SOFT_LIMIT_HIGH: 2**31 - 1,
        cia402.QUICK_STOP_DECELERATION: 0,
        ObjectEntry(0x60C2, 0, "B"): 2,
        cia402.PERIOD_VALUE: 4,
        cia402.PERIOD_EXPONENT: -3,
        cia402.HOMING_METHOD: 0,
        ObjectEntry(0x6099, 0, "B"): 2,
        cia402.HOMING_SEARCH_SPEED: 0,
        cia402.HOMING_ZERO_SPEED: 0,
        cia402.HOMING_ACCELERATION: 0,
        cia402.FOLLOWING_ERROR: 0,
        cia402.SUPPORTED_MODES: cia402.CSP_SUPPORTED | cia402.HOMING_SUPPORTED,
    }


class Drive402(CanopenDevice):
    """The drive: run `step` over and over in one thread.

    Args:
        bus: an open bus of its own.
        node: its identifier.
        settings: the mechanics.
        counts_per_m: of its encoder.
        moved: called at every step of the servo (t_s, x_m, v_m_s, a_m_s2).
        rate_hz: of the servo.
        now_s: a clock.

    Attributes:
        model: the drive behind the bus.
    """

    faults = "unplug", "plug", "drive_fault", "stuck", "no_switch", "free"

    def __init__(
        self,
        bus: can.BusABC,
        node: int,
        settings: StageSettings,
        counts_per_m: float,
        moved: Moved | None = None,
        rate_hz: int = 2000,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.model = DriveModel(settings, counts_per_m, rate_hz, moved)
        self._counts_per_m = counts_per_m
        self._listens_to, self._silence_s = 0, 0.0
        self._last_beat_s: float | None = None
        super().__init__(bus, node, contents(node), now_s)

    def provoke(self, fault: str) -> None:
        """`drive_fault`: overcurrent, for a reset to clear; `stuck` or `no_switch` (no limit switch answers)
        until `free`; `unplug` and `plug`.
        """
        if fault == "drive_fault":
            self.model.fail(OVERCURRENT)
        elif fault in ("stuck", "free"):
            self.model.stuck, self.model.homing.no_switch = fault == "stuck", False
        elif fault == "no_switch":
            self.model.homing.no_switch = True
        else:
            super().provoke(fault)

    def written(self, index: int, sub: int, value: bytes) -> None:
        model = self.model
        if index == cia402.CONTROLWORD.index:
            model.control(unpacked(cia402.CONTROLWORD, value))
        elif index == cia402.TARGET_POSITION.index:
            model.target(unpacked(cia402.TARGET_POSITION, value))
        elif index == cia402.MODE.index:
            model.mode = unpacked(cia402.MODE, value)
        elif (index, sub) == (0x1016, 1):
            word = unpacked(cia301.HEARTBEAT_CONSUMER, value)
            self._listens_to, self._silence_s = word >> 16 & 0x7F, (word & 0xFFFF) * 1e-3
            self._last_beat_s = None
        else:
            self._configured((index, sub), value)

    def shown(self, index: int, sub: int) -> float | None:
        del sub
        name = _SHOWN.get(index)
        return None if name is None else int(getattr(self.model, name))

    def synchronised(self, t_s: float) -> None:
        self.model.sync(t_s)

    def heard(self, can_id: int, t_s: float) -> None:
        if can_id == cia301.HEARTBEAT + self._listens_to and self._silence_s:
            self._last_beat_s = t_s

    def left_operational(self) -> None:
        self.model.lose_host()

    def live(self, t_s: float) -> None:
        """Moves the drive on; the host is lost when its heartbeat, once heard, stays away."""
        if self._last_beat_s is not None and t_s - self._last_beat_s > self._silence_s:
            self.model.advance(self._last_beat_s + self._silence_s)
            self._last_beat_s = None
            self.model.lose_host()
            self.model.alarms.append(HEARTBEAT_LOST)
            self.enter_preoperational()
        self.model.advance(t_s)
        for code in self.model.alarms:
            self.report(code)
        self.model.alarms.clear()

    def _configured(self, at: tuple[int, int], value: bytes) -> None:
        model, number = self.model, int.from_bytes(value, "little", signed=at in _SIGNED)
        match at:
            case (0x6007, 0):
                model.abort_option = number
            case (0x605A, 0):
                model.quick_stop_option = number
            case (0x6065, 0):
                model.window = number
            case (0x6066, 0):
                model.timeout_s = number * 1e-3
            case (0x607D, 1):
                model.soft_limits = number, model.soft_limits[1]
            case (0x607D, 2):
                model.soft_limits = model.soft_limits[0], number
            case (0x60C2, 1):
                model.period_s = number * 10.0 ** self.value(cia402.PERIOD_EXPONENT)
            case (0x60C2, 2):
                model.period_s = self.value(cia402.PERIOD_VALUE) * 10.0**number
            case _:
                self._homed_by(at, number)

    def _homed_by(self, at: tuple[int, int], number: int) -> None:
        homing, metres = self.model.homing, number / self._counts_per_m
        match at:
            case (0x607C, 0):
                self.model.home_offset = number
            case (0x6098, 0) if number not in METHODS:
                raise canopen.SdoAbortedError(_INVALID)
            case (0x6098, 0):
                homing.method = number
            case (0x6099, 1):
                homing.search_m_s = metres
            case (0x6099, 2):
                homing.zero_m_s = metres
            case (0x609A, 0):
                homing.acceleration_m_s2 = metres


def build(settings: Cia402Settings, around: Surroundings, leave: ExitStack) -> Drive402:
    """Builds the drive of the world's stage, with the vessel in front of it, for `Emulation`.

    Its limit switches lie beyond the travel; the one that it is homed to lies where the settings have it.
    """
    low_m, high_m = sorted(settings.sign * end_m for end_m in settings.travel_m)
    home_m, method = settings.sign * settings.homing.home_m, settings.homing.method
    negative_m = home_m if method == NEGATIVE_SWITCH and home_m < low_m else low_m - SWITCH_M
    positive_m = home_m if method == POSITIVE_SWITCH and home_m > high_m else high_m + SWITCH_M
    stage = around.world.stage.model_copy(
        update={
            "travel_lower_m": negative_m - SWITCH_M,
            "travel_upper_m": positive_m + SWITCH_M,
            "start_m": settings.sign * around.world.stage.start_m,
            "velocity_limit_m_s": 2.0 * settings.max_velocity_m_s,
        }
    )
    hook = moved(around, settings.sign, leave)
    bus = open_until(leave, settings.can)
    return Drive402(bus, settings.node_id, stage, settings.counts_per_m, hook, now_s=around.now_s)


EMULATION = Emulation({"node_id": 1, "counts_per_m": 1e7, "travel_m": TRAVEL_M}, build, on_can=True)
