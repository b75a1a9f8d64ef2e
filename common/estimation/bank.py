"""Ring of the last `RING` samples of the motion with their regressors: `COUNT` numbers phi each, from which
the experts predict the force.

| phi | what | why |
|---|---|---|
| 0 to 3 | 1, x - x0, v, a | bias and equation (1) of the paper |
| 4 | tanh(v / 0.1 v_rms) | Coulomb friction |
| 5 to 12 | stop operators z / r at eight radii r, octaves of the range | presliding and hysteresis |
| 13 to 18 | x and friction, each less its mean over 0.1, 1, 10 s | relaxation |
| 19 to 33 | first to third differences of x over 1 to 16 samples | derivatives without a filter's lag |
| 34 to 41 | friction with speed (Stribeck, quadratic) and place, X^2, X^3 | stiffening, tapering walls |

Differences of several spans let least squares choose between noise and lag, where a filter fixes both.

The stops' radii are powers of two of a metre: when the range doubles, one new stop takes the slot of the
smallest, and the others keep their meaning. They, the range and the fastest speed follow the median of three
positions: a laser's glitch of one sample would change all of them.

A position over ten times as far away as the fastest speed leads is replaced by the last one, until the next
position confirms it. If it is farther away than the range, a new piece begins.

References: Visintin, Differential Models of Hysteresis (1994), stop operator; Armstrong-Helouvry, Dupont and
Canudas de Wit, Automatica 30(7), 1994; Fung, Biomechanics (1993), relaxation.
"""

import math
from typing import Annotated, Protocol

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation.state_filter import GAP_S
from forefeel.common.jit import Array, kernel

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

NO_OCTAVE = -9999.0
_SPEED_MEMORY_S = 20.0
_FASTEST_MEMORY_S = 60.0
_REACH = 10.0
_REST_S = 2.0
_RELAXATION_STOP = 5
"""The stop whose hysteresis relaxes and meets the nonlinear terms: radius 1/32 to 1/64 of the range."""


class Bank(Protocol):
    """Recent motion and its regressors; the values of a sample are at its number modulo `RING`.

    count: samples so far. start: number of the first one since a gap. origin_m: x0, NaN before a median of
    three is known. octave: the range of motion is at most 2^octave m. v, a: smoothed derivatives.
    fastest_m_s: fading. began_m: where the piece began. suspect_m: the last position if it was replaced,
    else NaN. rest_m, moved_s: where and when the motion last got away from `rest_m` by more than the smallest
    stop's radius. restart: 1 if the next sample follows a gap. renewed: 1 for each stop to which the last
    sample gave a new radius. slow_*: the means of the relaxations.
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
    fastest_m_s: float
    median_m: float
    began_m: float
    suspect_m: float
    rest_m: float
    moved_s: float
    restart: float
    stops_m: Annotated[Array, STOPS]
    radii_m: Annotated[Array, STOPS]
    renewed: Annotated[Array, STOPS]
    slow_m: Annotated[Array, len(RELAXATIONS_S)]
    slow_friction: Annotated[Array, len(RELAXATIONS_S)]
    t_s: Annotated[Array, RING]
    x_m: Annotated[Array, RING]
    phi: Annotated[Array, RING, COUNT]


def begin(bank: NDArray[np.void]) -> None:
    """Initialises a record of zeros as one without samples."""
    bank["octave"] = NO_OCTAVE
    bank["radii_m"] = 1.0
    bank["t_s"] = -1e18
    bank["origin_m"] = bank["suspect_m"] = np.nan


@kernel
def advance(bank: Bank, t: float, x: float) -> bool:
    """Adds the position x in m at stamp t and updates the states; its phi is left to `fill`.

    Returns False, and changes nothing, if not finite or the stamp does not increase. A position too far off
    is replaced by the last one until the next confirms it; after a gap or `restart` a new piece begins.
    """
    n = int(bank.count)
    last = (n - 1) % RING
    if not (math.isfinite(t) and math.isfinite(x)) or (n > 0 and t <= bank.t_s[last]):
        return False
    dt = t - bank.t_s[last]
    if n > 0 and dt <= GAP_S and bank.restart == 0.0:
        x = _accepted(bank, n, x, dt)
    new_piece = n == 0 or dt > GAP_S or bank.restart > 0.0
    bank.restart = 0.0
    bank.renewed[:] = 0.0
    if new_piece:
        _begin_piece(bank, n, t, x)
    else:
        _follow(bank, n, x, x - bank.x_m[last], dt)
    if math.isnan(bank.origin_m) and n - bank.start == 2:
        _begin_range(bank, n, t, x)
    _widen(bank)
    # the radius of the smallest stop, about a 256th of the range of motion; what is less counts as rest
    smallest_m = 0.0 if bank.octave == NO_OCTAVE else 2.0 ** (bank.octave - STOPS)
    if abs(x - bank.rest_m) > smallest_m:
        bank.rest_m, bank.moved_s = x, t
    i = n % RING
    bank.t_s[i], bank.x_m[i] = t, x
    bank.count = n + 1
    return True


@kernel
def _accepted(bank: Bank, n: int, x: float, dt: float) -> float:
    """Returns x, or the last position if x is over ten times as far from it as the fastest speed leads in dt.

    An x refused is kept as `suspect_m`. A next one that is nearer to it than to the last position is
    accepted, raises `fastest_m_s`, and sets `restart` for a new piece if it is beyond the range or the piece
    has just begun. Before the origin is known all are accepted.
    """
    before = float(bank.x_m[(n - 1) % RING])
    jump, suspect, least_s = abs(x - before), bank.suspect_m, max(dt, bank.period_s)
    bank.suspect_m = np.nan
    if math.isnan(bank.origin_m) or jump <= _REACH * bank.fastest_m_s * least_s:
        return x
    if abs(x - suspect) < jump:
        bank.fastest_m_s = max(bank.fastest_m_s, abs(x - suspect) / least_s)
        far = jump > bank.high_m - bank.low_m or n - bank.start < 3
        bank.restart = 1.0 if far else 0.0
        return x
    bank.suspect_m = x
    return before


@kernel
def at_rest(bank: Bank, n: int) -> bool:
    """True if the motion has rested for over 2 s up to sample n, so that it teaches nothing."""
    return bank.t_s[n % RING] - bank.moved_s > _REST_S and bank.octave != NO_OCTAVE


@kernel
def _begin_piece(bank: Bank, n: int, t: float, x: float) -> None:
    """Starts a piece of motion at sample n and position x: median, place of rest and means become x.

    Stops and the means of friction become 0. Origin, range, speed and acceleration stay.
    """
    bank.start = n
    bank.began_m = bank.median_m = bank.rest_m = x
    bank.moved_s = t
    bank.stops_m[:] = 0.0
    bank.slow_m[:] = x
    bank.slow_friction[:] = 0.0


@kernel
def _begin_range(bank: Bank, n: int, t: float, x: float) -> None:
    """Sets origin, range and fastest speed from the first three samples, of which n is the last.

    Origin and range, of zero width, are their median, from which a piece begins anew; the mean speed
    restarts.
    """
    one, two = abs(x - bank.median_m), abs(bank.x_m[(n - 1) % RING] - bank.median_m)
    zero = abs(bank.x_m[(n - 2) % RING] - bank.median_m)
    bank.fastest_m_s = (one + two + zero - max(one, two, zero)) / bank.period_s
    bank.origin_m = bank.low_m = bank.high_m = bank.median_m
    bank.speed2 = bank.speed_s = 0.0
    _begin_piece(bank, n, t, bank.median_m)


@kernel
def _follow(bank: Bank, n: int, x: float, dx: float, dt: float) -> None:
    """Updates period, range, speeds, v, a and stops by sample n, which is `dx` and `dt` after the last one.

    Range, stops and fastest speed follow the median of the last three positions. Means of relaxations and the
    ring are left to others.
    """
    bank.period_s = dt if bank.period_s == 0.0 else bank.period_s + 0.02 * (dt - bank.period_s)
    median = x
    if n - bank.start >= 2:
        one, two = bank.x_m[(n - 1) % RING], bank.x_m[(n - 2) % RING]
        median = max(min(x, one), min(max(x, one), two))
        bank.low_m, bank.high_m = min(bank.low_m, median), max(bank.high_m, median)
    moved, bank.median_m = median - bank.median_m, median
    if n - bank.start >= 3:
        fading = bank.fastest_m_s * math.exp(-dt / _FASTEST_MEMORY_S)
        bank.fastest_m_s = max(fading, abs(moved) / max(dt, bank.period_s))
    for j in range(STOPS):
        r = bank.radii_m[j]
        bank.stops_m[j] = min(r, max(-r, bank.stops_m[j] + moved))
    share = 1.0 - math.exp(-dt / max(2.0 * bank.period_s, 0.004))
    before = bank.v if n - bank.start > 1 else dx / dt
    bank.v = before + (dx / dt - before) * share
    bank.a += ((bank.v - before) / dt - bank.a) * share
    bank.speed2 += bank.v * bank.v * dt
    bank.speed_s += dt
    if bank.speed_s > _SPEED_MEMORY_S:
        bank.speed2 *= _SPEED_MEMORY_S / bank.speed_s
        bank.speed_s = _SPEED_MEMORY_S


@kernel
def _widen(bank: Bank) -> None:
    """Gives the smallest stops the radii of the next octaves if the range of motion exceeds 2^octave m.

    Else does nothing. For each such stop it clears the column of phi in the whole ring and sets `renewed`;
    then it sets `octave`.
    """
    width = bank.high_m - bank.low_m
    if width <= 0.0 or (bank.octave != NO_OCTAVE and width <= 2.0**bank.octave):
        return
    octave = math.ceil(math.log2(width))
    first = octave - STOPS + 1
    if bank.octave != NO_OCTAVE:
        first = max(first, int(bank.octave) + 1)
    for j in range(first, octave + 1):
        slot = j % STOPS
        r = 2.0 ** (j - 1)
        bank.radii_m[slot] = r
        bank.stops_m[slot] = min(r, max(-r, bank.median_m - bank.began_m))
        bank.phi[:, FIRST_STOP + slot] = 0.0
        bank.renewed[slot] = 1.0
    bank.octave = octave


@kernel
def fill(bank: Bank) -> None:
    """Computes the regressors phi of the newest sample, in its place of the ring; all 0 before x0 is known.

    Once it is, also advances the means of the relaxations by the time since the last sample of the piece.
    """
    n = int(bank.count) - 1
    i = n % RING
    dt = bank.t_s[i] - bank.t_s[(n - 1) % RING] if n > bank.start else 0.0
    x, phi = bank.x_m[i], bank.phi[i]
    if math.isnan(bank.origin_m):
        phi[:] = 0.0
        return
    v_rms = math.sqrt(bank.speed2 / bank.speed_s) if bank.speed_s > 0.0 else 0.0
    sign = math.tanh(bank.v / (0.1 * v_rms)) if v_rms > 0.0 else 0.0
    phi[0], phi[1], phi[2], phi[3], phi[4] = 1.0, x - bank.origin_m, bank.v, bank.a, sign
    for j in range(STOPS):
        phi[FIRST_STOP + j] = bank.stops_m[j] / bank.radii_m[j]
    friction = 0.0
    if bank.octave != NO_OCTAVE:
        friction = phi[FIRST_STOP + int(bank.octave - _RELAXATION_STOP) % STOPS]
    _fill_relaxations(bank, phi, x, friction, dt)
    _fill_differences(bank, phi, n)
    speed = min(abs(bank.v) / v_rms, 10.0) if v_rms > 0.0 else 0.0
    _fill_nonlinear(phi, x - bank.origin_m, friction, sign, speed)


@kernel
def _fill_relaxations(bank: Bank, phi: Array, x: float, friction: float, dt: float) -> None:
    """Advances the means of x and friction over 0.1, 1, 10 s by dt; sets phi to the differences from them.

    With a dt of 0, at the start of a piece, the means stay.
    """
    for j in range(len(RELAXATIONS_S)):
        if dt > 0.0:
            share = 1.0 - math.exp(-dt / RELAXATIONS_S[j])
            bank.slow_m[j] += (x - bank.slow_m[j]) * share
            bank.slow_friction[j] += (friction - bank.slow_friction[j]) * share
        phi[FIRST_RELAXATION + j] = x - bank.slow_m[j]
        phi[FIRST_RELAXATION + len(RELAXATIONS_S) + j] = friction - bank.slow_friction[j]


@kernel
def _fill_differences(bank: Bank, phi: Array, n: int) -> None:
    """Sets first to third derivative of x in phi by divided differences over 1 to 16 samples, see `SPANS`.

    Until three spans fit into the piece, the next shorter span replaces them, and for its first three samples
    the values of the sample before: zeros would look like a jerk.
    """
    t, x = bank.t_s, bank.x_m
    p0 = n % RING
    for j in range(len(SPANS)):
        span, o = SPANS[j], FIRST_DIFFERENCE + 3 * j
        if n - 3 * span < bank.start:
            shorter = j > 0 and n - 3 >= bank.start
            phi[o : o + 3] = phi[o - 3 : o] if shorter else bank.phi[(n - 1) % RING, o : o + 3]
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
    """Number of the sample with that stamp, to a microsecond; -1 if it is not in the ring."""
    n = last_until(bank.t_s, int(bank.count), stamp)
    return n if abs(bank.t_s[n % RING] - stamp) < 1e-6 else -1


@kernel
def last_until(stamps_s: Array, count: int, stamp: float) -> int:
    """Returns the number of the last sample in a ring that is no later than `stamp`, else of the oldest.

    `stamps_s`: in s and rising, a sample at its number modulo `RING`; `count`: samples so far; 0 returns 0.
    """
    low, high = max(0, count - RING), count - 1
    while low < high:
        middle = (low + high + 1) // 2
        if stamps_s[middle % RING] <= stamp + 1e-7:
            low = middle
        else:
            high = middle - 1
    return low
