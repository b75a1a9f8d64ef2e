"""The position from the force: the linear part exact, smooth forces by trapezoids, friction held.

`z' = A z + B (u - N(x, v, t))`, z = (x, v, ...). With u and the smooth part of N straight between steps and
the dry part constant, `z+ = Phi z + G0 w + G1 w+ - (G0 + G1) dry+` is exact (first-order hold: Franklin,
Powell and Workman, Digital Control of Dynamic Systems, 3rd ed., 6.3). The dry part at the end of the step is
solved for, so that a sticking friction, however steep, neither chatters nor needs small steps (implicit
Euler: Acary and Brogliato, Numerical Methods for Nonsmooth Dynamical Systems, 2008, chapter 10).
"""

import numpy as np

from forefeel.common.error_size import Floats
from forefeel.common.jit import kernel

SMOOTH = ("quadratic", "cubic", "penetration_damping", "drag", "asymmetric", "change", "change_time")
"""Of the vector `smooth`: coefficients of x^2, x^3, max(x, 0) v, v |v|, |v|, and of x from a time on."""
DRY = (
    "forward", "backward", "falling", "falling_speed", "falling_power", "per_length",
    "bent", "bent_length", "bent_rate", "second_bent", "second_length", "band",
)  # fmt: skip
"""Of the vector `dry`: levels by direction, what falls with speed, growth with depth, elastic frictions
(force, length, damping of the first; force, length of the second), the speed within which direction is
linear."""

_TWICE = 2
_ROUNDS = 60


@kernel
def smooth_force(p: Floats, x: float, v: float, t: float) -> float:
    """The part of N without steps."""
    f = p[0] * x * x + p[1] * x * x * x + p[3] * v * abs(v) + p[4] * abs(v)
    if x > 0.0:
        f += p[2] * x * v
    if t > p[6]:
        f += p[5] * x
    return float(f)


@kernel
def bend(u: float, way: float, length: float) -> float:
    """Dahl's state after a way: exact at constant direction."""
    s = 1.0 if way > 0.0 else -1.0
    return float(s - (s - u) * np.exp(-abs(way) / length))


@kernel
def dry_force(p: Floats, x: float, v: float, way: float, h: float, u1: float, u2: float) -> float:
    """The part of N that depends on the direction; `way` was covered in this step of length h."""
    s = v / p[11]
    s = 1.0 if s > 1.0 else (-1.0 if s < -1.0 else s)
    f = (p[0] if s > 0.0 else p[1]) * s
    if p[2] != 0.0:
        f += p[2] * s * np.exp(-((abs(v) / p[3]) ** p[4]))
    if x > 0.0:
        f += p[5] * x * s
    if p[6] != 0.0:
        bent = bend(u1, way, p[7])
        f += p[6] * bent + p[8] * (bent - u1) / h
    if p[9] != 0.0:
        f += p[9] * bend(u2, way, p[10])
    return float(f)


@kernel
def held_force(  # noqa: PLR0913, PLR0917 - compiled code takes no objects
    p: Floats, x: float, v: float, x0: float, gx: float, gv: float, h: float, u1: float, u2: float
) -> float:
    """The dry force d at the end of the step: `v+ = v - gv d`, `x+ = x - gx d`; regula falsi (Illinois).

    x, v: where the step ends without it; x0: where it began.
    """
    low, high = v, v
    f_low = f_high = dry_force(p, x, v, x - x0, h, u1, u2)
    if f_low == 0.0:
        return 0.0
    # the force opposes: what solves `w + gv d(w) = v` lies between v and v - gv d(v), for a falling d beyond
    end = v - gv * f_low
    if dry_force(p, x - gx * f_low, end, x - gx * f_low - x0, h, u1, u2) == f_low:
        return f_low  # sliding: nothing but the direction counts
    low, high = min(v, end), max(v, end)
    for _ in range(_TWICE):
        wl, wh = (v - low) / gv, (v - high) / gv
        f_low = low + gv * dry_force(p, x - gx * wl, low, x - gx * wl - x0, h, u1, u2) - v
        f_high = high + gv * dry_force(p, x - gx * wh, high, x - gx * wh - x0, h, u1, u2) - v
        if f_low <= 0.0 <= f_high:
            break
        reach = high - low
        low, high = low - reach, high + reach
    w, side = low, 0
    for _ in range(_ROUNDS):
        if f_high == f_low:
            break
        w = (low * f_high - high * f_low) / (f_high - f_low)
        d = (v - w) / gv
        f = w + gv * dry_force(p, x - gx * d, w, x - gx * d - x0, h, u1, u2) - v
        if abs(f) <= 1e-9 * (abs(v) + gv * abs(d)) or high - low <= 1e-12 * (abs(v) + p[11]):
            break
        if f > 0.0:
            high, f_high = w, f
            if side > 0:
                f_low *= 0.5
            side = 1
        else:
            low, f_low = w, f
            if side < 0:
                f_high *= 0.5
            side = -1
    return (v - w) / gv


@kernel
def run(  # noqa: PLR0913, PLR0917 - compiled code takes no objects
    phi: Floats, g0: Floats, g1: Floats, u: Floats, z0: Floats, smooth: Floats, dry: Floats, grid: Floats
) -> Floats:
    """Position at every `grid[2]`-th step, shape (steps / grid[2] + 1,); inf from where it ran away.

    Args:
        phi, g0, g1: the linear part over one step, shapes (n, n), (n,), (n,).
        u: driving force at both ends of every step, shape (steps, 2).
        z0: initial state, shape (n,).
        smooth, dry: see SMOOTH and DRY.
        grid: time of the start, length of a step, steps per sample, largest believable position.
    """
    h, every, most = grid[1], int(grid[2]), grid[3]
    count, size = len(u), len(z0)
    out = np.full(count // every + 1, np.inf)
    z, free = z0.copy(), np.empty(size)
    nonlinear, rubbing = np.any(smooth[:6] != 0.0), np.any(dry[:10] != 0.0)
    u1 = u2 = 0.0
    gx, gv = g0[0] + g1[0], g0[1] + g1[1]
    out[0] = z[0]
    before = smooth_force(smooth, z[0], z[1], grid[0])
    for i in range(count):
        t = grid[0] + (i + 1) * h
        x0 = z[0]
        begun = u[i, 0] - before
        for row in range(size):
            free[row] = g0[row] * begun + g1[row] * u[i, 1]
            for column in range(size):
                free[row] += phi[row, column] * z[column]
        after, d = before, 0.0
        for _ in range(3 if nonlinear and rubbing else 2 if nonlinear else 1):
            x, v = free[0] - g1[0] * after, free[1] - g1[1] * after
            if rubbing:
                d = held_force(dry, x, v, x0, gx, gv, h, u1, u2)
            if nonlinear:
                after = smooth_force(smooth, x - gx * d, v - gv * d, t)
        for row in range(size):
            z[row] = free[row] - g1[row] * after - (g0[row] + g1[row]) * d
        before = after
        if rubbing and dry[6] != 0.0:
            u1 = bend(u1, z[0] - x0, dry[7])
        if rubbing and dry[9] != 0.0:
            u2 = bend(u2, z[0] - x0, dry[10])
        if not abs(z[0]) < most:
            break
        if (i + 1) % every == 0:
            out[(i + 1) // every] = z[0]
    return out
