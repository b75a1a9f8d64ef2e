"""The motion that a bench is asked for: fixed blocks within its limits, whatever the question is.

A logarithmic sweep (mass, lag, modes), steps with holds (relaxation, delay), one stroke over the whole range
at three speeds (drag, damping, contact), reversals of eleven sizes, the smaller the slower (dry friction and
its fall with speed, play, presliding). A motion chosen by optimal design names no more of what is hidden and
more of what is not: it separates the models that it was chosen for, and hides what none of them says.

All blocks begin and end at rest at home, 30 % of the range. Speeds are trapezoids; they are rounded by a
window of positive weights, by which no position, speed or acceleration becomes larger.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil, inf, log, pi, sqrt

import numpy as np

from forefeel.common.error_size import Floats
from forefeel.common.errors import ConfigurationError
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.signals import Signals

RATE_HZ = 1000.0
SECONDS = 10.0, 20.0, 60.0
"""Shortest, usual and longest motion; 10 s lose a tenth of the names, 30 s win none."""
_STEP_S = 1.0 / RATE_HZ
_ROUNDED_S, _SAMPLES = 0.03, 6.0
"""Length of the window, and in samples of a recording, which tells no quicker motion from spikes."""
_HOME = 0.3  # of the range
_SPEED, _ACCELERATION = 0.9, 0.85  # of the limits, that strokes use at most
_SWEEP_HZ = 0.5, 12.0
_OF_RATE = 0.2  # of a recording's rate, up to which it tells a sine
_PACES = 0.2, 3.0  # times the speed of all but the fastest strokes
_TRIES = 4
_BEFORE, _LEAST_LEFT = 0.95, 0.1  # of the way to where the force limit was met; of the range, that is left
_SIZES = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.1, 0.05, 0.02, 0.01, 0.003, 0.001, 1e-4, 1e-5)  # of the range


@dataclass(frozen=True, slots=True)
class Limits:
    """Range in m, speed, acceleration and size of the force that a motion stays within."""

    low_m: float
    high_m: float
    speed_m_s: float
    acceleration_m_s2: float
    force_n: float = inf

    def __post_init__(self) -> None:
        sizes = self.high_m - self.low_m, self.speed_m_s, self.acceleration_m_s2, self.force_n
        if not all(size > 0.0 for size in sizes):
            bounds = f"{self.low_m:g} to {self.high_m:g} m, {', '.join(f'{size:g}' for size in sizes[1:])} SI"
            expected = "a range that rises, and speed, acceleration and force above 0"
            raise ConfigurationError(f"limits {bounds}: expected {expected}")

    @classmethod
    def reached(cls, signals: Signals) -> "Limits":
        """Range, largest speed, acceleration and force of a recording, in the band of its diagnosis."""
        x, v, a = (values[signals.recorded] for values in (signals.fine_x, signals.fine_v, signals.fine_a))
        most = (float(np.max(np.abs(values))) for values in (v, a, signals.force))
        return cls(float(x.min()), float(x.max()), *most)

    @property
    def span_m(self) -> float:
        return self.high_m - self.low_m

    @property
    def home_m(self) -> float:
        return self.low_m + _HOME * self.span_m

    def shrunk(self, share: float, about_m: float) -> "Limits":
        """Copy with range (about `about_m`), speed and acceleration times `share`; the force stays."""
        low_m, high_m = (about_m + share * (end_m - about_m) for end_m in (self.low_m, self.high_m))
        speed_m_s, acceleration_m_s2 = share * self.speed_m_s, share * self.acceleration_m_s2
        return Limits(low_m, high_m, speed_m_s, acceleration_m_s2, self.force_n)

    def before(self, met: "ForceLimitMet") -> "Limits":
        """Copy whose high end (low end unless `inward`) is at 95 % of the way to where the force limit was
        met; at least about a tenth of the range is left.
        """
        end_m, way_m = (self.low_m, self.span_m) if met.inward else (self.high_m, -self.span_m)
        share = float(np.clip((met.position_m - end_m) / way_m, _LEAST_LEFT, 1.0))
        nearest_m = end_m + _BEFORE * share * way_m
        return replace(self, high_m=nearest_m) if met.inward else replace(self, low_m=nearest_m)


@dataclass(frozen=True, slots=True)
class ForceLimitMet:
    """Time in s of a motion and position in m at which a bench met its force limit; `inward`: by a force that
    resists a rising position.
    """

    time_s: float
    position_m: float
    inward: bool


def play_excitation(
    limits: Limits,
    duration_s: float,
    rate_hz: float,
    play: Callable[[Recording, Limits], ForceLimitMet | None],
) -> None:
    """Makes the motion of `excitation` and calls `play` with it and its limits; where that returns a met
    force limit, plays again from the interrupted block on, in a range that ends before that place. Four calls
    at most.

    `play`: moves the bench and goes home where it meets the limit; returns None if it did not.
    """
    after = 0
    for _ in range(_TRIES):
        met = play(excitation(limits, duration_s, rate_hz, after), limits)
        if met is None:
            return
        # at the last sample no block is left: the last one is played again
        after = min(after + int(met.time_s / duration_s * len(_BLOCKS)), len(_BLOCKS) - 1)
        limits = limits.before(met)


def excitation(
    limits: Limits, duration_s: float = SECONDS[1], rate_hz: float = inf, after: int = 0
) -> Recording:
    """Motion to record: the four blocks within the limits, without a force, at 1 kHz from 0 s on; the same
    for the same arguments.

    Args:
        limits: of the bench.
        duration_s: 10 to 60, of all blocks.
        rate_hz: at which it will be recorded: the sweep ends at a fifth of it, and nothing is quicker than
            six samples.
        after: number of blocks that are left out at its beginning.

    Raises:
        ConfigurationError: another duration.
    """
    if not SECONDS[0] <= duration_s <= SECONDS[-1]:
        expected = f"{SECONDS[0]:g} to {SECONDS[-1]:g} s"
        raise ConfigurationError(f"a motion of {duration_s:g} s: expected {expected}")
    fastest_hz = min(_SWEEP_HZ[1], _OF_RATE * rate_hz)
    paths = [_block_path(block, limits, duration_s / len(_BLOCKS), fastest_hz) for block in _BLOCKS[after:]]
    x = _rounded(np.concatenate(paths), max(_ROUNDED_S, _SAMPLES / rate_hz))
    return Recording("motion", np.arange(len(x), dtype=np.float64) * _STEP_S, x, None, "motion")


class _Path:
    """Positions in m at 1 kHz, drawn piece by piece within limits; each piece begins and ends at rest.

    `pace`: of all strokes but the fastest, and of rests. `fastest_hz`: of sines. Places and sizes are shares
    of the range.
    """

    def __init__(self, limits: Limits, pace: float, fastest_hz: float) -> None:
        self.limits, self.pace, self.fastest_hz = limits, pace, fastest_hz
        self._pieces: list[Floats] = [np.array([limits.home_m])]

    @property
    def here_m(self) -> float:
        return float(self._pieces[-1][-1])

    def drawn(self) -> Floats:
        """Goes home, and returns the whole path."""
        self.home()
        return np.concatenate(self._pieces)

    def rest(self, seconds: float) -> None:
        self._pieces.append(np.full(max(1, ceil(seconds / self.pace / _STEP_S)), self.here_m))

    def home(self) -> None:
        self._go_to(self.limits.home_m, 0.3)

    def go(self, place: float, speed: float) -> None:
        """Stroke to a place at a share of the speed."""
        self._go_to(self.limits.low_m + place * self.limits.span_m, speed)

    def _go_to(self, target_m: float, speed: float) -> None:
        """Appends a stroke to `target_m` with a trapezoid of speed, at `speed` of the limit times the pace;
        nothing where the path is there already.
        """
        way_m = target_m - self.here_m
        fastest, a = _SPEED * self.limits.speed_m_s, _ACCELERATION * self.limits.acceleration_m_s2
        v = min(speed * self.pace * self.limits.speed_m_s, fastest, sqrt(abs(way_m) * a))
        if v == 0.0:
            return
        rising_s, took_s = v / a, abs(way_m) / v + v / a
        samples = ceil(took_s / _STEP_S)
        t = np.arange(1, samples + 1) * (took_s / samples)  # a little slower, to end on a sample
        left_s = np.maximum(took_s - t, 0.0)
        done = np.where(t < rising_s, 0.5 * a * t**2, v * (t - 0.5 * rising_s))
        done = np.where(left_s < rising_s, abs(way_m) - 0.5 * a * left_s**2, done)
        self._pieces.append(self.here_m + np.sign(way_m) * done)

    def sine(self, from_hz: float, to_hz: float, seconds: float, size: float) -> None:
        """Appends a sine about the present position, its frequency rising by equal factors, as large as the
        limits and `size`, a share of the range, let it.
        """
        limits, here_m = self.limits, self.here_m
        t = np.arange(1, ceil(seconds / _STEP_S) + 1) * _STEP_S
        rise = log(to_hz / from_hz) / t[-1]
        turns = from_hz * (t if rise == 0.0 else np.expm1(rise * t) / rise)
        w = 2.0 * pi * from_hz * np.exp(rise * t)
        room_m = min(here_m - limits.low_m, limits.high_m - here_m, size * limits.span_m)
        bounds_m = np.array(
            [0.8 * limits.speed_m_s / w, 0.8 * limits.acceleration_m_s2 / w**2, room_m + 0.0 * w]
        )
        size_m = np.sum(bounds_m**-4.0, axis=0) ** -0.25  # below each, without the corners of a minimum
        edge_s = min(0.4, 0.5 / from_hz, 0.3 * float(t[-1]))
        edge = np.sin(0.5 * pi * np.clip(np.minimum(t, t[-1] - t) / edge_s, 0.0, 1.0)) ** 2
        path = edge * size_m * np.sin(2.0 * pi * turns)
        # where the size changes it is faster than a sine of that size
        v = np.diff(path, prepend=0.0, append=0.0) / _STEP_S
        a = np.diff(v, prepend=0.0, append=0.0) / _STEP_S
        most = np.max(np.abs(v)) / limits.speed_m_s, np.max(np.abs(a)) / limits.acceleration_m_s2
        self._pieces.append(here_m + path / max(1.0, *(float(share) / _SPEED for share in most)))


_Block = Callable[[_Path], None]


def _sweep(path: _Path) -> None:
    path.go(0.5, 0.3)
    path.sine(_SWEEP_HZ[0], path.fastest_hz, 5.5 / path.pace, 0.25)


def _steps(path: _Path) -> None:
    path.rest(0.5)
    path.go(0.8, 0.9)
    path.rest(3.0)
    path.go(0.1, 0.9)
    path.rest(2.5)


def _speeds(path: _Path) -> None:
    path.rest(0.2)
    for speed in (0.08, 0.25, 0.85):
        path.go(0.98, speed)
        path.go(0.02, speed)


def _reversals(path: _Path) -> None:
    path.go(0.5, 0.3)
    for size in (0.01, 0.02, 0.05, 0.1, 0.2, 0.4, 0.2, 0.1, 0.05, 0.02, 0.01):
        path.go(0.5 + 0.5 * size, 0.4 * size)
        path.go(0.5 - 0.5 * size, 0.4 * size)


_BLOCKS: Sequence[_Block] = (_sweep, _steps, _speeds, _reversals)


def _block_path(block: _Block, limits: Limits, duration_s: float, fastest_hz: float) -> Floats:
    """Path of a block, `duration_s` long: in as much of the range, about home, as the quickest pace manages
    in that time, then at the slowest pace that does, then at rest.
    """
    samples, path = round(duration_s / _STEP_S), np.empty(0)

    def drawn(size: float, pace: float) -> Floats:
        """Path of the block at `pace`, in the share `size` of the range about home."""
        low_m, high_m = (
            limits.home_m + size * (end - limits.home_m) for end in (limits.low_m, limits.high_m)
        )
        path = _Path(replace(limits, low_m=low_m, high_m=high_m), pace, fastest_hz)
        block(path)
        return path.drawn()

    for size in _SIZES:
        slow, quick = _PACES
        if len(path := drawn(size, quick)) > samples:
            continue
        for _ in range(8):
            pace = sqrt(slow * quick)
            if len(slower := drawn(size, pace)) > samples:
                slow = pace
            else:
                quick, path = pace, slower
        break
    return np.append(path, np.full(max(samples - len(path), 0), path[-1]))


def _rounded(x: Floats, length_s: float) -> Floats:
    weights = np.hanning(int(length_s / _STEP_S) + 2)[1:-1]
    padded = np.pad(x, len(weights), mode="edge")
    return np.asarray(np.convolve(padded, weights / weights.sum(), "valid"), dtype=np.float64)
