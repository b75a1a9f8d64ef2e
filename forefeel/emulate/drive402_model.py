"""A CiA 402 drive without its bus: the state machine, the cyclic setpoint and the servo. Pure."""

from collections.abc import Callable

from forefeel.common.hardware import cia402
from forefeel.common.hardware.cia402 import PATTERNS, DriveState
from forefeel.emulate.drive402_homing import DriveHoming
from forefeel.slave.plant.settings import StageSettings
from forefeel.slave.plant.stage import PlantStage

OVERCURRENT, HEARTBEAT_LOST, FOLLOWING = 0x2310, 0x8130, 0x8611
_VOLTAGE, _QUICK_STOP_OFF, _REMOTE, _FOLLOWS = 1 << 4, 1 << 5, 1 << 9, 1 << 12
_AT_REST_M_S = 1e-9
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
        """Of the motor."""
        return self._servo.position_m

    @property
    def velocity_m_s(self) -> float:
        """Of the motor."""
        return 0.0 if self.stuck else self._servo.velocity_m_s

    @property
    def position(self) -> int:
        """In counts."""
        return round((self._servo.position_m - self.origin_m) * self._counts_per_m)

    @property
    def velocity(self) -> int:
        """In counts per second."""
        return round(self.velocity_m_s * self._counts_per_m)

    @property
    def following_error(self) -> int:
        """In counts; 0 while it does not follow."""
        if self.state is not DriveState.ENABLED:
            return 0
        return round((self._reference_m(self._t_s)[0] - self._servo.position_m) * self._counts_per_m)

    @property
    def statusword(self) -> int:
        """As 6041."""
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
        """A controlword."""
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
        """A target position, for the next SYNC."""
        self._target = counts

    def sync(self, t_s: float) -> None:
        """SYNC: the target counts from now on; the drive interpolates over one period."""
        self._from_m = self._reference_m(t_s)[0]
        if self._target is not None and self.mode == cia402.CSP:
            low, high = self.soft_limits
            kept = max(low, min(high, self._target))
            self._limited = kept != self._target
            self._to_m = self.origin_m + kept / self._counts_per_m
        self._synced_s = t_s

    def lose_host(self) -> None:
        """The heartbeat that it listens to has ended, or the PDOs: what 6007 says."""
        if self.state is not DriveState.ENABLED:
            return
        if self.abort_option == cia402.ABORT_QUICK_STOP:
            self.state = DriveState.QUICK_STOP
        elif self.abort_option == 2:
            self.state = DriveState.DISABLED
        elif self.abort_option == 1:
            self.fail(HEARTBEAT_LOST)

    def fail(self, code: int, broken: bool = False) -> None:
        """A fault; a broken drive stays in it whatever it is told."""
        self._broken = self._broken or broken
        if self.state not in (DriveState.FAULT, DriveState.FAULT_REACTION):
            self.state, self.error_code = DriveState.FAULT_REACTION, code
            self.alarms.append(code)

    # --- time ---

    def advance(self, t_s: float) -> None:
        """Servo steps up to that time."""
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
