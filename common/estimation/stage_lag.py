"""Lag of the drive, identified from commands and readbacks, and the position expected for a command.

The master knows its command; the contact follows the stage. Below its bandwidth a stable drive of unit gain
follows a command c like the first terms of its transfer function's Taylor series at s = 0:

    x_s = c - T1 c' + T2 c''                                                                      (S1)

T1 is the lag in s (zero for a drive with full velocity feed-forward), T2 in s^2 what is left under
acceleration (1 / w^2 for a servo of bandwidth w). Both come from recursive least squares in information form,
as in `experts`, over pairs of a command and the readback that answers it; derivatives and the readback's
deviation y = x_s - c pass the same filter. With u = (-c', c''), h the time since the last pair and m the
square of the motion over that of usual motion, at most 1,

    R <- lambda R + h u u',   r <- lambda r + h u y,   lambda = exp(-m h / 20 s),                     (S2)
    T = (R + D)^-1 (r + D T0)

so that as much is forgotten as is learned, and a hand that trembles while it holds takes nothing away. D is
the information of a millisecond of usual motion, T0 the lag that is expected.

Reference: Astrom and Hagglund, PID Controllers, 2nd ed. (1995), chapter 2, the method of moments.
"""

from math import exp, isfinite

from forefeel.common.estimation.state_filter import GAP_S, StateFilter
from forefeel.common.slots import CommandRing

_CUTOFF_HZ = 20.0  # Hz, cutoff of both filters
_MEMORY_S = 20.0  # s of usual motion, time constant of forgetting
# s after a start of the filters in which nothing is learned: 12 time constants of their slowest poles, each
# 1 / (pi _CUTOFF_HZ) = 16 ms
_SETTLING_S = 0.2
_EVERY_S = 0.004  # s, least time between two readbacks that are learned: 250 Hz, over 12 times the cutoff
_KNOWN_S = 1.0  # s of motion before the lag is used
_TYPICAL_M_S, _TYPICAL_M_S2 = 0.02, 0.3  # m/s and m/s^2, usual velocity and acceleration of a stage
_STILL = 1e-4  # m of standstill
_RIDGE_S = 0.001
_BOUNDS = ((-0.05, 0.3), (-0.05, 0.05))  # s of T1 and s^2 of T2, lower and upper bound


class StageLag:
    """T1 and T2 of (S1), and the expected position for a command.

    `command` runs in the haptic loop, `observe` beside it; what they share is one list, whose entries are
    replaced as a whole, and one tuple.

    Attributes:
        lags: T1 in s and T2 in s^2, in use; as expected until enough has been seen of a moving stage.
        known: from then on.
    """

    def __init__(self, expected_s: float = 0.0) -> None:
        self.lags = (expected_s, 0.0)
        self.known = False
        self._expected_s = expected_s
        self._sent = CommandRing[tuple[float, float, float]]()  # position in m, filtered derivatives
        self._motion = StateFilter(_CUTOFF_HZ)
        self._deviation = StateFilter(_CUTOFF_HZ)
        self._sums = [0.0] * 5  # of R: 11, 12, 22; of r: 1, 2
        self._known_s = 0.0
        self._commanded_ns: int | None = None
        self._observed_ns: int | None = None
        self._since_restart_s = 0.0

    def command(self, stamp_ns: int, position_m: float, lags: tuple[float, float] | None = None) -> float:
        """Records a command for `observe`; returns the position in m at which the stage is expected, by
        `lags` or else the newest ones learned.

        One that is not finite, or no later than the last, is not recorded and gives `position_m`. A pause of
        0.1 s restarts the filter.
        """
        dt = GAP_S if self._commanded_ns is None else (stamp_ns - self._commanded_ns) * 1e-9
        if not (isfinite(position_m) and dt > 0.0):
            return position_m
        self._commanded_ns = stamp_ns
        if dt >= GAP_S:
            self._motion.reset()
        _, v, a = self._motion.step(position_m, dt)
        self._sent.put(stamp_ns, (position_m, v, a))
        lag_s, lag2_s2 = lags or self.lags
        return position_m - lag_s * v + lag2_s2 * a

    def observe(self, stamp_ns: int, readback_m: float) -> None:
        """Learns the lags from the readback in m that answers the command of that stamp.

        It is ignored if its command is unknown, or it is not finite or less than 4 ms after the last. After a
        start or a pause of 0.1 s nothing is learned for 0.2 s.
        """
        dt = GAP_S if self._observed_ns is None else (stamp_ns - self._observed_ns) * 1e-9
        if dt < _EVERY_S or not isfinite(readback_m):
            return
        sent = self._sent.get(stamp_ns)
        if sent is None:
            return
        self._observed_ns = stamp_ns
        if dt >= GAP_S:
            self._deviation.reset()
            self._since_restart_s = 0.0
        position_m, v, a = sent
        y, _, _ = self._deviation.step(readback_m - position_m, dt)
        self._since_restart_s += dt
        if self._since_restart_s > _SETTLING_S:
            self._learn(-v, a, y, dt)

    def _learn(self, u1: float, u2: float, y: float, h: float) -> None:
        """Updates R and r of (S2), and after 1 s of motion sets `lags`, within bounds, and `known`. u1, u2:
        -c' and c'' of the command c; y: deviation of the readback, filtered, in m; h: s since the last pair.
        T2 is optimal for the bounded T1.
        """
        motion = min(1.0, (u1 / _TYPICAL_M_S) ** 2 + (u2 / _TYPICAL_M_S2) ** 2)
        keep, products = exp(-motion * h / _MEMORY_S), (u1 * u1, u1 * u2, u2 * u2, u1 * y, u2 * y)
        self._sums = [keep * total + h * product for total, product in zip(self._sums, products, strict=True)]
        self._known_s += h if motion > _STILL else 0.0
        if self._known_s < _KNOWN_S:
            return
        r11, r12, r22, r1, r2 = self._sums
        r11 += _RIDGE_S * _TYPICAL_M_S**2
        r1 += _RIDGE_S * _TYPICAL_M_S**2 * self._expected_s
        r22 += _RIDGE_S * _TYPICAL_M_S2**2
        first = _within((r22 * r1 - r12 * r2) / (r11 * r22 - r12 * r12), _BOUNDS[0])
        self.lags, self.known = (first, _within((r2 - r12 * first) / r22, _BOUNDS[1])), True


def _within(value: float, bounds: tuple[float, float]) -> float:
    return min(max(value, bounds[0]), bounds[1])
