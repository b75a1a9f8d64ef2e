"""Benches of the first generator, drawn once for a hand of 20 s and then driven with any motion.

An effect takes 6 to 20 % of the force of the hand; noise is 5 mN, coloured, with some white beside it; the
rate is 100 Hz, an encoder's step 1 um. Time goes on between recordings, so a drift moves the zero.
"""

from dataclasses import replace
from itertools import cycle
from zlib import crc32

import numpy as np
from scipy.interpolate import CubicSpline

from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.excitation import ForceLimitMet, Limits, play_excitation
from tests.hidden_effects.generator import OUTSIDE_NAMES, VOCABULARY, Hidden, Noise, Truth, drawn_pairs
from tests.hidden_effects.generator.draw import _drawn_base, _drawn_forms, sized
from tests.hidden_effects.generator.motion import BEFORE_S, RATE_HZ, STEP_S, Motion, drawn_motion, log_uniform
from tests.hidden_effects.generator.parts import Base, Part, Scene, transmit
from tests.hidden_effects.generator.scan import Array, one_pole
from tests.hidden_effects.generator.truth import reading

USUAL, NARROW = "usual", "narrow"
REST_S, RECORDED_HZ = 20.0, 100.0
_HAND_S = 20.0
_UNFIT = {"bias", "mains_hum", "stiffness_change"}
"""What every recording has, what 100 Hz does not show, and what happened before the answer."""
_NAMES = [name for name in VOCABULARY if name not in _UNFIT]
_SHARES = (0.06, 0.2)
_FIRST = ("constant", "triangle", "ramp", "tiny", "operator", "sine")


def kinds(seed: int) -> list[str]:
    """46 singles and 11 pairs of the vocabulary, 16 outside of it, 10 with nothing."""
    pairs = [kind for kind in drawn_pairs(seed, 40) if not _UNFIT & set(kind.split("+"))][:11]
    singles = [name for name, _ in zip(cycle(_NAMES), range(46))]
    outside = [name for name, _ in zip(cycle(OUTSIDE_NAMES), range(16))]
    return [*singles, *pairs, *outside, *["nothing"] * 10]


class Bench:
    """One bench with `limits`; its clock goes on with each recording."""

    def __init__(self, kind: str, seed: int, number: int, narrow: bool) -> None:
        self._rng = rng = np.random.default_rng((crc32(kind.encode()), seed, number))
        forms = _drawn_forms(rng, kind)
        inserted = next(
            (form.inserted for form in forms if form.inserted is not None), bool(rng.random() < 0.5)
        )
        hand = drawn_motion(rng, "hand", _HAND_S, inserted)
        self._base: Base = _drawn_base(rng, hand, any(form.light for form in forms))
        scene = Scene(hand, self._base, self._base.force(hand.x, hand.v, hand.a), _HAND_S, RECORDED_HZ)
        self.parts: tuple[Part, ...] = ()
        for form in forms:
            part = Part(form, form.draw(rng, scene))
            self.parts += (part if form.own_size else sized(part, scene, log_uniform(rng, *_SHARES)),)
        self.noise = Noise(5e-3, log_uniform(rng, 5.0, 50.0), rng.uniform(0.3e-3, 1.3e-3), 1e-6)
        self.limits = _limits_of(hand)
        if narrow:
            whole, quarter_m = self.limits, 0.25 * self.limits.span_m
            low_m = rng.uniform(whole.low_m, whole.high_m - quarter_m)
            self.limits = Limits(
                low_m, low_m + quarter_m, whole.speed_m_s / 6.0, whole.acceleration_m_s2 / 10.0
            )
        self._now_s = 0.0
        self._number = number
        self._limited = number % 8 == 7
        self.force_limit_met = 0

    @property
    def names(self) -> frozenset[str]:
        """Those that are hidden; a capstan is none of the generator's."""
        return frozenset(part.form.name for part in self.parts)

    def first(self) -> Hidden:
        """A poor recording of 5 to 12 s; the force limit of every eighth bench is just above it."""
        path = poor(_FIRST[self._number % len(_FIRST)], self.limits, self._rng)
        recorded = self._moved(path)
        if self._limited:
            most_n = 1.05 * float(np.max(np.abs(self._force(path))))
            self.limits = replace(self.limits, force_n=most_n)
        return recorded

    def answer(self, limits: Limits, duration_s: float) -> Hidden:
        """The motion asked for; where the force limit is met it ends, goes home, and what is left of it is
        played up to that place.
        """
        paths: list[Array] = []

        def play(motion: Recording, limits: Limits) -> ForceLimitMet | None:
            path = motion.position_m
            if paths:
                paths.append(_stroke(float(paths[-1][-1]), float(path[0]), limits))
            force_n = self._force(path)
            over = np.flatnonzero(np.abs(force_n) > limits.force_n)
            if not len(over):
                paths.append(path)
                return None
            at = max(int(over[0]), 1)
            self.force_limit_met += 1
            paths.append(_braked(path[:at], limits))
            return ForceLimitMet(at / 1000.0, float(path[at]), bool(force_n[at] > 0.0))

        play_excitation(limits, duration_s, RECORDED_HZ, play)
        return self._moved(np.concatenate(paths))

    def _force(self, path: Array) -> Array:
        """Force in N along a path at 1 kHz, without noise."""
        motion = _motion(path, self._now_s)
        return np.interp(
            self._now_s + np.arange(len(path)) / 1000.0, motion.t, transmit(motion, self._base, self.parts)
        )

    def _moved(self, path: Array) -> Hidden:
        motion, rng = _motion(path, self._now_s), self._rng
        time_s = self._now_s + np.arange(int(len(path) / 1000.0 * RECORDED_HZ)) / RECORDED_HZ
        pole = float(np.exp(-2.0 * np.pi * self.noise.corner_hz / RECORDED_HZ))
        coloured = one_pole(pole, rng.standard_normal(len(time_s) + 200))[200:]
        noise = self.noise.rms_n * np.sqrt(1.0 - pole * pole) * coloured
        noise = noise + self.noise.white_n * rng.standard_normal(len(time_s))
        force_n = reading(motion, self._base, self.parts, time_s, noise)
        position_m = np.round(np.interp(time_s, motion.t, motion.x) / 1e-6) * 1e-6
        self._now_s += len(path) / 1000.0 + REST_S
        truth = Truth(self.parts, (), "hand", float(np.ptp(time_s)), RECORDED_HZ, self._base, self.noise)
        return Hidden(time_s, position_m, force_n, truth, motion)


def _limits_of(hand: Motion) -> Limits:
    x, v, a = (values[hand.t >= 0.0] for values in (hand.x, hand.v, hand.a))
    return Limits(float(x.min()), float(x.max()), float(np.abs(v).max()), float(np.abs(a).max()))


def _motion(path: Array, start_s: float) -> Motion:
    """A path at 1 kHz on the generator's grid, at rest before and after it."""
    coarse = np.pad(path, (round(1000.0 * BEFORE_S), 20), mode="edge")
    t = np.arange(len(coarse)) / 1000.0 - BEFORE_S
    fine = np.arange(round((len(coarse) - 1) / 1000.0 * RATE_HZ)) * STEP_S - BEFORE_S
    spline = CubicSpline(t, coarse)
    x, v, a = (np.asarray(spline(fine, order), dtype=np.float64) for order in range(3))
    return Motion(np.asarray(fine + start_s, dtype=np.float64), x, v, a)


def _braked(path: Array, limits: Limits) -> Array:
    """The path, braked at half of the acceleration at its end."""
    v, half = 1000.0 * float(path[-1] - path[max(len(path) - 2, 0)]), 0.5 * limits.acceleration_m_s2
    t = np.arange(1, int(1000.0 * abs(v) / half) + 2) / 1000.0
    return np.append(path, path[-1] + v * t - 0.5 * np.sign(v) * half * t**2)


def _stroke(start_m: float, end_m: float, limits: Limits) -> Array:
    """Minimum-jerk path at half of the acceleration and of the speed at most."""
    way_m = end_m - start_m
    took = max(
        3.8 * abs(way_m) / limits.speed_m_s, np.sqrt(11.6 * abs(way_m) / limits.acceleration_m_s2), 0.1
    )
    s = np.linspace(0.0, 1.0, int(1000.0 * took) + 2)[1:]
    return np.asarray(start_m + way_m * s**3 * (10.0 - 15.0 * s + 6.0 * s * s))


def poor(kind: str, limits: Limits, rng: np.random.Generator) -> Array:
    """Path at 1 kHz of a recording as people make them first: one speed, one size, slow ramps."""
    seconds, v = rng.uniform(5.0, 10.0), limits.speed_m_s

    def at(share: float) -> float:
        return limits.low_m + share * limits.span_m

    if kind == "sine":
        hz, size = rng.uniform(0.3, 0.8), rng.uniform(0.15, 0.4) * limits.span_m
        w = 2.0 * np.pi * hz
        size = min(size, 0.5 * v / w, 0.5 * limits.acceleration_m_s2 / w**2)
        t = np.arange(int(1000 * seconds)) / 1000.0
        return np.asarray(at(0.5) + size * np.minimum(1.0, t * hz) * np.sin(w * t))
    points: list[tuple[float, float]] = []  # place, seconds to it
    if kind == "constant":
        points = [(at(0.05), 0.0), (at(rng.uniform(0.6, 0.95)), seconds)]
    elif kind == "ramp":
        low, high = at(0.1), at(rng.uniform(0.6, 0.95))
        points = [(low, 0.0), (low, 0.3), (high, seconds / 2), (high, 0.3), (low, seconds / 2)]
    elif kind == "triangle":
        low, high = at(rng.uniform(0.05, 0.3)), at(rng.uniform(0.6, 0.95))
        took = (high - low) / (v * rng.uniform(0.1, 0.3))
        points = [(low, 0.0)] + [(high, took), (low, took)] * max(1, round(seconds / took / 2))
    elif kind == "tiny":
        centre, size = rng.uniform(0.3, 0.6), 0.03
        points = [(at(centre), 0.0)]
        while sum(took for _, took in points) < seconds:
            place = at(centre + rng.uniform(-size, size))
            points += [
                (place, abs(place - points[-1][0]) / (v * rng.uniform(0.02, 0.06))),
                (place, rng.uniform(0.0, 0.3)),
            ]
    else:
        points = [(at(0.1), 0.0)]
        while sum(took for _, took in points) < seconds:
            for share in (rng.uniform(0.4, 0.9), rng.uniform(0.05, 0.2)):
                took = abs(at(share) - points[-1][0]) / (v * rng.uniform(0.05, 0.2))
                points += [(at(share), took), (at(share), rng.uniform(0.2, 1.0))]
    times = np.cumsum([took for _, took in points])
    t = np.arange(int(1000 * min(times[-1], 12.0))) / 1000.0
    path = np.interp(t, times, [place for place, _ in points])
    window = np.hanning(62)[1:-1]
    padded = np.pad(path, len(window), mode="edge")
    return np.convolve(padded, window / window.sum(), "valid")
