"""The regressors: what the motion so far says about the force now, in `COUNT` numbers phi.

| phi | what | why |
|---|---|---|
| 0 to 3 | 1, x - x0, v, a | bias and equation (1) of the paper |
| 4 | tanh(v / 0.1 v_rms) | Coulomb friction |
| 5 to 12 | stop operators z / r at eight radii r, octaves of the range | presliding and hysteresis |
| 13 to 18 | x and friction, each less its mean over 0.1, 1, 10 s | relaxation |
| 19 to 33 | first to third differences of x over 1 to 16 samples | derivatives without a filter's lag |
| 34 to 41 | friction with speed (Stribeck, quadratic) and place, X^2, X^3 | stiffening, tapering walls |

Differences of several spans let least squares choose between noise and lag, where a filter fixes both.

References: Visintin, Differential Models of Hysteresis (1994), stop operator; Armstrong-Helouvry, Dupont and
Canudas de Wit, Automatica 30(7), 1994; Fung, Biomechanics (1993), relaxation.
"""

import math

from forefeel.common.estimation.bank import (
    FIRST_DIFFERENCE,
    FIRST_NONLINEAR,
    FIRST_RELAXATION,
    FIRST_STOP,
    NO_OCTAVE,
    RELAXATIONS_S,
    RING,
    SPANS,
    STOPS,
    Bank,
)
from forefeel.common.jit import Array, kernel

_RELAXATION_STOP = 5
"""The stop whose hysteresis relaxes and meets the nonlinear terms: radius 1/32 to 1/64 of the range."""


@kernel
def fill(bank: Bank) -> None:
    """phi of the newest sample."""
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
    for j in range(len(RELAXATIONS_S)):
        if dt > 0.0:
            share = 1.0 - math.exp(-dt / RELAXATIONS_S[j])
            bank.slow_m[j] += (x - bank.slow_m[j]) * share
            bank.slow_friction[j] += (friction - bank.slow_friction[j]) * share
        phi[FIRST_RELAXATION + j] = x - bank.slow_m[j]
        phi[FIRST_RELAXATION + len(RELAXATIONS_S) + j] = friction - bank.slow_friction[j]


@kernel
def _fill_differences(bank: Bank, phi: Array, n: int) -> None:
    """First, second and third derivative by divided differences over the actual stamps.

    Until three spans fit into the piece the next shorter span stands in, and for its first three samples what
    the last piece ended with: zeros would look like a jerk.
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
