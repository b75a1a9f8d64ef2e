"""Kinds of motion by what they can tell, and the motion to record next."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from forefeel.common.causes.friction import CoulombFriction, PreslidingHysteresis
from forefeel.common.causes.sensor import SensorDrift, SensorLag
from forefeel.common.causes.wall import Stiffening, StressRelaxation
from forefeel.common.error_size import Floats
from forefeel.diagnosis.signals import SignalPiece, Signals
from forefeel.diagnosis.verdict import Follows, NextMotion

MotionKind = Literal["rich", "one_speed", "single_frequency", "constant_speed"]

_LINE_SHARE = 0.985
_ALIKE = 1.2  # ratio of frequencies and of sizes within which two lines are one
_STEADY = 0.06
_NOISE = 1.2  # times an estimate of it
_RINGING = 0.2  # of the speed: 0.09 of a jump (Gibbs), which is twice the speed where a stroke turns

RIVALS_AT_ONE_SPEED = PreslidingHysteresis.name, StressRelaxation.name, SensorLag.name
"""Of strokes of one speed: the time since a reversal and the way since then are one column there."""
RIVALS_AT_CONSTANT_SPEED = CoulombFriction.name, SensorDrift.name, StressRelaxation.name, Stiffening.name
EXCITATION = NextMotion(None, 20.0)
MOTION_AFTER_CONSTANT_SPEED = NextMotion(None, 60.0)
"""At a pace that leaves room for strokes ten times slower, and holds."""
NOISE_TELLING_MOTION = NextMotion(
    "the same strokes sampled at more than 200 Hz, and 10 s at rest: they tell how large the noise is", 30.0
)


def following_motion(follows: Sequence[Follows]) -> NextMotion:
    """Motion to record next, at the place of the first variable that the residual follows, if any."""
    return replace(EXCITATION, low_m=follows[0].low_m, high_m=follows[0].high_m) if follows else EXCITATION


def motion_kind(signals: Signals) -> MotionKind:
    """Kind of motion, the first that holds, edges of pieces left out: `constant_speed` (or a straight line),
    `one_speed` (but for its direction), `single_frequency` (one line in the speed's spectrum), `rich`.
    """
    inside = [
        signals.fine_v[fine][_core(grid, grid.fine / grid.span_s)]
        for grid, fine in zip(signals.pieces, signals.piecewise(), strict=True)
    ]
    v = np.concatenate(inside)
    if _steady(v, _STEADY) or _straight(signals):
        return "constant_speed"
    if _steady(np.abs(v), _RINGING):
        return "one_speed"
    longest = max(map(len, inside))
    return "single_frequency" if _one_line([v for v in inside if 2 * len(v) > longest]) else "rich"


def _steady(v: Floats, within: float) -> bool:
    usual = float(np.median(v))
    return float(np.mean(np.abs(v - usual) < within * abs(usual))) > 0.9


def _straight(signals: Signals) -> bool:
    """True if the longest piece leaves a straight line by less than 1 % of its range and its noise, rms."""
    longest = max(signals.pieces, key=lambda piece: piece.samples)
    x = signals.even_m[_core(longest, signals.even_hz)]
    n = np.arange(len(x))
    off = x - np.polyval(np.polyfit(n, x, 1), n)
    noise_m = np.std(np.diff(x, 2)) / np.sqrt(6.0)
    return bool(np.std(off) < np.hypot(_NOISE * noise_m, 0.01 * np.ptp(x)))


def _core(piece: SignalPiece, rate_hz: float) -> slice:
    end_s = piece.samples * piece.period_s - piece.edge_s
    return slice(int(piece.edge_s * rate_hz), int(end_s * rate_hz))


def _one_line(speeds: Sequence[Floats]) -> bool:
    """True if all pieces are one and the same line of the spectrum, at one amplitude."""
    shares, places = zip(*map(_line, speeds), strict=True)
    sizes = [float(np.std(v)) for v in speeds]
    alike = max(places) < _ALIKE * min(places) and max(sizes) < _ALIKE * min(sizes)
    return min(shares) > _LINE_SHARE and alike


def _line(v: Floats) -> tuple[float, float]:
    """Share of the speed's power in its strongest line (Blackman window), and its cycles per sample."""
    power = np.abs(np.fft.rfft((v - np.mean(v)) * np.blackman(len(v)))) ** 2
    top = int(np.argmax(power))
    return float(power[max(top - 4, 0) : top + 5].sum() / max(power.sum(), 1e-300)), top / len(v)


def turns(x: Floats, least: float = 0.1) -> int:
    """Number of reversals of a position by more than that share of its range."""
    return max(len(turning_points(x.tolist(), least * float(np.ptp(x)) if len(x) else 0.0)) - 1, 0)


def turning_points(x: list[float], least: float) -> list[tuple[int, float]]:
    """(index of the extreme, 1.0 or -1.0: direction from there on) of the first motion and of each reversal
    after it that goes farther than `least`; empty where nothing does.
    """
    turns: list[tuple[int, float]] = []
    low = high = 0
    for i, now in enumerate(x):
        way = turns[-1][1] if turns else 0.0
        high, low = (i if now > x[high] else high), (i if now < x[low] else low)
        if way >= 0.0 and x[high] - now > least:
            turns.append((high, -1.0))
            low = i
        elif way <= 0.0 and now - x[low] > least:
            turns.append((low, 1.0))
            high = i
    return turns
