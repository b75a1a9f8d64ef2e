"""Watch over the wire between gripper and sheath: it slips through the jaws, or is about to bow out. It warns
and stops nothing. Pure.

Slip: the force gives way within some ms though the stage does not go back. How much of that is usual, noise,
a pulse or what a brake does, is learned on the way, in the same kind of motion.

    d = mean f(t - 12 .. t - 7 ms) - mean f(t - 2 .. t),   slip where d > 10 rms of d so far

The way that is lost is the way in which the stage has to go further for the same force again.

Bowing out: Euler's load pi^2 EI / (K L)^2 of what is free, L = free length - position, where it is given.
"""

from collections import deque
from math import sqrt
from operator import sub

from forefeel.common.events.text import BUCKLES, LOOSENS, SLIPS
from forefeel.common.limiter import LimitHit
from forefeel.slave.settings import InstrumentSettings
from forefeel.slave.stage import StageReading

_BEFORE, _GAP, _NOW = 5, 5, 2  # ticks of the two means, and between them
_WAY = 30  # ticks of each of two ways by which the motion is judged
_MEANT, _STRIDE, _INWARD_M = 20, 4, 4e-6
"""Ticks in which the stage goes in all the time: so many m in each so many of them, 1 mm/s."""
_STEADY_M_S, _STEADY = 2e-3, 0.2  # change of the speed between these ways: at most this, or this share
_EVEN = 0.6  # of the longest of these steps is the shortest: where the stage slows down friction goes
_TIMES = 10.0  # the usual rms: the peaks of a pulse and of brakes are some 3 to 4 of it
_USUAL, _LEARNED = 10_000, 500  # ticks of steady motion that are usual, and before anything is told
_AGAIN_NS = 100_000_000  # between two slips that are told
_NEAR, _FAR = 0.8, 0.7  # of a load from which on it is told, and from which on it may be again
_STRAIGHT_M = 1e-3  # that is free at least


class InstrumentWatch:
    """Detects slip and forces near a load. `slipped_m`: way lost, about; `since_ns`: of the first slip."""

    def __init__(self, loads: InstrumentSettings) -> None:
        self.slipped_m = 0.0
        self.since_ns: int | None = None
        self._near = set[str]()
        self._loads = loads
        self._forces: deque[float] = deque(maxlen=_BEFORE + _GAP + _NOW)
        self._ways: deque[float] = deque(maxlen=2 * _WAY + 1)
        self._usual_n2, self._learned, self._told_ns = 0.0, 0, -_AGAIN_NS
        self._slipped_at: tuple[float, float] | None = None

    def take(
        self, now_ns: int, stage: StageReading, force_n: float, valid: bool, held: bool
    ) -> list[LimitHit]:
        """Warnings of one tick, mostly none: a load that the force has come near, a slip that begins, or its
        length once the force is back. Unless `held` (jaws closed, stage following) and `valid`, none, and it
        restarts but for what it has learned.
        """
        if not (valid and held):
            self._forces.clear()
            self._ways.clear()
            self._near.clear()
            self._slipped_at = None
            return []
        self._forces.append(force_n)
        self._ways.append(stage.position_m)
        hits: list[LimitHit] = []
        for rule, load_n in self._loads_n(stage.position_m):
            size_n = force_n if rule == BUCKLES else abs(force_n)
            if size_n <= (_FAR if rule in self._near else _NEAR) * load_n:
                self._near.discard(rule)
            elif rule not in self._near:
                self._near.add(rule)
                hits.append(LimitHit(rule, size_n, load_n, "N"))
        if len(self._ways) == self._ways.maxlen and self._slips(now_ns, stage.position_m, force_n):
            hits.append(LimitHit(SLIPS, self.slipped_m, 0.0, "m"))
        return hits

    @property
    def near_load(self) -> str | None:
        """Rule of the load that the force is near to."""
        return min(self._near, key=(BUCKLES, LOOSENS).index, default=None)

    def _slips(self, now_ns: int, x_m: float, force_n: float) -> bool:
        """True where a slip begins, or the length of the last one becomes known. Updates the usual drop of
        the force, `since_ns` and `slipped_m`.
        """
        if not self._steady():
            return self._force_is_back(x_m, force_n)
        forces = list(self._forces)
        before_n, now_n = sum(forces[:_BEFORE]) / _BEFORE, sum(forces[-_NOW:]) / _NOW
        drop_n, self._learned = before_n - now_n, self._learned + 1
        if now_ns - self._told_ns < _AGAIN_NS:
            return False
        if self._learned < _LEARNED or drop_n < _TIMES * sqrt(self._usual_n2):
            self._usual_n2 += (drop_n * drop_n - self._usual_n2) / min(self._learned, _USUAL)
            return self._force_is_back(x_m, force_n)
        self._told_ns, self.since_ns = now_ns, now_ns if self.since_ns is None else self.since_ns
        if self._slipped_at is not None:  # that of before ends here, whatever force it has come to
            self.slipped_m += max(x_m - self._slipped_at[0], 0.0)
        self._slipped_at = x_m, before_n
        return True

    def _force_is_back(self, x_m: float, force_n: float) -> bool:
        """True once the force is what it was before the last slip, whose way is added to `slipped_m` then:
        by so much the stage is further in.
        """
        if self._slipped_at is None or force_n < self._slipped_at[1]:
            return False
        self.slipped_m += max(x_m - self._slipped_at[0], 0.0)
        self._slipped_at = None
        return True

    def _steady(self) -> bool:
        """True if the stage goes in, at 1 mm/s or faster, and hardly changes its speed."""
        ways_m = list(self._ways)
        first_m, second_m = ways_m[_WAY] - ways_m[0], ways_m[-1] - ways_m[_WAY]
        if first_m < 0.0:
            return False
        recent_m = ways_m[: -_MEANT - 1 : -_STRIDE]
        steps_m = list(map(sub, recent_m, recent_m[1:]))
        if min(steps_m) < max(_INWARD_M, _EVEN * max(steps_m)):
            return False
        return abs(second_m - first_m) < max(_STEADY_M_S * _WAY * 1e-3, _STEADY * first_m)

    def _loads_n(self, position_m: float) -> list[tuple[str, float]]:
        """Rule and load in N of each load that the settings give, that of bowing out at `position_m`."""
        loads, known = self._loads, []
        if loads.euler_n_m2 is not None and loads.free_length_m is not None:
            free_m = max(loads.free_length_m - position_m, _STRAIGHT_M)
            known.append((BUCKLES, loads.euler_n_m2 / free_m**2))
        if loads.holding_n is not None:
            known.append((LOOSENS, loads.holding_n))
        return known
