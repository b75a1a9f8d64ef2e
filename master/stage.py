"""Where the stage is expected when it executes a command: behind the limits that both ends share, and its
lag.

Pure. The limits come first, so that what a drive can not do is not mistaken for its lag.
"""

from forefeel.common.estimation.stage_lag import StageLag
from forefeel.common.limiter import MotionLimiter
from forefeel.common.settings import AxisLimits

# s, longest step of time that the limits count; the same as in `slave/control.py`, which is computed here
_MAX_STEP_S = 0.010


class ExpectedStage:
    """The slave's stage as the master knows it."""

    def __init__(self, limits: AxisLimits) -> None:
        self._lag, self._workspace_m = StageLag(), limits.workspace_m
        self._limiter = MotionLimiter(limits, limits.max_acceleration_m_s2)
        self._previous_ns: int | None = None

    def setpoint_m(self, stamp_ns: int, position_m: float, velocity_m_s: float, deadman: bool) -> float:
        """What the slave's limits will leave of the command of that stamp.

        Without the deadman nothing moves: the command is the stage's own position, as the network says it.
        """
        position_m = min(max(position_m, self._workspace_m[0]), self._workspace_m[1])
        previous_ns, self._previous_ns = self._previous_ns, stamp_ns
        if not deadman or previous_ns is None or stamp_ns <= previous_ns:
            self._limiter.place(position_m)
        else:
            dt_s = min((stamp_ns - previous_ns) * 1e-9, _MAX_STEP_S)
            self._limiter.follow(position_m, velocity_m_s, 0.0, dt_s)
        return self._limiter.position_m

    def position_m(self, stamp_ns: int, setpoint_m: float) -> float:
        """Where the drive will be when it answers that setpoint, by the lag that has been identified."""
        return self._lag.command(stamp_ns, setpoint_m)

    def observe(self, stamp_ns: int, readback_m: float) -> None:
        """The readback that answers the command of that stamp."""
        self._lag.observe(stamp_ns, readback_m)
