"""Motions to simulate: a hand, sines, or a recorded one; each begins at rest as far as it can."""

from collections.abc import Sequence
from math import pi
from typing import NamedTuple, Protocol

import numpy as np

from forefeel.common.estimation.state_filter import StateFilter
from forefeel.common.recording.recording import Array, Recording
from forefeel.devices.simulated.settings import OperatorSettings

SMOOTHING_HZ = 40.0  # cutoff of the low-pass of a recorded motion: gives the acceleration that no encoder has

_FREQUENCIES_HZ = 0.23, 0.61, 1.37, 2.9  # of the multi-sine; chosen: none is a multiple of another
Course = tuple[Array, Array, Array]  # position m, velocity m/s and acceleration m/s^2, each shape (n,)


class MotionSource(Protocol):
    """Something that moves, asked in the order of time."""

    def at(self, t: Array) -> Course:
        """The motion at the stamps t in s, shape (n,)."""
        ...


class MotionPiece(NamedTuple):
    """A motion without gaps, and the stamps in s at which it is recorded."""

    motion: MotionSource
    stamps_s: Array


class Sines:
    """Sines of equal amplitude around the middle of the depth; a single one begins at rest at the start."""

    def __init__(
        self, start_m: float, depth_m: float, frequencies_hz: Sequence[float], phases: Sequence[float]
    ) -> None:
        self._centre_m = start_m + 0.5 * depth_m
        self._amplitude_m = 0.5 * depth_m / len(frequencies_hz)
        self._sines = list(zip(frequencies_hz, phases, strict=True))

    def at(self, t: Array) -> Course:
        """Position m, velocity m/s and acceleration m/s^2 at the times t in s, each shape (n,)."""
        x, v, a = np.full_like(t, self._centre_m), np.zeros_like(t), np.zeros_like(t)
        for frequency_hz, phase in self._sines:
            w = 2.0 * pi * frequency_hz
            s, c = self._amplitude_m * np.sin(w * t + phase), self._amplitude_m * np.cos(w * t + phase)
            x, v, a = x + s, v + w * c, a - w * w * s
        return x, v, a


def sine(start_m: float, depth_m: float, frequency_hz: float) -> Sines:
    """A sine from the start to the full depth and back."""
    return Sines(start_m, depth_m, (frequency_hz,), (-0.5 * pi,))


def multisine(start_m: float, depth_m: float, random: np.random.Generator) -> Sines:
    """Sines of four frequencies with phases from `random`."""
    phases = random.uniform(0.0, 2.0 * pi, len(_FREQUENCIES_HZ)).tolist()
    return Sines(start_m, depth_m, _FREQUENCIES_HZ, phases)


class Hand:
    """The operator of the loopback without its arm: minimum-jerk strokes in and out, dwells, tremor.

    Depths, paces and dwells vary by more than the operator's, so that speed and depth are not one.
    Flash and Hogan 1985; tremor of 6 to 12 Hz, Riviere et al. 1998.
    """

    def __init__(
        self, start_m: float, depth_m: float, duration_s: float, random: np.random.Generator
    ) -> None:
        operator = OperatorSettings()
        begins, moves, froms, tos = [0.0], [1.0], [start_m], [start_m]
        while begins[-1] < duration_s:
            inward = len(begins) % 2 == 1
            pace_s = (operator.insert_s if inward else operator.withdraw_s) * random.uniform(0.5, 1.6)
            share = random.uniform(0.5, 0.95) if inward else random.uniform(0.02, 0.35)
            froms.append(tos[-1])
            tos.append(start_m + share * depth_m)
            dwell_s = operator.dwell_s * random.uniform(0.3, 1.5)
            begins.append(begins[-1] + (moves[-1] + dwell_s if len(begins) > 1 else 0.0))
            moves.append(pace_s)
        self._begins, self._moves = np.array(begins), np.array(moves)
        self._froms, self._tos = np.array(froms), np.array(tos)
        tremor_m = min(operator.tremor_m, 0.02 * depth_m)
        self._tremor = [
            (tremor_m / 3.0, 2.0 * pi * random.uniform(6.0, 12.0), random.uniform(0.0, 2.0 * pi))
            for _ in range(3)
        ]

    def at(self, t: Array) -> Course:
        """Position m, velocity m/s and acceleration m/s^2 at the times t >= 0 in s, each shape (n,)."""
        stroke = np.searchsorted(self._begins, t, side="right") - 1
        length, duration = self._tos[stroke] - self._froms[stroke], self._moves[stroke]
        s = np.clip((t - self._begins[stroke]) / duration, 0.0, 1.0)
        x = self._froms[stroke] + length * s**3 * (10.0 + s * (6.0 * s - 15.0))
        v = length / duration * 30.0 * (s * (1.0 - s)) ** 2
        a = length / duration**2 * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s)
        for amplitude_m, w, phase in self._tremor:
            wave = amplitude_m * np.sin(w * t + phase)
            x, v, a = x + wave, v + w * amplitude_m * np.cos(w * t + phase), a - w * w * wave
        return x, v, a


class FollowedRecording:
    """The position of a piece of recording without gaps, through a low-pass that gives the derivatives.

    What it moves is what the low-pass gives: some 8 ms late and without the encoder's noise.
    """

    def __init__(self, recording: Recording, part: slice) -> None:
        self._time_s, self._position_m = recording.time_s[part], recording.position_m[part]
        self._filter = StateFilter(SMOOTHING_HZ)
        self._before_s = float(self._time_s[0])

    def at(self, t: Array) -> Course:
        """Position m, velocity m/s and acceleration m/s^2 at the times t in s: the recorded position, linear
        between its samples, through the low-pass. Keeps the filter's state: the next call has to begin later.
        """
        recorded_m = np.interp(t, self._time_s, self._position_m)
        steps = np.diff(t, prepend=self._before_s)
        self._before_s = float(t[-1])
        step = self._filter.step
        course = np.array([step(x, dt) for x, dt in zip(recorded_m.tolist(), steps.tolist(), strict=True)])
        return course[:, 0], course[:, 1], course[:, 2]
