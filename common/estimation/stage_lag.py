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

from forefeel.common.estimation.rls import RecursiveLeastSquares
from forefeel.common.estimation.state_filter import GAP_S, StateFilter
from forefeel.common.slots import CommandRing

_CUTOFF_HZ = 20.0  # Hz, cutoff of both filters
_MEMORY_S = 20.0  # s, time constant of forgetting
# s after a start of the filters in which nothing is learned: 12 time constants of their slowest poles, each
# 1 / (pi _CUTOFF_HZ) = 16 ms
_SETTLING_S = 0.2
_EVERY_S = 0.004  # s, least time between two readbacks that are learned: 250 Hz, over 12 times the cutoff
_MIN_UPDATES = 250  # updates before the lag is used: 1 s of motion at 250 Hz
_PUBLISH_EVERY = 20  # updates between two lags that are used: 80 ms at 250 Hz
# m/s and m/s^2, usual velocity and acceleration of a stage, which scale the prior
_TYPICAL_M_S, _TYPICAL_M_S2 = 0.02, 0.3
_BOUNDS = ((-0.05, 0.2), (-0.05, 0.05))  # s of T1 and s^2 of T2, lower and upper bound


class _Sent(NamedTuple):
    """A command as it was sent: position in m, filtered derivatives."""

    position_m: float
    velocity_m_s: float
    acceleration_m_s2: float


class StageLag:
    """T1 and T2 of (S1), and the expected position for a command.

    `command` runs in the haptic loop, `observe` beside it; what they share is one list, whose entries are
    replaced as a whole, and one tuple.

    Attributes:
        lag_s, lag2_s2: T1 and T2 in use; zero until enough has been seen of a moving stage.
    """

    def __init__(self) -> None:
        self._sent = CommandRing[_Sent]()
        self._motion = StateFilter(_CUTOFF_HZ)
        self._deviation = StateFilter(_CUTOFF_HZ)
        self._rls = RecursiveLeastSquares((_TYPICAL_M_S, _TYPICAL_M_S2), _MEMORY_S, _BOUNDS)
        self._lags = (0.0, 0.0)
        self._commanded_ns: int | None = None
        self._observed_ns: int | None = None
        self._since_restart_s = 0.0

    @property
    def lag_s(self) -> float:
        """T1 in s."""
        return self._lags[0]

    @property
    def lag2_s2(self) -> float:
        """T2 in s^2."""
        return self._lags[1]

    def command(self, stamp_ns: int, position_m: float) -> float:
        """The position in m at which the stage will answer the command of that stamp."""
        dt = GAP_S if self._commanded_ns is None else (stamp_ns - self._commanded_ns) * 1e-9
        if not (isfinite(position_m) and dt > 0.0):
            return position_m
        self._commanded_ns = stamp_ns
        if dt >= GAP_S:
            self._motion.reset()
        _, v, a = self._motion.step(position_m, dt)
        self._sent.put(stamp_ns, _Sent(position_m, v, a))
        lag_s, lag2_s2 = self._lags
        return position_m - lag_s * v + lag2_s2 * a

    def observe(self, stamp_ns: int, readback_m: float) -> None:
        """The readback in m that answers the command of that stamp.

        Out of order, or less than 4 ms after the last, it is left out: the filters pass no more.
        """
        sent = self._sent.get(stamp_ns)
        if sent is None or not isfinite(readback_m):
            return
        dt = GAP_S if self._observed_ns is None else (stamp_ns - self._observed_ns) * 1e-9
        if dt < _EVERY_S:
            return
        self._observed_ns = stamp_ns
        if dt >= GAP_S:
            self._deviation.reset()
            self._since_restart_s = 0.0
        y, _, _ = self._deviation.step(readback_m - sent.position_m, dt)
        self._since_restart_s += dt
        if self._since_restart_s > _SETTLING_S:
            self._rls.update((-sent.velocity_m_s, sent.acceleration_m_s2), y, dt)
            if self._rls.updates >= _MIN_UPDATES and self._rls.updates % _PUBLISH_EVERY == 0:
                first, second = self._rls.parameters
                self._lags = (first, second)
