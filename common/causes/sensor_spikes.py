"""Isolated outliers of the load cell chain: a loose contact, a disturbed conversion."""

from math import floor

import numpy as np

from forefeel.common.causes.base import Parameter, SensorEffect
from forefeel.common.causes.offline import Array

_SLOTS = 10
"""Slots per mean interval; each holds a spike with the probability of one in so many."""

_LONGEST_S = 0.1  # s, longest spike: the upper bound of `duration_s`; a longer step of time counts as this
_MASK_64 = 0xFFFFFFFFFFFFFFFF  # 2^64 - 1: keeps integers within 64 bits, as SplitMix64 computes


class SensorSpikes(SensorEffect):
    """Spikes at irregular instants, `rate_hz` of them per second on average, each up or down.

    One lasts `duration_s`, or one step where that is longer (0.1 s at most), and adds 0.5 to 1.5 times
    `amplitude_n`. Instants and sizes are a hash of `seed` and time: equal seeds and times give equal spikes,
    at any rate of steps.
    """

    name = "sensor_spikes"
    parameters = (
        Parameter("rate_hz", "Hz", 0.0, 0.0, 1e3, linear=False),
        Parameter("amplitude_n", "N", 0.0, 0.0, 1e4, linear=False),
        Parameter("duration_s", "s", 0.001, 1e-6, 0.1, linear=False),
        Parameter("seed", "", 0.0, 0.0, 2.0**31, linear=False),
    )
    reference = "Bernoulli process of additive outliers; hash: Steele, Lea and Flood, SplitMix, OOPSLA 2014"
    fingerprint = "single readings far off their neighbours, at instants that motion does not explain"
    words = "isolated outliers of the load cell"

    def _configure(self) -> None:
        self._amplitude_n, self._duration_s = self.values["amplitude_n"], self.values["duration_s"]
        self._slots_hz = self.values["rate_hz"] * _SLOTS
        self._seed = int(self.values["seed"]) * 0xD1342543DE82EF95
        self._slot = 0
        self._spike = self._in_slot(0)

    def sense(self, t: float, force_n: float, dt: float) -> float:
        """The force in N, and the newest spike where one lasts."""
        if self._slots_hz == 0.0:
            return force_n
        since = t - min(max(dt, self._duration_s), _LONGEST_S)
        first = floor(since * self._slots_hz)
        for slot in range(floor(t * self._slots_hz), first - 1, -1):
            if slot != self._slot:
                self._slot, self._spike = slot, self._in_slot(slot)
            if self._spike is not None and since < self._spike[0] <= t:
                return force_n + self._spike[1]
        return force_n

    def _in_slot(self, slot: int) -> tuple[float, float] | None:
        """(instant s, size N) of the spike in a slot, if it holds one."""
        if self._slots_hz == 0.0 or _uniform(slot * 4 + self._seed) * _SLOTS >= 1.0:
            return None
        place, size = _uniform(slot * 4 + 1 + self._seed), _uniform(slot * 4 + 2 + self._seed)
        share = 2.0 * size - 1.0
        return (slot + place) / self._slots_hz, self._amplitude_n * (share + (0.5 if share >= 0.0 else -0.5))

    def _readings(self, t: Array, force_n: Array, dt: Array) -> Array:
        if self._slots_hz == 0.0 or not len(t):
            return force_n
        instants, sizes_n = self._between(float(t[0]) - _LONGEST_S, float(t[-1]))
        reached = np.searchsorted(t, instants)  # fewer to search for than stamps
        newest = np.cumsum(np.bincount(reached, minlength=len(t) + 1)[: len(t)]) - 1
        since = t - np.clip(dt, self._duration_s, _LONGEST_S)
        lasting = np.flatnonzero(instants[newest] > since)
        readings = np.array(force_n, dtype=np.float64)
        readings[lasting] += sizes_n[newest[lasting]]
        return readings

    def _between(self, start: float, end: float) -> tuple[Array, Array]:
        """Instants and sizes of the spikes between two times, and some before; never empty."""
        slots = np.arange(floor(start * self._slots_hz) - 1, floor(end * self._slots_hz) + 1)
        hold = slots[_uniforms(slots * 4, self._seed) * _SLOTS < 1.0]
        share = 2.0 * _uniforms(hold * 4 + 2, self._seed) - 1.0
        sizes_n = self._amplitude_n * (share + np.where(share >= 0.0, 0.5, -0.5))
        instants = (hold + _uniforms(hold * 4 + 1, self._seed)) / self._slots_hz
        return np.append(-np.inf, instants), np.append(0.0, sizes_n)


def _uniform(number: int) -> float:
    """SplitMix64 of an integer, in [0, 1)."""
    z = (number * 0x9E3779B97F4A7C15) & _MASK_64
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & _MASK_64
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & _MASK_64
    return float((z ^ (z >> 31)) >> 11) * 2.0**-53


def _uniforms(numbers: np.ndarray[tuple[int], np.dtype[np.int64]], seed: int) -> Array:
    """`_uniform` of each number plus the seed; unsigned integers wrap as the mask does."""
    z = (numbers.astype(np.uint64) + np.uint64(seed & _MASK_64)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return ((z ^ (z >> np.uint64(31))) >> np.uint64(11)).astype(np.float64) * 2.0**-53
