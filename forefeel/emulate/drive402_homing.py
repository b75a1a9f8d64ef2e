"""The mode of homing of an emulated CiA 402 drive: onto a limit switch, off it again. Pure."""

from enum import Enum

from forefeel.common.hardware.cia402 import (
    HERE,
    HOMING_ATTAINED,
    HOMING_ERROR,
    NEGATIVE_SWITCH,
    POSITIVE_SWITCH,
    TARGET_REACHED,
)

SWITCH_M = 0.5e-3
_AT_REST_M_S = 1e-6
METHODS = frozenset({NEGATIVE_SWITCH, POSITIVE_SWITCH}) | HERE


class HomingPhase(Enum):
    """What it is about."""

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
        """It is switched on there."""
        self.reference_m, self.velocity_m_s = position_m, 0.0

    def start(self, position_m: float) -> float | None:
        """Begins; the reference, when that is all."""
        if self.method in HERE:
            self.phase = HomingPhase.ATTAINED
            return position_m
        possible = self.method in METHODS and min(self.search_m_s, self.zero_m_s, self.acceleration_m_s2) > 0
        self.phase = HomingPhase.SEARCHING if possible else HomingPhase.FAILED
        return None

    def interrupt(self) -> None:
        """Ends it before its time; it comes to rest."""
        if self.phase in _MOVING:
            self.phase = HomingPhase.IDLE

    def step(self, position_m: float, velocity_m_s: float) -> float | None:
        """One step of the servo, which is there and goes so fast; the reference, when it is just found."""
        found = None
        if self.phase is HomingPhase.SEARCHING:
            if self._active(position_m):
                self.phase = HomingPhase.LEAVING
            elif not self._ends_m[0] < self.reference_m < self._ends_m[1]:
                self.phase = HomingPhase.FAILED
                self.hold(position_m)
        elif self.phase is HomingPhase.LEAVING and not self._active(position_m):
            self.phase, found = HomingPhase.STOPPING, position_m
        elif self.phase is HomingPhase.STOPPING and abs(velocity_m_s) < _AT_REST_M_S:
            self.phase = HomingPhase.ATTAINED
        self._follow()
        return found

    def status(self, at_rest: bool) -> int:
        """Its bits of the statusword."""
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
        """Whether the switch of this method answers."""
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
