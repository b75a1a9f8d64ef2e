"""Kinds of motion by what they can tell, and motions that tell rivals apart."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from forefeel.common.causes.catalogue import cause_class
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

_SEPARATING = {
    "angles": NextMotion("strokes, slow and fast, over as much of a turn as can be had", 40.0),
    "speeds": NextMotion("strokes from well below to well above the slowest so far, 0.1 to 10 mm/s", 60.0),
    "amplitudes": NextMotion(
        "strokes of several amplitudes at one speed, some below the width in question", 40.0
    ),
    "frequencies": NextMotion("sines of one amplitude at three or more frequencies, 0.5 to 15 Hz", 30.0),
    "no load": NextMotion("a step, a hold of 30 s, then back to no load for 30 s", 60.0),
    "rates": NextMotion("the same stroke at three speeds", 30.0),
    "depths": NextMotion("the same strokes, slow and fast, to several depths", 40.0),
    "stillness": NextMotion("a hold of 20 s at one position", 20.0),
    "repetition": NextMotion("the same positions again, later", 30.0),
}
"""Motions that tell causes apart, by the words of their `told_by`."""
RIVALS_AT_ONE_SPEED = PreslidingHysteresis.name, StressRelaxation.name, SensorLag.name
"""Of strokes of one speed: the time since a reversal and the way since then are one column there."""
RIVALS_AT_CONSTANT_SPEED = CoulombFriction.name, SensorDrift.name, StressRelaxation.name, Stiffening.name
MOTION_AFTER_CONSTANT_SPEED = NextMotion(
    "the same way ten times slower or faster, with a hold of 30 s, and back; of what tears another specimen",
    60.0,
)
GENERAL_MOTION = NextMotion(
    "strokes of several amplitudes and speeds in both directions, with holds; or a multi-sine, 0.2 to 15 Hz",
    60.0,
)
NOISE_TELLING_MOTION = NextMotion(
    "the same strokes sampled at more than 200 Hz, and 10 s at rest: they tell how large the noise is", 30.0
)
_RHYTHM = NextMotion("10 s at rest, then 10 s at constant speed", 20.0)
_FOLLOWED = {
    "position": NextMotion("slow strokes in and out", 40.0),
    "rhythm": _RHYTHM,
    "time": _RHYTHM,
    "past motion": _SEPARATING["no load"],
    "speed": _SEPARATING["rates"],
    "direction": _SEPARATING["amplitudes"],
    "way": _SEPARATING["amplitudes"],
    "acceleration": _SEPARATING["frequencies"],
    "size of the force": _SEPARATING["depths"],
}
"""Motions that show more of what is left, by how the name of the variable begins that it follows."""


def following_motion(follows: Sequence[Follows]) -> NextMotion:
    """Motion for what is left, by the first variable that it follows; a general one where it follows none."""
    if not follows:
        return GENERAL_MOTION
    first = follows[0]
    motions = (motion for name, motion in _FOLLOWED.items() if first.variable.startswith(name))
    motion = next(motions, GENERAL_MOTION)  # of another column
    return replace(motion, low_m=first.low_m, high_m=first.high_m)


def separating_motion(names: set[str]) -> NextMotion:
    """Motion that tells most of these causes apart. Where none tells two of them: a multi-sine and a hold if
    one relaxes or depends on frequency (`bends`), else general strokes.
    """
    count = Counter(motion for name in names for motion in cause_class(name).told_by)
    best = max(_SEPARATING, key=lambda motion: count[motion])
    if count[best] >= 2:
        return _SEPARATING[best]
    if any(cause_class(name).bends for name in names) or StressRelaxation.name in names:
        return NextMotion("a multi-sine of 0.2 to 15 Hz, and a hold of 30 s", 60.0)
    return GENERAL_MOTION


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
