"""The axis of an emulated Zaber stage: trapezoidal motion in steps of 1 ms, homing, stalls. Pure."""

from collections.abc import Callable
from enum import Enum
from math import copysign, sqrt

STEP_S = 0.001
_STALL_S = 0.05
_NEAR = 1e-6  # microsteps


class AxisMode(Enum):
    """What the axis is doing."""

    IDLE = "idle"
    POSITION = "position"
    VELOCITY = "velocity"
    HOME = "home"
    STOP = "stop"


class ZaberAxis:
    """Positions in microsteps from the home sensor; `reported` from what the axis takes for its home.

    Attributes:
        maximum_speed, acceleration: limits, in microsteps/s and /s^2.
        limits: where it may go, in reported microsteps.
        flags: the warning flags that are set.
        stuck: whether something blocks it.
        ended: called when a motion has ended.
    """

    def __init__(self, ends: tuple[float, float], position: float, homed: bool) -> None:
        self.position, self.velocity, self.change = position, 0.0, 0.0
        self.maximum_speed, self.acceleration, self.homing_speed = 1.0, 1.0, 1.0
        self.limits = ends
        self.flags: set[str] = set()
        self.stuck = False
        self.enabled = True
        self.ended: Callable[[], None] | None = None
        self.motion = AxisMode.IDLE
        self._ends = ends
        self._reference = 0.0
        self._goal = 0.0
        self._stalled_s = 0.0
        if not homed:
            self.lose_reference()

    @property
    def reported(self) -> float:
        """The position as the axis knows it."""
        return self.position - self._reference

    @property
    def busy(self) -> bool:
        """Whether it moves or is to move."""
        return self.motion is not AxisMode.IDLE

    def lose_reference(self) -> None:
        """As after power was off: it takes where it is for zero, and says so."""
        self._reference = self.position
        self.motion, self.velocity = AxisMode.IDLE, 0.0
        self.flags = {"WR"}
        self.enabled = True

    def place(self, reported: float) -> None:
        """It is told where it is: a reference, but no home."""
        self._reference = self.position - reported
        self.flags = self.flags - {"WR"} | {"WH"}

    def begin(self, motion: AxisMode, goal: float = 0.0) -> None:
        """A motion: to a reported position, at a velocity, to the home sensor, or to rest."""
        if self.busy:
            self.flags.add("NI")
        else:
            self.flags.discard("NI")
        self.motion, self._goal = motion, goal

    def disable(self, flag: str) -> None:
        """The driver is off: the axis comes to rest and takes no motion."""
        self.enabled = False
        self.flags.add(flag)
        if self.busy:
            self.begin(AxisMode.STOP)

    def step(self) -> None:
        """One millisecond."""
        before = self.velocity
        if self.busy:
            self._move()
        self.change = (self.velocity - before) / STEP_S

    def _move(self) -> None:
        wanted, most = self._wanted(), self.acceleration * STEP_S
        self.velocity = max(self.velocity - most, min(self.velocity + most, wanted))
        if self.velocity and (self.stuck or self._beyond(self.position + self.velocity * STEP_S)):
            self._stall()
            return
        self._stalled_s = 0.0
        self.position += self.velocity * STEP_S
        if self.velocity == wanted == 0.0:
            self._end()

    def _wanted(self) -> float:
        """The velocity that the motion asks for."""
        if self.motion is AxisMode.STOP:
            return 0.0
        if self.motion is AxisMode.HOME:
            return self._towards(-self.position, self.homing_speed)
        if self.motion is AxisMode.POSITION:
            return self._towards(self._goal - self.reported, self.maximum_speed)
        room = self.limits[1 if self._goal > 0 else 0] - self.reported
        return self._towards(room, abs(self._goal)) if room * self._goal > 0 else 0.0

    def _towards(self, distance: float, fastest: float) -> float:
        """The largest velocity, of at most `fastest`, that comes to rest in that distance.

        Braking in steps of dt from v covers at most v^2 / 2A + v dt / 2 + A dt^2 / 8; one step is to land.
        """
        way, brake = abs(distance), self.acceleration * STEP_S
        if way < _NEAR:
            return 0.0
        if way <= brake * STEP_S:
            return copysign(min(fastest, way / STEP_S), distance)
        room = way - 0.125 * brake * STEP_S
        largest = sqrt(0.25 * brake * brake + 2.0 * self.acceleration * room) - 0.5 * brake
        return copysign(min(fastest, largest), distance)

    def _beyond(self, position: float) -> bool:
        margin = 0.01 * (self._ends[1] - self._ends[0])
        outward = self.velocity if position > 0.5 * sum(self._ends) else -self.velocity
        return outward > 0 and not self._ends[0] - margin <= position <= self._ends[1] + margin

    def _stall(self) -> None:
        self.velocity = 0.0
        self._stalled_s += STEP_S
        if self.motion is AxisMode.STOP:
            self._end()
        elif self._stalled_s >= _STALL_S:
            self.flags.add("FS")
            self._stalled_s = 0.0
            self._end()

    def _end(self) -> None:
        if self.motion is AxisMode.HOME and "FS" not in self.flags:
            self._reference = 0.0
            self.flags -= {"WR", "WH"}
        self.motion = AxisMode.IDLE
        if self.ended is not None:
            self.ended()
