"""The bench as bodies in a row and its simulation in time.

    stage -- link 0 -- body 0 -- link 1 -- body 1 ... last body -- wall

One of the links is the load cell. Each link is a spring with a damper, or a gap with a stiff contact at both
ends. Time steps of Moreau's kind: velocities first, with the dampers implicit and dry friction as the impulse
that brings a body to rest if its limit allows. So a body that sticks has a velocity of exactly zero, no slip.
(Moreau, Unilateral contact and dry friction in finite freedom dynamics, 1988.)
"""

from collections.abc import Callable, Sequence
from math import exp, inf, log, pi, sin, sqrt
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numba import njit

from tests.hidden_effects.bench.stage import STEP_S, Array, Stage

_WORN = 0.2  # share of dry friction that is left when it is worn
_BUCKLED = 0.002  # share of a shaft's stiffness that is left when it is buckled
_CHANGE_S = 0.02  # s, that a puncture takes

Function = TypeVar("Function", bound=Callable[..., Any])


class Body(NamedTuple):
    """Mass and what rubs on it; `wear_m` is the way over which dry friction wears by 1 / e."""

    mass_kg: float
    viscous_n_s_m: float = 0.0
    coulomb_n: float = 0.0
    static_n: float = 0.0
    stribeck_m_s: float = 1.0
    growth_n_m: float = 0.0
    wear_m: float = inf


class Link(NamedTuple):
    """To the body before; `limit_n` is the compression at which it buckles."""

    stiffness_n_m: float
    damping_n_s_m: float
    gap_m: float = 0.0
    limit_n: float = inf


class Wall(NamedTuple):
    """What the last body touches. `capstan` is mu theta, `capstan_per_m` what it grows by with the depth."""

    stiffness_n_m: float
    rest_m: float
    forward_n_s_m: float = 0.0
    backward_n_s_m: float = 0.0
    quadratic_n_m2: float = 0.0
    cubic_n_m3: float = 0.0
    level_n: float = 0.0
    length_m: float = 1.0
    hunt_n_s_m2: float = 0.0
    drag_n_s2_m2: float = 0.0
    unilateral: float = 0.0
    ratio: float = 1.0
    change_s: float = inf
    capstan: float = 0.0
    capstan_per_m: float = 0.0


class Rig(NamedTuple):
    """`branches`: Maxwell's, (N/m, s). `asperities` on the last body: (N/m, m of breakaway), Iwan's elements.
    `waves` over the last body's position: (N, rad/m, rad). `cell`: the index of the measured link.
    """

    bodies: tuple[Body, ...]
    links: tuple[Link, ...]
    wall: Wall
    branches: tuple[tuple[float, float], ...] = ()
    asperities: tuple[tuple[float, float], ...] = ()
    waves: tuple[tuple[float, float, float], ...] = ()
    cell: int = 0


class Run(NamedTuple):
    """On the fine grid: the cell's force, and each body's position and velocity, shape (bodies, samples)."""

    cell_n: Array
    x: Array
    v: Array


def simulated(rig: Rig, stage: Stage, push_n: Array | None = None, heave_m: Array | None = None) -> Run:
    """Everything rests at the stage's first position.

    Args:
        push_n: a force against the last body that no axis causes. heave_m: the wall's own motion.
    """
    push = np.zeros_like(stage.x) if push_n is None else push_n
    heave = np.zeros_like(stage.x) if heave_m is None else heave_m
    shape = (len(rig.bodies), len(stage.x))
    run = Run(np.empty(shape[1]), np.empty(shape), np.empty(shape))
    driven = (stage.t, stage.x, stage.v, push, heave, np.gradient(heave, STEP_S))
    tables = (_rows(rig.branches, 2), _rows(rig.asperities, 2), _rows(rig.waves, 3))
    _advance(driven, _rows(rig.bodies, 7), _rows(rig.links, 4), rig.wall, tables, rig.cell, run)
    return run


def contact(mass_kg: float, frequency_hz: float, restitution: float) -> tuple[float, float]:
    """Stiffness and damping of a contact off which the mass rebounds with that share of its speed."""
    stiffness_n_m = mass_kg * (2.0 * pi * frequency_hz) ** 2
    damping_ratio = -log(restitution) / sqrt(pi**2 + log(restitution) ** 2)
    return stiffness_n_m, 2.0 * damping_ratio * sqrt(stiffness_n_m * mass_kg)


def _rows(rows: Sequence[Sequence[float]], width: int) -> Array:
    return np.array(rows, dtype=np.float64).reshape(-1, width)


def _compiled(function: Function) -> Function:
    return cast(Function, njit(cache=True)(function))


@_compiled
def _link(stretch_m: float, rate_m_s: float, link: Array) -> tuple[float, float]:
    """Force on the body behind, and the damper's coefficient as far as it acts; a contact does not pull."""
    stiffness_n_m, damping_n_s_m, half_m, limit_n = link[0], link[1], 0.5 * link[2], link[3]
    if half_m > 0.0:
        if abs(stretch_m) <= half_m:
            return 0.0, 0.0
        side = 1.0 if stretch_m > 0.0 else -1.0
        force_n = stiffness_n_m * (stretch_m - side * half_m) + damping_n_s_m * rate_m_s
        return (force_n, damping_n_s_m) if side * force_n > 0.0 else (0.0, 0.0)
    elastic_n = stiffness_n_m * stretch_m
    if elastic_n > limit_n:
        elastic_n = limit_n + _BUCKLED * (elastic_n - limit_n)
    return elastic_n + damping_n_s_m * rate_m_s, damping_n_s_m


@_compiled
def _wall(
    t: float, depth_m: float, v: float, rate_m_s: float, relaxing_n: float, wall: Wall
) -> tuple[float, float]:
    """Resisting force and its damping; v is the body's own velocity, rate_m_s that against the wall."""
    if wall.unilateral > 0.0 and depth_m <= 0.0:
        return wall.drag_n_s2_m2 * v * abs(v), 2.0 * wall.drag_n_s2_m2 * abs(v)
    changed = min(max((t - wall.change_s) / _CHANGE_S, 0.0), 1.0)
    elastic_n = depth_m * (wall.stiffness_n_m + depth_m * (wall.quadratic_n_m2 + depth_m * wall.cubic_n_m3))
    if wall.level_n != 0.0:
        elastic_n += wall.level_n * (exp(depth_m / wall.length_m) - 1.0)
    elastic_n *= 1.0 + (wall.ratio - 1.0) * changed
    damping = wall.forward_n_s_m if rate_m_s > 0.0 else wall.backward_n_s_m
    damping += wall.hunt_n_s_m2 * max(depth_m, 0.0)
    pressed_n = elastic_n + relaxing_n + damping * rate_m_s
    if wall.unilateral > 0.0:
        pressed_n = max(pressed_n, 0.0)
    return pressed_n + wall.drag_n_s2_m2 * v * abs(v), damping + 2.0 * wall.drag_n_s2_m2 * abs(v)


@_compiled
def _dry(x: float, v: float, way_m: float, body: Array) -> float:
    """The largest dry friction now: static at rest, falling to Coulomb's with the speed."""
    coulomb_n, static_n, stribeck_m_s, growth_n_m, wear_m = body[2], body[3], body[4], body[5], body[6]
    limit_n: float = coulomb_n + (static_n - coulomb_n) * exp(-((v / stribeck_m_s) ** 2))
    limit_n += growth_n_m * max(x, 0.0)
    return limit_n * (_WORN + (1.0 - _WORN) * exp(-way_m / wear_m)) if wear_m < inf else limit_n


@_compiled
def _capstan(tip_n: float, x: float, wall: Wall) -> tuple[float, float]:
    """Friction around bends against motion forward and backward: Euler's factor on the tip's force."""
    growth = exp(wall.capstan + wall.capstan_per_m * max(x, 0.0))
    against, along = abs(tip_n) * (growth - 1.0), abs(tip_n) * (1.0 - 1.0 / growth)
    return (against, along) if tip_n > 0.0 else (along, against)


@_compiled
def _advance(
    driven: tuple[Array, ...], bodies: Array, links: Array, wall: Wall,
    tables: tuple[Array, Array, Array], cell: int, run: Run,
) -> None:  # fmt: skip
    """One loop over time; `driven`: time, stage's position and velocity, push, heave and its velocity."""
    times, stage, stage_v, push, heave, heave_v = driven
    branches, asperities, waves = tables
    count, last = len(bodies), len(bodies) - 1
    x, v, way = np.full(count, stage[0]), np.zeros(count), np.zeros(count)
    link_n, link_c = np.zeros(count), np.zeros(count)
    relaxing, hairs = np.zeros(len(branches)), np.zeros(len(asperities))
    decay = np.exp(-STEP_S / branches[:, 1])
    for n in range(len(stage)):
        for i in range(count):
            front, front_v = (stage[n], stage_v[n]) if i == 0 else (x[i - 1], v[i - 1])
            link_n[i], link_c[i] = _link(front - x[i], front_v - v[i], links[i])
        run.cell_n[n] = link_n[cell]
        depth = x[last] - wall.rest_m - heave[n]
        relaxing_n = np.sum(branches[:, 0] * relaxing)
        tip_n, tip_c = _wall(times[n], depth, v[last], v[last] - heave_v[n], relaxing_n, wall)
        held_n = push[n] + np.sum(asperities[:, 0] * hairs)
        for j in range(len(waves)):
            held_n += waves[j, 0] * sin(waves[j, 1] * x[last] + waves[j, 2])
        for i in range(count):
            behind_n, behind_c = (tip_n + held_n, tip_c) if i == last else (link_n[i + 1], link_c[i + 1])
            given = STEP_S / (bodies[i, 0] + STEP_S * (bodies[i, 1] + link_c[i] + behind_c))
            free = v[i] + given * (link_n[i] - behind_n - bodies[i, 1] * v[i])
            dry_n = _dry(x[i], v[i], way[i], bodies[i])
            forward_n, backward_n = _capstan(tip_n, x[i], wall) if i == last else (0.0, 0.0)
            v[i] = free - min(max(free, -given * (dry_n + backward_n)), given * (dry_n + forward_n))
            x[i] += STEP_S * v[i]
            way[i] += STEP_S * abs(v[i])
            run.x[i, n], run.v[i, n] = x[i], v[i]
        rate = v[last] - heave_v[n] if wall.unilateral == 0.0 or depth > 0.0 else 0.0
        for j in range(len(relaxing)):
            relaxing[j] = decay[j] * relaxing[j] + branches[j, 1] * (1.0 - decay[j]) * rate
        for j in range(len(hairs)):
            moved = hairs[j] + STEP_S * v[last]
            hairs[j] = min(max(moved, -asperities[j, 1]), asperities[j, 1])
