"""Integrator of a guidewire: stage, play, gripper, wire in a path, wall or tissue, load cell, in this order.

The stage's motion is given; what is behind it is integrated at each step of the grid. Of an effect that is
not there, the number is 0 or infinite.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import exp, inf, pi
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from tests.hidden_effects.laboratory.forces import played
from tests.hidden_effects.laboratory.motion import Motion
from tests.hidden_effects.laboratory.truth import Array

_BUCKLED = 0.03  # share of the stiffness that a buckled wire has left
_LETS_GO_S = 0.02  # s, time constant of a tip that folds over
_TURNS_M = 2e-5  # half the way over which the friction of a bend turns round
_HOLDS_AGAIN = 0.25  # share of the limit under which a tip that folded over stands again


class Rub(NamedTuple):
    """Jenkins element along the path: (level_n + growth_n_m length within) z / length_m, |z| <= length_m.

    Within is what is inserted beyond `begins_m`, `arc_m` at most: a bend.
    """

    level_n: float
    growth_n_m: float
    length_m: float
    begins_m: float = 0.0
    arc_m: float = inf


@dataclass(frozen=True)
class Wire:
    """Numbers of one world, in SI units.

    Attributes:
        entry_m: stage's position at which nothing is inserted. rest_m: where tissue or wall are relaxed.
        one_sided: a wall, which begins at `rest_m` and does not pull, in place of tissue.
        ratio: of the stiffness from `change_s` on.
        toe_m: depth over which a wall's stiffness comes. branches: Maxwell's (N/m, s).
        more_n_s_m2: damping per depth.
        yield_n: elastic force above which the wall yields, `yields_back`: also when it is drawn.
        prolapse_n: tip's force at which it folds over, `kept`: share of the force that is left then.
        rubs: along the path. static: (ratio to the sliding friction, m/s). wrap: mu times angle, at the entry
            and per inserted m. heart: N of the unit wave, N per inserted m, share of the friction.
        euler_n_m2: pi^2 EI / K^2. free_m: between gripper and sheath when nothing is inserted.
        holding_n: of the gripper. slip_m: way of one slip, at `slip_m_s`; 0: it creeps with `creep_n_s_m`.
        beside: N of each unit force of the `Run` that acts beside the wire.
    """

    mass_kg: float
    damping_n_s_m: float
    stiffness_n_m: float
    entry_m: float = 0.0
    rest_m: float = 0.0
    one_sided: bool = False
    quadratic_n_m2: float = 0.0
    toe_m: float = 0.0
    ratio: float = 1.0
    change_s: float = inf
    branches: tuple[tuple[float, float], ...] = ()
    more_n_s_m2: float = 0.0
    yield_n: float = inf
    yields_back: bool = False
    prolapse_n: float = inf
    kept: float = 1.0
    rubs: tuple[Rub, ...] = ()
    static: tuple[float, float] = (1.0, 1.0)
    wrap: tuple[float, float] = (0.0, 0.0)
    heart: tuple[float, float, float] = (0.0, 0.0, 0.0)
    euler_n_m2: float = inf
    free_m: float = 1.0
    holding_n: float = inf
    slip_m: float = 0.0
    slip_m_s: float = 0.2
    creep_n_s_m: float = inf
    gap_m: float = 0.0
    lag_s: float = 0.0
    beside: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Run:
    """One motion of the stage, and what goes on meanwhile: unit forces by name, the patient's unit wave as
    `wave`, further columns of the recording by header.
    """

    m: Motion
    units: dict[str, Array] = field(default_factory=dict)
    further: dict[str, Array] = field(default_factory=dict)

    def every(self, stride: int) -> "Run":
        """The same on a coarser grid."""
        units = {name: unit[::stride] for name, unit in self.units.items()}
        return Run(Motion(*(column[::stride] for column in self.m)), units)


def force(wire: Wire, run: Run) -> Array:
    """Force at the load cell along a run; a positive one resists insertion."""
    m = run.m
    if wire.gap_m:
        x = played(m.x, wire.gap_m)
        m = Motion(m.t, x, np.gradient(x, m.t), m.a)
    total = along(wire, m, run.units.get("wave"))[0] + wire.mass_kg * m.a
    for name, size_n in wire.beside.items():
        total = total + size_n * run.units[name]
    if wire.lag_s:
        pole = exp(-(m.t[1] - m.t[0]) / wire.lag_s)
        total = lfilter([1.0 - pole], [1.0, -pole], total, zi=[pole * total[0]])[0]
    return np.asarray(total)


def along(wire: Wire, m: Motion, wave: Array | None = None) -> tuple[Array, Array]:
    """Force on the gripper, and the way by which the wire has slipped through it."""
    step_s = float(m.t[1] - m.t[0])
    tip, rub, slipping = _tip(wire, step_s), _rub(wire), _slipping(wire, step_s)
    folding = _folding(wire, step_s) if wire.prolapse_n < inf else None
    bending = _bending(wire) if any(wire.wrap) else None
    level_n, deep_n_m, rubbed = wire.heart
    buckles, grips = wire.euler_n_m2 < inf, wire.holding_n < inf
    last, slip, slip_rate = float(m.x[0]), 0.0, 0.0
    force_n, slipped_m = [], []
    beats = np.zeros_like(m.t) if wave is None else wave
    for now, x, stage, beat in zip(m.t.tolist(), m.x.tolist(), m.v.tolist(), beats.tolist(), strict=True):
        y, v = x - slip, stage - slip_rate
        move, last = y - last, y
        inserted = y - wire.entry_m if y > wire.entry_m else 0.0
        total = tip(now, y, v) + beat * (level_n + deep_n_m * inserted)
        if folding:
            total = folding(total)
        if bending:
            total = bending(total, move, inserted)
        total += rub(move, v, inserted) * max(1.0 + rubbed * beat, 0.0) + wire.damping_n_s_m * v
        if buckles and total > (limit := euler_n(wire, y)):
            total = limit + _BUCKLED * (total - limit)
        if grips:
            slip, slip_rate = slipping(total, slip)
        force_n.append(total)
        slipped_m.append(slip)
    return np.array(force_n), np.array(slipped_m)


def _tip(w: Wire, step_s: float) -> Callable[[float, float, float], float]:
    """Force of tissue or wall on the tip at a time, position and speed; to be asked step by step."""
    plastic, damps, toe_m = 0.0, w.more_n_s_m2, w.toe_m
    # stiffness, decay, filling, stretch
    branches = [
        [n_m, exp(-step_s / tau_s), tau_s * (1.0 - exp(-step_s / tau_s)), 0.0] for n_m, tau_s in w.branches
    ]
    soft, bent, rest_m, one_sided, change_s = (
        w.stiffness_n_m,
        w.quadratic_n_m2,
        w.rest_m,
        w.one_sided,
        w.change_s,
    )
    most, least = w.yield_n, -w.yield_n if w.yields_back else -inf

    def at(now: float, y: float, v: float) -> float:
        nonlocal plastic
        depth = y - rest_m - plastic
        if one_sided and depth <= 0.0:
            for branch in branches:
                branch[3] *= branch[1]
            return 0.0
        stiffness = soft * w.ratio if now > change_s else soft
        pressed = (
            depth if not toe_m else depth - 0.5 * toe_m if depth > toe_m else 0.5 * depth * depth / toe_m
        )
        tip = pressed * (stiffness + depth * bent)
        if not least <= tip <= most:
            kept = most if tip > most else least
            plastic += (tip - kept) / stiffness
            tip = kept
        for branch in branches:
            branch[3] = branch[1] * branch[3] + branch[2] * v
            tip += branch[0] * branch[3]
        if damps and depth > 0.0:
            tip += damps * depth * v
        return 0.0 if one_sided and tip < 0.0 else tip

    return at


def _folding(w: Wire, step_s: float) -> Callable[[float], float]:
    """Force of a tip that folds over above a limit, of the force that it would have upright."""
    stands, folded, stays = 1.0, False, exp(-step_s / _LETS_GO_S)

    def at(tip: float) -> float:
        nonlocal stands, folded
        folded = tip > (_HOLDS_AGAIN if folded else 1.0) * w.prolapse_n
        stands = stays * stands + (1.0 - stays) * (w.kept if folded else 1.0)
        return tip * stands

    return at


def _bending(w: Wire) -> Callable[[float, float, float], float]:
    """Euler's and Eytelwein's factor on the tip's force: more against the way, less along with it."""
    turn = 0.0

    def at(tip: float, move: float, inserted: float) -> float:
        nonlocal turn
        turn = min(max(turn + move / _TURNS_M, -1.0), 1.0)
        return tip * exp((w.wrap[0] + w.wrap[1] * inserted) * (turn if tip > 0.0 else -turn))

    return at


def _rub(w: Wire) -> Callable[[float, float, float], float]:
    """Dry friction along the path, of all elements."""
    z, elements = [0.0] * len(w.rubs), list(enumerate(w.rubs))
    more, stribeck_m_s = w.static[0] - 1.0, w.static[1]

    def at(move: float, v: float, inserted: float) -> float:
        rub = 0.0
        for i, (level, growth, length, begins, arc) in elements:
            to = z[i] + move
            z[i] = to = length if to > length else -length if to < -length else to
            within = inserted - begins
            if within > 0.0:
                level += growth * (within if within < arc else arc)  # noqa: PLW2901
            rub += level * to / length
        return rub * (1.0 + more * exp(-((v / stribeck_m_s) ** 2))) if more else rub

    return at


def _slipping(w: Wire, step_s: float) -> Callable[[float, float], tuple[float, float]]:
    """Way slipped through the gripper, and its speed, after one more step at that force."""
    left, side = 0.0, 0.0

    def at(total: float, slip: float) -> tuple[float, float]:
        nonlocal left, side
        over = abs(total) - w.holding_n
        if left <= 0.0 and over > 0.0:
            left, side = w.slip_m, 1.0 if total > 0.0 else -1.0
            if not left:
                return slip + side * over / w.creep_n_s_m * step_s, side * over / w.creep_n_s_m
        part = min(w.slip_m_s * step_s, left)
        left -= part
        return slip + side * part, side * part / step_s

    return at


def euler_n(wire: Wire, at_m: float) -> float:
    """Euler's load of the free length at that position of the stage; at least a millimetre is free."""
    return wire.euler_n_m2 / max(wire.free_m - (at_m - wire.entry_m), 1e-3) ** 2


def swinging(m: Motion, hz: float, ratio: float) -> Array:
    """Pull on the stage of a mass of 1 kg that hangs on it: w^2 z + 2 d w z', z'' + 2 d w z' + w^2 z = a."""
    w, rate = 2.0 * pi * hz, 2.0 / float(m.t[1] - m.t[0])
    top, bottom = np.array([2.0 * ratio * w, w * w]), np.array([1.0, 2.0 * ratio * w, w * w])
    above = np.array([top[0] * rate + top[1], 2.0 * top[1], top[1] - top[0] * rate])
    square, first = rate * rate, bottom[1] * rate
    below = np.array([square + first + w * w, 2.0 * (w * w - square), square - first + w * w])
    return np.asarray(lfilter(above / below[0], below / below[0], m.a))
