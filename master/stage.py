"""Where the stage is expected when it executes a command: behind the shared limits, then the drive's lag.

Pure. The slave's own limits come first, so that what a drive can not do is not mistaken for its lag.
"""

from common.estimation.stage_lag import StageLag
from common.limiter import MotionLimiter
from common.settings import AxisLimits

_MAX_STEP_S = 0.010


class ExpectedStage:
    """The slave's stage as the master knows it.

    Attributes:
        lag: what has been identified of the drive.
    """

    def __init__(self, limits: AxisLimits) -> None:
        self.lag = StageLag()
        self._limiter = MotionLimiter(limits, limits.max_acceleration_m_s2)
        self._previous_ns: int | None = None

    def at(self, stamp_ns: int, position_m: float, velocity_m_s: float, deadman: bool) -> float:
        """The position in m at which the command of that stamp will be answered.

        Without the deadman nothing moves: the command is the stage's own position.
        """
        previous_ns, self._previous_ns = self._previous_ns, stamp_ns
        if not deadman or previous_ns is None or stamp_ns <= previous_ns:
            self._limiter.place(position_m)
        else:
            dt_s = min((stamp_ns - previous_ns) * 1e-9, _MAX_STEP_S)
            self._limiter.follow(position_m, velocity_m_s, 0.0, dt_s)
        return self.lag.command(stamp_ns, self._limiter.position_m)
