"""The bank of regressors: what the motion so far says about the force now, in `COUNT` numbers phi.

| phi | what | why |
|---|---|---|
| 0 to 3 | 1, x - x0, v, a | bias and equation (1) of the paper |
| 4 | tanh(v / 0.1 v_rms) | Coulomb friction |
| 5 to 12 | stop operators z / r at eight radii r, octaves of the range | presliding and hysteresis |
| 13 to 18 | x and friction, each less its mean over 0.1, 1, 10 s | relaxation |
| 19 to 33 | first to third differences of x over 1 to 16 samples | derivatives without a filter's lag |
| 34 to 41 | friction with speed (Stribeck, quadratic) and place, X^2, X^3 | stiffening, tapering walls |

Differences of several spans let least squares choose between noise and lag, where a filter fixes both. The
stops' radii are powers of two of a metre: when the range doubles, one new stop takes the slot of the
smallest, and all others keep their meaning. They follow the median of three positions, for a laser's glitch
of one sample would leave its mark in every one of them.

References: Visintin, Differential Models of Hysteresis (1994), stop operator; Armstrong-Helouvry, Dupont and
Canudas de Wit, Automatica 30(7), 1994; Fung, Biomechanics (1993), relaxation.
"""

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from common.estimation.jit import kernel
from common.estimation.record import floats, record

Array = NDArray[np.float64]

STOPS = 8
SPANS = (1, 2, 4, 8, 16)
RELAXATIONS_S = (0.1, 1.0, 10.0)

FIRST_STOP = 5
FIRST_RELAXATION = FIRST_STOP + STOPS
FIRST_DIFFERENCE = FIRST_RELAXATION + 2 * len(RELAXATIONS_S)
FIRST_NONLINEAR = FIRST_DIFFERENCE + 3 * len(SPANS)
COUNT = FIRST_NONLINEAR + 8

RING = 8192
"""Samples of motion that wait for their forces: 8 s at 1 kHz."""

GAP_S = 0.1
_NONE = -9999.0
_SPEED_MEMORY_S = 20.0
_RELAXATION_STOP = 5
"""The stop whose hysteresis relaxes and meets the nonlinear terms: radius 1/32 to 1/64 of the range."""

DTYPE = record(
    "count start origin_m low_m high_m octave v a speed2 speed_s period_s median_m rest_m moved_s restart",
    floats("stops_m", STOPS),
    floats("radii_m", STOPS),
    floats("renewed", STOPS),
    floats("slow_m", len(RELAXATIONS_S)),
    floats("slow_friction", len(RELAXATIONS_S)),
    floats("t_s", RING),
    floats("x_m", RING),
    floats("phi", RING, COUNT),
)


class Bank(Protocol):
    """A record of `DTYPE`. What it keeps of a sample stands at the sample's number modulo `RING`.

    count: samples so far. start: number of the first one since a gap. octave: the range of motion is at most
    2^octave m. v, a: smoothed derivatives. rest_m, moved_s: where and when the motion last got away from
    `rest_m` by more than the smallest stop's radius. restart: 1 when the next sample follows a gap. renewed:
    1 for each stop that the last sample gave a new radius. slow_*: the means of the relaxations.
    """

    count: float
    start: float
    origin_m: float
    low_m: float
    high_m: float
    octave: float
    v: float
    a: float
    speed2: float
    speed_s: float
    period_s: float
    median_m: float
    rest_m: float
    moved_s: float
    restart: float
    stops_m: Array
    radii_m: Array
    renewed: Array
    slow_m: Array
    slow_friction: Array
    t_s: Array
    x_m: Array
    phi: Array


def begin(bank: NDArray[np.void]) -> None:
    """Makes a record of zeros one that has seen nothing."""
    bank["octave"] = _NONE
    bank["radii_m"] = 1.0
    bank["t_s"] = -1e18


@kernel
def advance(bank: Bank, t: float, x: float) -> bool:
    """Takes in one sample; False when it is not finite or its stamp does not increase. Sets `renewed`."""
    n = int(bank.count)
    last = (n - 1) % RING
    if not (math.isfinite(t) and math.isfinite(x)) or (n > 0 and t <= bank.t_s[last]):
        return False
    dt = t - bank.t_s[last]
    new_piece = n == 0 or dt > GAP_S or bank.restart > 0.0
    bank.restart = 0.0
    bank.renewed[:] = 0.0
    if n == 0:
        bank.origin_m = bank.low_m = bank.high_m = x
    bank.low_m, bank.high_m = min(bank.low_m, x), max(bank.high_m, x)
    if new_piece:
        _begin_piece(bank, n, t, x)
    else:
        _follow(bank, n, x, x - bank.x_m[last], dt)
    _widen(bank, n, x)
    if abs(x - bank.rest_m) > smallest_radius_m(bank):
        bank.rest_m, bank.moved_s = x, t
    i = n % RING
    bank.t_s[i], bank.x_m[i] = t, x
    bank.count = n + 1
    _fill(bank, n, 0.0 if new_piece else dt)
    return True


@kernel
def smallest_radius_m(bank: Bank) -> float:
    """Radius of the smallest stop, about a 256th of the range of motion; what is less counts as rest."""
    octave = bank.octave
    return 0.0 if octave == _NONE else 2.0 ** (octave - STOPS)


@kernel
def _begin_piece(bank: Bank, n: int, t: float, x: float) -> None:
    bank.start, bank.v, bank.a = n, 0.0, 0.0
    bank.median_m = bank.rest_m = x
    bank.moved_s = t
    bank.stops_m[:] = 0.0
    bank.slow_m[:] = x
    bank.slow_friction[:] = 0.0


@kernel
def _follow(bank: Bank, n: int, x: float, dx: float, dt: float) -> None:
    """Moves stops, speeds and means on by one sample."""
    bank.period_s = dt if bank.period_s == 0.0 else bank.period_s + 0.02 * (dt - bank.period_s)
    median = x
    if n - bank.start >= 2:
        one, two = bank.x_m[(n - 1) % RING], bank.x_m[(n - 2) % RING]
        median = max(min(x, one), min(max(x, one), two))
    moved, bank.median_m = median - bank.median_m, median
    for j in range(STOPS):
        r = bank.radii_m[j]
        bank.stops_m[j] = min(r, max(-r, bank.stops_m[j] + moved))
    share = 1.0 - math.exp(-dt / max(2.0 * bank.period_s, 0.004))
    before = bank.v
    bank.v = before + (dx / dt - before) * share
    bank.a += ((bank.v - before) / dt - bank.a) * share
    bank.speed2 += bank.v * bank.v * dt
    bank.speed_s += dt
    if bank.speed_s > _SPEED_MEMORY_S:
        bank.speed2 *= _SPEED_MEMORY_S / bank.speed_s
        bank.speed_s = _SPEED_MEMORY_S


@kernel
def _widen(bank: Bank, n: int, x: float) -> None:
    """Gives the smallest stops the next octaves when the range has outgrown the largest."""
    width = bank.high_m - bank.low_m
    if width <= 0.0 or (bank.octave != _NONE and width <= 2.0**bank.octave):
        return
    octave = math.ceil(math.log2(width))
    first = octave - STOPS + 1
    if bank.octave != _NONE:
        first = max(first, int(bank.octave) + 1)
    start_m = x
    if 0 < n - bank.start < RING:
        start_m = bank.x_m[int(bank.start) % RING]
    for j in range(first, octave + 1):
        slot = j % STOPS
        r = 2.0 ** (j - 1)
        bank.radii_m[slot] = r
        bank.stops_m[slot] = min(r, max(-r, x - start_m))
        bank.phi[:, FIRST_STOP + slot] = 0.0
        bank.renewed[slot] = 1.0
    bank.octave = octave


@kernel
def _fill(bank: Bank, n: int, dt: float) -> None:
    """phi of sample n; dt 0 at the first of a piece."""
    i = n % RING
    x, phi = bank.x_m[i], bank.phi[i]
    v_rms = math.sqrt(bank.speed2 / bank.speed_s) if bank.speed_s > 0.0 else 0.0
    sign = math.tanh(bank.v / (0.1 * v_rms)) if v_rms > 0.0 else 0.0
    phi[0], phi[1], phi[2], phi[3], phi[4] = 1.0, x - bank.origin_m, bank.v, bank.a, sign
    for j in range(STOPS):
        phi[FIRST_STOP + j] = bank.stops_m[j] / bank.radii_m[j]
    friction = 0.0
    if bank.octave != _NONE:
        friction = phi[FIRST_STOP + int(bank.octave - _RELAXATION_STOP) % STOPS]
    _fill_relaxations(bank, phi, x, friction, dt)
    _fill_differences(bank, phi, n)
    speed = min(abs(bank.v) / v_rms, 10.0) if v_rms > 0.0 else 0.0
    _fill_nonlinear(phi, x - bank.origin_m, friction, sign, speed)


@kernel
def _fill_relaxations(bank: Bank, phi: Array, x: float, friction: float, dt: float) -> None:
    for j in range(len(RELAXATIONS_S)):
        if dt > 0.0:
            share = 1.0 - math.exp(-dt / RELAXATIONS_S[j])
            bank.slow_m[j] += (x - bank.slow_m[j]) * share
            bank.slow_friction[j] += (friction - bank.slow_friction[j]) * share
        phi[FIRST_RELAXATION + j] = x - bank.slow_m[j]
        phi[FIRST_RELAXATION + len(RELAXATIONS_S) + j] = friction - bank.slow_friction[j]


@kernel
def _fill_differences(bank: Bank, phi: Array, n: int) -> None:
    """First, second and third derivative by divided differences over the actual stamps; 0 near a gap."""
    t, x = bank.t_s, bank.x_m
    p0 = n % RING
    for j in range(len(SPANS)):
        span, o = SPANS[j], FIRST_DIFFERENCE + 3 * j
        if n - 3 * span < bank.start:
            phi[o], phi[o + 1], phi[o + 2] = 0.0, 0.0, 0.0
            continue
        p1, p2, p3 = (n - span) % RING, (n - 2 * span) % RING, (n - 3 * span) % RING
        first0 = (x[p0] - x[p1]) / (t[p0] - t[p1])
        first1 = (x[p1] - x[p2]) / (t[p1] - t[p2])
        first2 = (x[p2] - x[p3]) / (t[p2] - t[p3])
        second0 = 2.0 * (first0 - first1) / (t[p0] - t[p2])
        second1 = 2.0 * (first1 - first2) / (t[p1] - t[p3])
        phi[o], phi[o + 1] = first0, second0
        phi[o + 2] = 3.0 * (second0 - second1) / (t[p0] - t[p3])


@kernel
def _fill_nonlinear(phi: Array, x: float, friction: float, sign: float, speed: float) -> None:
    o = FIRST_NONLINEAR
    phi[o], phi[o + 1] = friction * math.sqrt(speed), friction * math.exp(-speed)
    phi[o + 2] = sign * speed * speed
    phi[o + 3], phi[o + 4] = x * x, x * x * x
    phi[o + 5], phi[o + 6], phi[o + 7] = friction * x, friction * x * x, friction * x * x * x


@kernel
def find(bank: Bank, stamp: float) -> int:
    """Number of the sample with that stamp, to a microsecond; -1 when the ring does not hold it."""
    n = int(bank.count)
    low, high = max(0, n - RING), n - 1
    if high < 0:
        return -1
    while low < high:
        middle = (low + high + 1) // 2
        if bank.t_s[middle % RING] <= stamp + 1e-7:
            low = middle
        else:
            high = middle - 1
    return low if abs(bank.t_s[low % RING] - stamp) < 1e-6 else -1
