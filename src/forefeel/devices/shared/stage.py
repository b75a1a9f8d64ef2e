"""Parts of the stage drivers: native units, setpoints, the way from the control loop to the thread."""

from datetime import date
from threading import Lock
from typing import NamedTuple

from forefeel.common.errors import ConfigurationError, DeviceSetupError
from forefeel.common.hardware.calibration import StageCalibration, stage_calibration
from forefeel.devices.shared.settings import ScaledStageSettings


class PositionScale(NamedTuple):
    """`native = zero + per_m * x`, in microsteps or counts; `per_m` has the sign of the axis."""

    zero: float
    per_m: float

    def native(self, x_m: float) -> int:
        return round(self.zero + self.per_m * x_m)

    def metres(self, native: float) -> float:
        return (native - self.zero) / self.per_m

    def ends(self, travel_m: tuple[float, float]) -> tuple[int, int]:
        low, high = sorted(self.native(end_m) for end_m in travel_m)
        return low, high


def calibrated(settings: ScaledStageSettings, serial: str) -> tuple[StageCalibration | None, PositionScale]:
    """Returns (calibration, scale): the file that the settings name, and its zero and counts per metre.
    Without a file: (None, the scale of the settings with zero 0). The settings' sign is in the scale.
    DeviceSetupError: the file is of another device, out of date, or does not fit the settings.
    """
    path, native_per_m = settings.calibration, settings.native_per_m
    if path is None:
        return None, PositionScale(0.0, settings.sign * native_per_m)
    try:
        calibration = stage_calibration(
            path, settings.driver, serial, date.today(), settings.travel_m, native_per_m
        )
    except ConfigurationError as error:
        raise DeviceSetupError(str(error)) from error
    return calibration, PositionScale(calibration.zero, settings.sign * calibration.native_per_m)


class Wanted(NamedTuple):
    """Target position and velocity of the stage at a stamp of the host's clock."""

    position_m: float
    velocity_m_s: float
    stamp_ns: int


class Setpoint:
    """Position that follows a target with a bounded velocity, within the travel; never jumps.

    Args:
        period_s: of the cycle.
        travel_m: its range; a drive that starts outside is only led back.
        max_velocity_m_s: the most that it moves.
        deceleration_m_s2: with which `hold` comes to rest.
    """

    def __init__(
        self,
        period_s: float,
        travel_m: tuple[float, float],
        max_velocity_m_s: float,
        deceleration_m_s2: float,
    ) -> None:
        self._period_s = period_s
        self._low_m, self._high_m = travel_m
        self._most_m = max_velocity_m_s * period_s
        self._brake_m_s = deceleration_m_s2 * period_s
        self.position_m = self.velocity_m_s = 0.0

    def within_travel(self, position_m: float) -> float:
        return max(self._low_m, min(self._high_m, position_m))

    def restart(self, actual_m: float) -> None:
        self.position_m, self.velocity_m_s = actual_m, 0.0

    def follow(self, wanted_m: float) -> None:
        step_m = self.within_travel(wanted_m) - self.position_m
        step_m = max(-self._most_m, min(self._most_m, step_m))
        self.position_m += step_m
        self.velocity_m_s = step_m / self._period_s

    def hold(self) -> None:
        """Moves the position on by one cycle while slowing down with the deceleration, until it rests. At an
        end of the travel it stops at once, with velocity 0.
        """
        v = self.velocity_m_s
        v = max(0.0, v - self._brake_m_s) if v > 0.0 else min(0.0, v + self._brake_m_s)
        free_m = self.position_m + v * self._period_s
        low_m, high_m = min(self._low_m, self.position_m), max(self._high_m, self.position_m)
        self.position_m = max(low_m, min(high_m, free_m))
        self.velocity_m_s = v if self.position_m == free_m else 0.0


class SetpointMailbox:
    """Newest setpoint, or hold. A hold goes before every setpoint until the drive has acknowledged it."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._setpoint: Wanted | None = None
        self._stop_due = False

    def command(self, setpoint: Wanted) -> None:
        with self._lock:
            self._setpoint = setpoint

    def hold(self) -> None:
        """Drops the setpoint; a stop is due if there was one."""
        with self._lock:
            self._stop_due = self._stop_due or self._setpoint is not None
            self._setpoint = None

    def now(self) -> tuple[bool, Wanted | None]:
        """(a stop is due, the newest setpoint; None: hold)."""
        with self._lock:
            return self._stop_due, self._setpoint

    def stopped(self) -> None:
        """Clears the stop that the drive has acknowledged; to be called before any setpoint is sent to it."""
        with self._lock:
            self._stop_due = False
