"""What is watched all the time: memory of each process, motion of the stage."""

from dataclasses import dataclass, field

import numpy as np

from forefeel.common.bus import observed
from forefeel.common.messages import ForceSample
from forefeel.common.topics import FORCE
from tests.live_cell import AXIS, CELL

_WARM_S = 270.0  # a recorder's Zenoh session takes 19 MB in its first 260 s, and no more in the next 300 s
_LEAST_S = 30.0
_BLOCK_S = 5.0
_RAMP_NS = 150_000_000
_STILL_M = 5e-6
_UNHEARD = 100  # of the forces in a row: in so many the stage may have been engaged and stopped again


@dataclass(slots=True)
class Life:
    """Memory of one process from its start to its end: (seconds of life, MB).

    `warm_s`: from then on it has lived through every kind of fault, and its bounded buffers have been full.
    """

    name: str
    warm_s: float = float("inf")
    samples: list[tuple[float, float]] = field(default_factory=list)

    def growth(self) -> tuple[float, float, float] | None:
        """(MB at the end, share, s) after the warm-up; None where it lived too shortly.

        The share is what the median step of 5 s makes in all; a leak adds to it, one burst does not.
        """
        warm = np.array([sample for sample in self.samples if sample[0] > max(_WARM_S, self.warm_s)])
        if len(warm) < 10 or warm[-1, 0] - warm[0, 0] < _LEAST_S:
            return None
        span_s = float(warm[-1, 0] - warm[0, 0])
        edges = np.arange(warm[0, 0], warm[-1, 0], _BLOCK_S)
        steps_mb = np.diff(np.interp(edges, warm[:, 0], warm[:, 1]))
        share = float(np.median(steps_mb)) / _BLOCK_S * span_s / float(warm[0, 1])
        return float(warm[-1, 1]), share, span_s


class Motion:
    """Where the stage goes while no command is followed: nowhere, once it has come to rest."""

    def __init__(self) -> None:
        self._sequence = self.resting = 0
        self._since_ns: int | None = None
        self._rest_m: float | None = None
        self.moved: list[str] = []

    def heard(self, payload: bytes) -> None:
        for sample, _ in observed(FORCE, payload, 0):
            self._heard(sample)

    def _heard(self, sample: ForceSample) -> None:
        missed = sample.sequence - self._sequence - 1
        if not 0 <= missed < _UNHEARD or sample.answers_sequence is not None:
            self._since_ns = self._rest_m = None  # another process, or it follows, or may have followed
        self._sequence = sample.sequence
        if sample.answers_sequence is not None:
            return
        if self._since_ns is None:
            self._since_ns = sample.stamp_ns
        if sample.stamp_ns - self._since_ns < _RAMP_NS:
            return
        self.resting += 1
        self._rest_m = sample.position_m if self._rest_m is None else self._rest_m
        off_m = abs(sample.position_m - self._rest_m)
        if off_m > _STILL_M and len(self.moved) < 100:
            self.moved.append(f"{off_m * 1e6:.0f} um at {sample.stamp_ns / 1e9:.3f} s")


FORCE_KEY = FORCE.key(CELL, AXIS)
