"""The bench as bodies in a row and its simulation in time.

    stage -- link 0 -- body 0 -- link 1 -- body 1 ... last body -- wall

One of the links is the load cell. Each link is a spring with a damper, or a gap with a stiff contact at both
ends. Time steps of Moreau's kind: velocities first, with the dampers implicit and dry friction as the impulse
that brings a body to rest if its limit allows. So a body that sticks has a velocity of exactly zero, no slip.
(Moreau, Unilateral contact and dry friction in finite freedom dynamics, 1988.)
"""

from collections.abc import Callable, Iterable
from math import exp, inf, log, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from tests.hidden_effects.bench.stage import STEP_S, Array, Stage

_WORN = 0.2  # share of dry friction that is left when it is worn
_BUCKLED = 0.002  # share of a shaft's stiffness that is left when it is buckled
_CHANGE_S = 0.02  # s, that a puncture takes


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
        push_n: a force against the last body that no axis causes. heave_m: the wall's own motion. Both are as
            long as the stage's motion or longer.
    """
    push = np.zeros_like(stage.x) if push_n is None else push_n[: len(stage.x)]
    heave = np.zeros_like(stage.x) if heave_m is None else heave_m[: len(stage.x)]
    driven = (stage.t, stage.x, stage.v, push, heave, np.gradient(heave, STEP_S))
    cell_n, x, v = _advance(rig, float(stage.x[0]), zip(*(column.tolist() for column in driven), strict=True))
    return Run(np.array(cell_n), np.array(x), np.array(v))


def contact(mass_kg: float, frequency_hz: float, restitution: float) -> tuple[float, float]:
    """Stiffness and damping of a contact off which the mass rebounds with that share of its speed."""
    stiffness_n_m = mass_kg * (2.0 * pi * frequency_hz) ** 2
    damping_ratio = -log(restitution) / sqrt(pi**2 + log(restitution) ** 2)
    return stiffness_n_m, 2.0 * damping_ratio * sqrt(stiffness_n_m * mass_kg)


def _reaction(link: Link) -> Callable[[float, float], tuple[float, float]]:
    """By stretch and its rate: force on the body behind, and the damper's coefficient as far as it acts.

    A contact does not pull.
    """
    stiffness_n_m, damping_n_s_m, gap_m, limit_n = link
    half_m = 0.5 * gap_m

    def contacts(stretch_m: float, rate_m_s: float) -> tuple[float, float]:
        if -half_m <= stretch_m <= half_m:
            return 0.0, 0.0
        side = 1.0 if stretch_m > 0.0 else -1.0
        force_n = stiffness_n_m * (stretch_m - side * half_m) + damping_n_s_m * rate_m_s
        return (force_n, damping_n_s_m) if side * force_n > 0.0 else (0.0, 0.0)

    def spring(stretch_m: float, rate_m_s: float) -> tuple[float, float]:
        elastic_n = stiffness_n_m * stretch_m
        if elastic_n > limit_n:
            elastic_n = limit_n + _BUCKLED * (elastic_n - limit_n)
        return elastic_n + damping_n_s_m * rate_m_s, damping_n_s_m

    return contacts if gap_m > 0.0 else spring


def _resistance(wall: Wall) -> Callable[[float, float, float, float, float], tuple[float, float]]:
    """By time, depth, the body's own velocity, that against the wall and what relaxes: force and damping."""
    stiffness, _, forward, backward, quadratic, cubic, level_n, length_m = wall[:8]
    hunt, drag, unilateral, ratio, change_s = wall[8:13]

    def resisting(
        t: float, depth_m: float, v: float, rate_m_s: float, relaxing_n: float
    ) -> tuple[float, float]:
        drag_n, damping = (drag * v * abs(v), 2.0 * drag * abs(v)) if drag else (0.0, 0.0)
        if unilateral > 0.0 and depth_m <= 0.0:
            return drag_n, damping
        elastic_n = depth_m * (stiffness + depth_m * (quadratic + depth_m * cubic))
        if level_n:
            elastic_n += level_n * (exp(depth_m / length_m) - 1.0)
        if t > change_s:
            elastic_n *= 1.0 + (ratio - 1.0) * min((t - change_s) / _CHANGE_S, 1.0)
        own = forward if rate_m_s > 0.0 else backward
        if hunt and depth_m > 0.0:
            own += hunt * depth_m
        pressed_n = elastic_n + relaxing_n + own * rate_m_s
        if unilateral > 0.0 and pressed_n < 0.0:
            pressed_n = 0.0
        return pressed_n + drag_n, own + damping

    return resisting


def _friction(body: Body) -> Callable[[float, float, float], float] | None:
    """By position, velocity and way: the largest dry friction, static at rest, falling to Coulomb's with the
    speed; None where nothing rubs.
    """
    _, _, coulomb_n, static_n, stribeck_m_s, growth_n_m, wear_m = body

    def largest_n(x: float, v: float, way_m: float) -> float:
        limit_n = coulomb_n
        if static_n != coulomb_n:
            limit_n += (static_n - coulomb_n) * exp(-((v / stribeck_m_s) ** 2))
        if x > 0.0:
            limit_n += growth_n_m * x
        return limit_n * (_WORN + (1.0 - _WORN) * exp(-way_m / wear_m)) if wear_m < inf else limit_n

    return largest_n if coulomb_n or static_n or growth_n_m else None


def _capstan(tip_n: float, x: float, wall: Wall) -> tuple[float, float]:
    """Friction around bends against motion forward and backward: Euler's factor on the tip's force."""
    growth = exp(wall.capstan + wall.capstan_per_m * max(x, 0.0))
    against, along = abs(tip_n) * (growth - 1.0), abs(tip_n) * (1.0 - 1.0 / growth)
    return (against, along) if tip_n > 0.0 else (along, against)


def _advance(
    rig: Rig, start_m: float, driven: Iterable[tuple[float, ...]]
) -> tuple[list[float], list[list[float]], list[list[float]]]:
    """One loop over time; `driven`: time, stage's position and velocity, push, heave and its velocity.

    Plain floats in lists: elements of arrays would take three times as long. In front of body 0 is the stage,
    at index -1. A step goes from the wall to it, so what is in front of a body has not moved yet.
    """
    wall, waves, cell, last = rig.wall, rig.waves, rig.cell, len(rig.bodies) - 1
    rest_m, resistance, bends = wall.rest_m, _resistance(wall), bool(wall.capstan or wall.capstan_per_m)
    chain = [
        (i, _reaction(rig.links[i]), _friction(rig.bodies[i]), *rig.bodies[i][:2])
        for i in range(last, -1, -1)
    ]
    relaxing = [(n_m, tau_s, exp(-STEP_S / tau_s), 0.0) for n_m, tau_s in rig.branches]
    hairs = [(n_m, most_m, 0.0) for n_m, most_m in rig.asperities]
    x, v, way = [start_m] * (last + 2), [0.0] * (last + 2), [0.0] * (last + 1)
    cell_n, all_x, all_v = list[float](), [list[float]() for _ in way], [list[float]() for _ in way]
    for t, x[-1], v[-1], push_n, heave_m, heave_v in driven:
        depth, rate = x[last] - rest_m - heave_m, v[last] - heave_v
        relaxing_n, held_n = 0.0, push_n
        for n_m, _, _, u in relaxing:
            relaxing_n += n_m * u
        for n_m, _, u in hairs:
            held_n += n_m * u
        for wave_n, per_m, phase in waves:
            held_n += wave_n * sin(per_m * x[last] + phase)
        tip_n, behind_c = resistance(t, depth, v[last], rate, relaxing_n)
        behind_n = tip_n + held_n
        for i, reaction, friction, mass_kg, viscous in chain:
            at, speed = x[i], v[i]
            link_n, link_c = reaction(x[i - 1] - at, v[i - 1] - speed)
            if i == cell:
                cell_n.append(link_n)
            given = STEP_S / (mass_kg + STEP_S * (viscous + link_c + behind_c))
            free = speed + given * (link_n - behind_n - viscous * speed)
            if friction or bends:
                dry_n = friction(at, speed, way[i]) if friction else 0.0
                forward_n, backward_n = _capstan(tip_n, at, wall) if bends and i == last else (0.0, 0.0)
                free -= min(max(free, -given * (dry_n + backward_n)), given * (dry_n + forward_n))
            v[i], x[i] = free, at + STEP_S * free
            way[i] += STEP_S * abs(free)
            all_x[i].append(x[i])
            all_v[i].append(free)
            behind_n, behind_c = link_n, link_c
        if relaxing:
            rate = v[last] - heave_v if wall.unilateral == 0.0 or depth > 0.0 else 0.0
            relaxing = [
                (n_m, tau_s, decay, decay * u + tau_s * (1.0 - decay) * rate)
                for n_m, tau_s, decay, u in relaxing
            ]
        if hairs:
            moved = STEP_S * v[last]
            hairs = [(n_m, most_m, min(max(u + moved, -most_m), most_m)) for n_m, most_m, u in hairs]
    return cell_n, all_x, all_v
