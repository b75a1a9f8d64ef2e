"""Where the drive will be when it executes a command: its lag, identified from commands and readbacks.

The master knows its command now; the contact feels the stage. Below its bandwidth a stable drive of unit gain
follows a command c like the first terms of its transfer function's Taylor series at s = 0:

    x_s = c - T1 c' + T2 c''                                                                      (S1)

T1 is the lag in s (zero for a drive with full velocity feed-forward), T2 in s^2 what is left under
acceleration (1 / w^2 for a servo of bandwidth w). Both come from recursive least squares over pairs of a
command and the readback that answers it; derivatives and the readback's deviation pass the same filter.

Reference: Astrom and Hagglund, PID Controllers, 2nd ed. (1995), chapter 2, the method of moments.
"""

from math import isfinite
from typing import NamedTuple

from common.estimation.rls import RecursiveLeastSquares
from common.estimation.state_filter import StateFilter

_RING = 8192
_CUTOFF_HZ = 20.0
_MEMORY_S = 20.0
_GAP_S = 0.1
_SETTLING_S = 0.2
_MIN_UPDATES = 500
_TYPICAL_M_S, _TYPICAL_M_S2 = 0.02, 0.3
_BOUNDS = ((-0.05, 0.2), (-0.05, 0.05))


class _Sent(NamedTuple):
    """A command as it was sent: number, stamp in s, position in m, filtered derivatives."""

    sequence: int
    t_s: float
    position_m: float
    velocity_m_s: float
    acceleration_m_s2: float


class StageLag:
    """T1 and T2 of (S1), and the expected position for a command.

    `command` runs in the haptic loop, `observe` and `update` beside it; what they share is one list, whose
    entries are replaced as a whole, and one tuple.

    Attributes:
        lag_s, lag2_s2: T1 and T2 in use; zero until enough has been seen of a moving stage.
    """

    def __init__(self) -> None:
        self._ring: list[_Sent | None] = [None] * _RING
        self._motion = StateFilter(_CUTOFF_HZ)
        self._deviation = StateFilter(_CUTOFF_HZ)
        self._rls = RecursiveLeastSquares(
            (_TYPICAL_M_S, _TYPICAL_M_S2), _MEMORY_S, bounds=_BOUNDS, noise_floor=1e-6
        )
        self._lags = (0.0, 0.0)
        self._commanded_s: float | None = None
        self._observed_s: float | None = None
        self._since_restart_s = 0.0

    @property
    def lag_s(self) -> float:
        """T1 in s."""
        return self._lags[0]

    @property
    def lag2_s2(self) -> float:
        """T2 in s^2."""
        return self._lags[1]

    def command(self, sequence: int, t_s: float, position_m: float) -> float:
        """The position in m at which the stage will answer the command sent at `t_s`, master's clock."""
        dt = _GAP_S if self._commanded_s is None else t_s - self._commanded_s
        if not (isfinite(position_m) and dt > 0.0):
            return position_m
        self._commanded_s = t_s
        if dt >= _GAP_S:
            self._motion.reset()
        _, v, a = self._motion.step(position_m, dt)
        self._ring[sequence % _RING] = _Sent(sequence, t_s, position_m, v, a)
        lag_s, lag2_s2 = self._lags
        return position_m - lag_s * v + lag2_s2 * a

    def observe(self, sequence: int, readback_m: float) -> None:
        """The readback in m that answers a command; in the order of the commands, a late one is left out."""
        sent = self._ring[sequence % _RING]
        if sent is None or sent.sequence != sequence or not isfinite(readback_m):
            return
        dt = _GAP_S if self._observed_s is None else sent.t_s - self._observed_s
        if dt <= 0.0:
            return
        self._observed_s = sent.t_s
        if dt >= _GAP_S:
            self._deviation.reset()
            self._since_restart_s = 0.0
        y, _, _ = self._deviation.step(readback_m - sent.position_m, dt)
        self._since_restart_s += dt
        if self._since_restart_s > _SETTLING_S:
            self._rls.update((-sent.velocity_m_s, sent.acceleration_m_s2), y, dt)

    def update(self) -> None:
        """Makes what was learned known to `command`; for tens of calls per second."""
        if self._rls.updates >= _MIN_UPDATES:
            first, second = self._rls.parameters
            self._lags = (first, second)
