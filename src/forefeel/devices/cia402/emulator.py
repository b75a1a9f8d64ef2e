"""A CiA 402 drive in the modes of cyclic synchronous position and homing on any python-can bus."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from enum import Enum, auto

import can
import canopen

from forefeel.devices.canopen import cia301
from forefeel.devices.canopen.bus import open_until
from forefeel.devices.canopen.cia301 import ObjectEntry
from forefeel.devices.canopen.emulator import CanopenDevice, common_contents, unpacked
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
from forefeel.devices.emulation.bench import TRAVEL_M, Emulation, Surroundings, moved
from forefeel.slave.plant.settings import StageSettings
from forefeel.slave.plant.stage import PlantStage

SERIAL = 0x0402_0001  # serial number of the emulated drive, object 1018:04; made up
SWITCH_M = 0.5e-3  # m from a limit switch to the end of the mechanics, and from the travel to its switch
METHODS = frozenset({NEGATIVE_SWITCH, POSITIVE_SWITCH}) | HERE
# emergency codes: current at the output (CiA 402), lost heartbeat (CiA 301), following error (CiA 402)
OVERCURRENT, HEARTBEAT_LOST, FOLLOWING = 0x2310, 0x8130, 0x8611
# statusword (CiA 402): voltage enabled, no quick stop, remote, and in the cyclic mode: follows the target
_VOLTAGE, _QUICK_STOP_OFF, _REMOTE, _FOLLOWS = 1 << 4, 1 << 5, 1 << 9, 1 << 12
_AT_REST_M_S = 1e-9  # m/s, below which the motor is at rest
_HOMED_AT_REST_M_S = 1e-6  # m/s, below which a homing that stops is at rest
_INVALID = 0x0609_0030  # abort code: value of a parameter (CiA 301)
OBJECTS = {
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
    cia402.TARGET_POSITION: 0,
    cia402.HOME_OFFSET: 0,
    cia402.SOFT_LIMIT_LOW: -(2**31),
    cia402.SOFT_LIMIT_HIGH: 2**31 - 1,
    cia402.PERIOD_VALUE: 4,
    cia402.PERIOD_EXPONENT: -3,
    cia402.HOMING_METHOD: 0,
    cia402.HOMING_SEARCH_SPEED: 0,
    cia402.HOMING_ZERO_SPEED: 0,
    cia402.HOMING_ACCELERATION: 0,
    cia402.SUPPORTED_MODES: cia402.CSP_SUPPORTED | cia402.HOMING_SUPPORTED,
}
"""The objects of the profile with their values at the start."""
_ENTRIES = {(entry.index, entry.sub): entry for entry in (*OBJECTS, cia301.HEARTBEAT_CONSUMER)}


class HomingPhase(Enum):
    IDLE = auto()
    SEARCHING = auto()
    LEAVING = auto()
    STOPPING = auto()
    ATTAINED = auto()
    FAILED = auto()


_STATUS = {
    HomingPhase.IDLE: TARGET_REACHED,
    HomingPhase.STOPPING: HOMING_ATTAINED,
    HomingPhase.ATTAINED: HOMING_ATTAINED | TARGET_REACHED,
    HomingPhase.FAILED: HOMING_ERROR,
}


class DriveHoming:
    """Mode of homing: onto a limit switch, off it again. Positions are of the motor, in m.

    Args:
        objects: of the drive.
        ends_m: of the mechanics: a drive that gets there without its switch gives up.
        counts_per_m: of its encoder.
        dt_s: of the servo.

    Attributes:
        switches_m: the negative limit switch answers at and below the first, the positive one from
            the second on; at first half a millimetre before the ends.
        reference_m, velocity_m_s: position and velocity that the servo is to follow.
    """

    def __init__(
        self, objects: dict[ObjectEntry, int], ends_m: tuple[float, float], counts_per_m: float, dt_s: float
    ) -> None:
        self._objects, self._ends_m, self._per_m, self._dt_s = objects, ends_m, counts_per_m, dt_s
        self.switches_m = ends_m[0] + SWITCH_M, ends_m[1] - SWITCH_M
        self.phase = HomingPhase.IDLE
        self.reference_m = self.velocity_m_s = 0.0

    def hold(self, position_m: float) -> None:
        """Rests at that position: the drive is switched on there."""
        self.reference_m, self.velocity_m_s = position_m, 0.0

    def start(self, position_m: float) -> float | None:
        """Begins the search for the switch, or fails if method, speeds or acceleration are not set; returns
        None. Where the method moves nothing, homing is attained at once: returns `position_m`, the origin.
        """
        if self._objects[cia402.HOMING_METHOD] in HERE:
            self.phase = HomingPhase.ATTAINED
            return position_m
        needed = cia402.HOMING_METHOD, cia402.HOMING_SEARCH_SPEED, cia402.HOMING_ZERO_SPEED
        possible = all(self._objects[entry] > 0 for entry in (*needed, cia402.HOMING_ACCELERATION))
        self.phase = HomingPhase.SEARCHING if possible else HomingPhase.FAILED
        return None

    def interrupt(self) -> None:
        """Ends homing before its time; the reference slows down to rest."""
        if self.phase not in (HomingPhase.ATTAINED, HomingPhase.FAILED):
            self.phase = HomingPhase.IDLE

    def step(self, position_m: float, velocity_m_s: float) -> float | None:
        """Moves `reference_m`, the servo's target, by one step, and advances the phase: searches the switch,
        leaves it, comes to rest. Returns `position_m`, the new origin, at the step that leaves the switch,
        else None. Homing fails at an end without a switch.
        """
        reference_m, wanted_m_s = None, 0.0
        way = -1 if self._objects[cia402.HOMING_METHOD] == NEGATIVE_SWITCH else 1
        low_m, high_m = self.switches_m
        on_switch = position_m <= low_m if way < 0 else position_m >= high_m
        if self.phase is HomingPhase.SEARCHING:
            if on_switch:
                self.phase = HomingPhase.LEAVING
            elif not self._ends_m[0] < self.reference_m < self._ends_m[1]:
                self.phase = HomingPhase.FAILED
                self.hold(position_m)
        elif self.phase is HomingPhase.LEAVING and not on_switch:
            self.phase, reference_m = HomingPhase.STOPPING, position_m
        elif self.phase is HomingPhase.STOPPING and abs(velocity_m_s) < _HOMED_AT_REST_M_S:
            self.phase = HomingPhase.ATTAINED
        if self.phase is HomingPhase.SEARCHING:
            wanted_m_s = way * self._objects[cia402.HOMING_SEARCH_SPEED] / self._per_m
        elif self.phase is HomingPhase.LEAVING:
            wanted_m_s = -way * self._objects[cia402.HOMING_ZERO_SPEED] / self._per_m
        most = self._objects[cia402.HOMING_ACCELERATION] / self._per_m * self._dt_s
        self.velocity_m_s += max(-most, min(most, wanted_m_s - self.velocity_m_s))
        self.reference_m += self.velocity_m_s * self._dt_s
        return reference_m

    @property
    def status(self) -> int:
        return _STATUS.get(self.phase, 0)


Moved = Callable[[float, float, float, float], None]
"""Called at every step of the servo: t_s, and x_m, v_m_s, a_m_s2 of the carriage."""


class DriveModel:
    """A drive without its bus: controlwords and targets in, statusword and motion out.

    Args:
        settings: the mechanics: travel, limits, bandwidth, where it starts.
        counts_per_m: of its encoder; zero at x = 0, until it is homed.
        rate_hz: of its servo.
        moved: called at every step.

    Attributes:
        objects: of its profile, as they were written.
        origin_m: where its count is 0.
        alarms: emergency codes that have not been sent yet.
        stuck: whether something blocks it.
    """

    def __init__(
        self, settings: StageSettings, counts_per_m: float, rate_hz: int = 2000, moved: Moved | None = None
    ) -> None:
        self._dt_s = 1.0 / rate_hz
        self._servo = PlantStage(settings, self._dt_s)
        self._counts_per_m, self._moved = counts_per_m, moved
        self.objects = dict(OBJECTS)
        self.state = DriveState.DISABLED
        self.alarms: list[int] = []
        self.stuck = self._broken = False
        self._control = 0
        self._target: int | None = None
        self._from_m = self._to_m = settings.start_m
        self._synced_s = self._t_s = self._behind_s = self.origin_m = 0.0
        self._period_s = 0.004
        ends_m = settings.travel_lower_m, settings.travel_upper_m
        self.homing = DriveHoming(self.objects, ends_m, counts_per_m, self._dt_s)
        self._carriage = (settings.start_m, 0.0, 0.0)

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
    def mode(self) -> int:
        return self.objects[cia402.MODE]

    @property
    def statusword(self) -> int:
        """Statusword of the state, with the bits of the mode: target followed, or the status of homing."""
        word = PATTERNS[self.state][1] | _VOLTAGE | _REMOTE
        if self.state is DriveState.DISABLED:
            word |= _QUICK_STOP_OFF
        if self.state is DriveState.ENABLED and self.mode == cia402.CSP:
            word |= _FOLLOWS
        if self.mode == cia402.HOMING:
            word |= self.homing.status
        return word

    # --- what it is told ---

    def control(self, word: int) -> None:
        """Takes a controlword and changes the state by it; in the mode of homing it starts or interrupts
        homing. In a fault only the rising edge of bit 7 counts: it resets the fault, unless the drive is
        broken.
        """
        rising = word & ~self._control
        self._control = word
        if self.state is DriveState.FAULT:
            if rising & cia402.FAULT_RESET and not self._broken:
                self.state, self.objects[cia402.ERROR_CODE] = DriveState.DISABLED, 0
            return
        if self.state is not DriveState.FAULT_REACTION:
            self._switch(word)
        if self.mode != cia402.HOMING:
            return
        if self.state is not DriveState.ENABLED or not word & cia402.HOMING_START or word & cia402.HALT:
            self.homing.interrupt()
        elif rising & cia402.HOMING_START:
            self._set_origin(self.homing.start(self._servo.position_m))

    def _set_origin(self, reference_m: float | None) -> None:
        """Restarts the count at a reference that was found; nothing for None."""
        if reference_m is not None:
            self.origin_m = reference_m - self.objects[cia402.HOME_OFFSET] / self._counts_per_m

    def target(self, counts: int) -> None:
        """Stores a target position, object 607A, for the next SYNC."""
        self._target = counts

    def sync(self, t_s: float) -> None:
        """Begins to interpolate to the newest target, clamped to the software limits, over one period from
        `t_s`. Outside of the cyclic mode the target stays as it is.
        """
        objects = self.objects
        self._from_m = self._reference_m(t_s)[0]
        if self._target is not None and self.mode == cia402.CSP:
            low, high = objects[cia402.SOFT_LIMIT_LOW], objects[cia402.SOFT_LIMIT_HIGH]
            self._to_m = self.origin_m + max(low, min(high, self._target)) / self._counts_per_m
        self._period_s = objects[cia402.PERIOD_VALUE] * 10.0 ** objects[cia402.PERIOD_EXPONENT]
        self._synced_s = t_s

    def lose_host(self) -> None:
        """Puts the drive, if enabled, in quick stop where object 6007 says so, otherwise in a fault."""
        if self.state is not DriveState.ENABLED:
            return
        if self.objects[cia402.ABORT_OPTION] == cia402.ABORT_QUICK_STOP:
            self.state = DriveState.QUICK_STOP
        else:
            self.fail(HEARTBEAT_LOST)

    def fail(self, code: int, broken: bool = False) -> None:
        """Begins a fault; a broken drive stays in it whatever it is told."""
        self._broken = self._broken or broken
        if self.state not in (DriveState.FAULT, DriveState.FAULT_REACTION):
            self.state, self.objects[cia402.ERROR_CODE] = DriveState.FAULT_REACTION, code
            self.alarms.append(code)

    def _switch(self, word: int) -> None:
        """Changes the state as bits 0 to 3 of a controlword demand (CiA 402)."""
        state = self.state
        if not word & 0x02:
            self.state = DriveState.DISABLED
        elif not word & 0x04:
            moving = state in (DriveState.ENABLED, DriveState.QUICK_STOP)
            self.state = DriveState.QUICK_STOP if moving else DriveState.DISABLED
        elif state is DriveState.QUICK_STOP:
            if word & 0x0F == cia402.ENABLE:
                self._start()
        elif not word & 0x01:
            self.state = DriveState.READY
        elif state is DriveState.SWITCHED_ON and word & 0x08:
            self._start()
        elif state is not DriveState.DISABLED and not (state is DriveState.ENABLED and word & 0x08):
            self.state = DriveState.SWITCHED_ON

    def _start(self) -> None:
        """Enters OPERATION ENABLED; the servo follows the target at once, for this mode has no ramp. Without
        a target, or in the mode of homing, it stays where it is.
        """
        self.state = DriveState.ENABLED
        if self._target is None or self.mode == cia402.HOMING:
            self._from_m = self._to_m = self._servo.position_m
            self.homing.hold(self._servo.position_m)
        else:
            self._from_m = self._to_m = self.origin_m + self._target / self._counts_per_m

    # --- time ---

    def advance(self, t_s: float) -> None:
        while self._t_s + self._dt_s <= t_s:
            self._t_s += self._dt_s
            self._step(self._t_s)

    def _reference_m(self, t_s: float) -> tuple[float, float]:
        """Target of the servo at `t_s`, (m, m/s): interpolated, at rest after the period, or of homing."""
        if self.mode == cia402.HOMING:
            return self.homing.reference_m, self.homing.velocity_m_s
        share = (t_s - self._synced_s) / self._period_s
        if share >= 1.0:
            return self._to_m, 0.0
        span_m = self._to_m - self._from_m
        return self._from_m + span_m * max(0.0, share), span_m / self._period_s

    def _step(self, t_s: float) -> None:
        """Moves the carriage on by one period of the servo, towards the reference while enabled, else to
        rest. Watches the following error, ends a fault reaction at rest, and calls `moved`.
        """
        if self.state is DriveState.ENABLED:
            if self.mode == cia402.HOMING:
                self._set_origin(self.homing.step(self._servo.position_m, self.velocity_m_s))
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
            self._carriage = (self._carriage[0], 0.0, 0.0)
        else:
            self._carriage = self._servo.step(t_s)
        if self.state is DriveState.FAULT_REACTION and abs(self.velocity_m_s) <= _AT_REST_M_S:
            self.state = DriveState.FAULT
        if self._moved is not None:
            self._moved(t_s, *self._carriage)

    def _watch(self, reference_m: float) -> None:
        error = abs(reference_m - self._servo.position_m) * self._counts_per_m
        late = error > self.objects[cia402.FOLLOWING_WINDOW]
        self._behind_s = self._behind_s + self._dt_s if late else 0.0
        if self._behind_s > self.objects[cia402.FOLLOWING_TIMEOUT_MS] * 1e-3:
            self.fail(FOLLOWING)


def contents(node: int) -> dict[ObjectEntry, float]:
    """Returns the object dictionary of the emulated drive: every entry with its value at the start."""
    return {
        **common_contents(node, cia402.PROFILE, SERIAL),
        cia301.SYNC_PERIOD_US: 0,
        ObjectEntry(0x1016, 0, "B"): 1,
        cia301.HEARTBEAT_CONSUMER: 0,
        **{ObjectEntry(index, 0, "B"): 2 for index in (0x607D, 0x6099, 0x60C2)},
        **OBJECTS,
    }


class Drive402(CanopenDevice):
    """The drive: run `step` over and over in one thread.

    Args:
        bus: an open bus of its own.
        node: its identifier.
        model: the drive behind the bus.
        now_s: a clock.
    """

    faults = "unplug", "plug", "drive_fault", "stuck", "free"

    def __init__(
        self, bus: can.BusABC, node: int, model: DriveModel, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self.model = model
        self._listens_to, self._silence_s = 0, 0.0
        self._last_beat_s: float | None = None
        super().__init__(bus, node, contents(node), now_s)

    def provoke(self, fault: str) -> None:
        """Begins `drive_fault` (overcurrent, until a reset), `stuck` until `free`, `unplug` until `plug`."""
        if fault == "drive_fault":
            self.model.fail(OVERCURRENT)
        elif fault in ("stuck", "free"):
            self.model.stuck = fault == "stuck"
        else:
            super().provoke(fault)

    def written(self, index: int, sub: int, value: bytes) -> None:
        """Stores an object that the host wrote in the model, and acts on controlword and target; the
        heartbeat consumer sets whose heartbeat the drive watches and how long it may be silent. Ignores
        objects that the drive does not use. SdoAbortedError: a homing method that it has not.
        """
        entry = _ENTRIES.get((index, sub))
        if entry is None:
            return
        number = unpacked(entry, value)
        if entry is cia402.HOMING_METHOD and number not in METHODS:
            raise canopen.SdoAbortedError(_INVALID)
        self.model.objects[entry] = number
        if entry is cia402.CONTROLWORD:
            self.model.control(number)
        elif entry is cia402.TARGET_POSITION:
            self.model.target(number)
        elif entry is cia301.HEARTBEAT_CONSUMER:
            self._listens_to, self._silence_s = number >> 16 & 0x7F, (number & 0xFFFF) * 1e-3
            self._last_beat_s = None

    def shown(self, index: int, sub: int) -> float | None:
        """Returns statusword, position in counts, displayed mode or error code; None for any other object."""
        del sub
        model = self.model
        if index == cia402.STATUSWORD.index:
            return model.statusword
        if index == cia402.POSITION_ACTUAL.index:
            return model.position
        if index == cia402.MODE_DISPLAY.index:
            return model.mode
        return model.objects[cia402.ERROR_CODE] if index == cia402.ERROR_CODE.index else None

    def synchronised(self, t_s: float) -> None:
        self.model.sync(t_s)

    def received(self, can_id: int, t_s: float) -> None:
        if can_id == cia301.HEARTBEAT + self._listens_to and self._silence_s:
            self._last_beat_s = t_s

    def left_operational(self) -> None:
        self.model.lose_host()

    def live(self, t_s: float) -> None:
        """Moves the drive on to `t_s`, and sends an emergency for each alarm. When the host's heartbeat, once
        received, stays away, it stops the drive and goes to PRE-OPERATIONAL.
        """
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


def build(settings: Cia402Settings, around: Surroundings, leave: ExitStack) -> Drive402:
    """Builds the emulated drive on its CAN bus, for `Emulation`; its motion moves the simulated vessel.

    Its limit switches lie beyond the travel; the one that it is homed to at `home_m`, if that does, too.
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
    model = DriveModel(stage, settings.counts_per_m, moved=hook)
    return Drive402(bus, settings.node_id, model, around.now_s)


EMULATION = Emulation({"node_id": 1, "counts_per_m": 1e7, "travel_m": TRAVEL_M}, build, on_can=True)
