"""Wire between gripper and sheath: it slips through the jaws, or bows out under a push."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from math import copysign
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from forefeel.common.causes.base import FactorEffect, MotionEffect, Parameter, Site
from forefeel.common.causes.candidate import (
    Candidate,
    Changing,
    Entry,
    Extent,
    Fitted,
    Modulation,
    Shape,
    Transmission,
    Values,
    entry,
    within,
)
from forefeel.common.causes.motion import Kinematics, Memory, MotionGrid, Value
from forefeel.common.causes.numerics import Array, loop
from forefeel.common.causes.sensor import Bias

SLIP_M_S = 0.15
"""Speed of a jump: a sliding friction of .1 to .5 N less than the holding force, on some 2 N s/m; chosen."""
_STRAIGHT_M = 1e-3  # m that are free at least: Euler's load has no bound where nothing is free
# shares of ranges that are tried first, chosen: levels of a slip, jumps, creeps over the stiffness in s;
# lengths beyond the farthest position, loads there, zeros of the cell
_NEAR, _JUMPS, _CREEPS_S = (0.6, 0.7, 0.78, 0.85, 0.9, 0.95, 0.985), (0.005, 0.015, 0.05), (0.05, 0.5)
_FREE, _LIMITS, _ZEROS = (0.12, 0.3, 0.7, 1.5), (0.5, 0.7, 0.9, 1.1, 1.4), (0.0, 0.25)
_NEARLY = 0.9  # of a limit, below which nothing gives way: the band rounds its corners
_MOST_ROWS, _LEAST_ROWS, _ROUNDS = 4000, 20, 5
_LEAST_SPRING = 0.2  # of the force's range: chosen
_ONE_SIDE_N = 1e4  # by which the other side's holding force is higher


def _fit_straight(m: MotionGrid, free: NDArray[np.bool_], apart: bool) -> tuple[Array, Array, float]:
    """Fits damper, spring and mass where the wire is `free`. Returns along the whole motion the force in N at
    the jaws without the mass's, and the mass's; and the stiffness in N/m. `apart`: each free stretch has a
    level of its own, as after a slip, the force that of the first.
    """
    some = np.flatnonzero(free)[:: 1 + len(free) // _MOST_ROWS]
    stretch = np.cumsum(np.diff(np.cumsum(~free)[some], prepend=-1) > 0) - 1 if apart else 0 * some
    rows = np.stack([column[some] for column in (m.v, m.x, m.a, m.force)])
    level = np.stack([np.bincount(stretch, row) for row in rows]) / np.bincount(stretch)
    away = rows - level[:, stretch]
    scale = np.sqrt(np.mean(away[:3] ** 2, axis=1)) + 1e-300
    theta = np.linalg.lstsq((away[:3] / scale[:, None]).T, away[3], rcond=1e-6)[0] / scale
    level_n = level[3, 0] - theta @ level[:3, 0]
    return np.asarray(theta[0] * m.v + theta[1] * m.x + level_n), np.asarray(theta[2] * m.a), float(theta[1])


@dataclass(frozen=True, kw_only=True, eq=False)
class Preloaded(Changing):
    """Change of what the jaws bear, which is the reading but for the mass: at position 0 a preload."""

    coefficients: tuple[str, ...] = ("preload_n",)
    signs: tuple[int, ...] = (0,)
    mass_site: Site = "sensor"
    costly: bool = True
    logarithmic: bool = False
    least_ratio: float = 2.0  # a wall that yields, or a tip that folds over, is like it by less

    def columns(self, motion: MotionGrid, shape: Shape) -> list[Array]:
        return [np.ones_like(motion.x)]

    def named(self, fitted: Fitted) -> Values:
        return self.values_at(fitted.shape)

    def entries(self, fitted: Fitted) -> list[Entry]:
        preload = entry(Bias, {"force_n": float(fitted.coefficients[0])})
        return [entry(self.kind, self.values_at(fitted.shape)), {**preload, "site": "wall"}]


@dataclass(frozen=True, kw_only=True, eq=False)
class Slipping(Preloaded, Transmission):
    """Slip above a reading, or below it where it is negative, of the force without slip."""

    sizes: tuple[str, ...] | None = ("holding_n",)

    def values_at(self, shape: Shape) -> Values:
        return {**super().values_at(shape), "holding_n": abs(shape[0])}

    def named(self, fitted: Fitted) -> Values:
        # where one jump is a little longer, all later ones come at other times: their length is not told
        return {name: value for name, value in super().named(fitted).items() if name != "slipped_m"}

    def moved(self, motion: MotionGrid, shape: Shape) -> MotionGrid:
        """Instrument's motion with slips where the force, as fitted without any, passes the level shape[0].
        The given motion where the force never is below it, or hardly any of it is a spring's.
        """
        level_n, side = shape[0], 1.0 if shape[0] > 0.0 else -1.0
        free = side * motion.force < _NEARLY * abs(level_n)
        if not free.any():
            return motion
        force_n, _, stiffness = _fit_straight(motion, free, apart=True)
        if stiffness * np.ptp(motion.x) < _LEAST_SPRING * np.ptp(motion.force):
            return motion  # without a spring no force is lost by a slip: it then is a damper on one side
        effect = self.kind(**within(self.kind, {**self.values_at(shape), "holding_n": _ONE_SIDE_N}))
        force_n += side * _ONE_SIDE_N - level_n
        moved: MotionGrid = effect.slipped(motion, force_n, stiffness)
        return moved


def _levels(extent: Extent, unit: float, shares: Sequence[float]) -> list[Shape]:
    """Shapes that are tried: readings in N near either end of the range, each with every share of `unit`."""
    low_n, high_n = extent.low_n, extent.high_n
    highs = [low_n + near * (high_n - low_n) for near in _NEAR]
    levels = [n for n in highs if n > 0.0] + [n for n in (low_n + high_n - n for n in highs) if n < 0.0]
    return [(level_n, share * unit) for level_n in levels for share in shares]


class Slip(Memory):
    """Way slipped through the jaws, and way of this step, in m; back is positive, as the force that pushes.

    Above `holding_n` the wire jumps by `jump_m`, at most `reach_m` a step, whatever the force meanwhile. With
    a `jump_m` of 0 it creeps by `per_n` for each N above.
    """

    start = 0.0, 0.0

    def step(
        self, force_n: float, spring_n_m: float, holding_n: float, jump_m: float, reach_m: float, per_n: float
    ) -> tuple[float, float]:
        """Advances by a step; returns the way slipped so far, this step's included, and this step's, in m.

        A slip begins where |force_n - spring_n_m * way| is above `holding_n`: a jump of `jump_m` or, if that
        is 0, `per_n` for each N above. No step goes beyond `reach_m`: what is left of a jump follows.
        """
        slipped_m, left_m = self.value
        felt_n = force_n - spring_n_m * slipped_m
        over_n = abs(felt_n) - holding_n
        if left_m == 0.0 and over_n > 0.0:
            left_m = copysign(jump_m or over_n * per_n, felt_n)
        way_m = min(max(left_m, -reach_m), reach_m)
        self.value = slipped_m + way_m, left_m - way_m if jump_m else 0.0
        return slipped_m + way_m, way_m

    @staticmethod
    def run(*inputs: Array) -> Array:
        return loop("slip", *inputs, outputs=2)


class GripperSlip(MotionEffect):
    """`y = x - s`: s jumps by slipped_m where the force at the jaws, as it was a step ago, passes holding_n.

    With a slipped_m of 0 the wire creeps, `s' = (|F| - holding_n) / creep_n_s_m`; a simulation needs a
    creep_n_s_m above half of its stiffness times the step. Either way goes where the force pushes.
    """

    name = "gripper_slip"
    parameters = (
        Parameter("holding_n", "N", 1e4, 0.0, 1e4, linear=False),
        Parameter("slipped_m", "m", 0.0, 0.0, 1.0, linear=False),
        Parameter("creep_n_s_m", "N s/m", 10.0, 1e-3, 1e9, linear=False),
    )
    by_force = True
    picture = "time"
    needs_spring = True
    reference = (
        "Coulomb's law at the jaws; creep: Bingham, Fluidity and Plasticity, 1922, a rate by what exceeds a "
        "limit"
    )
    fingerprint = "the force gives way above a limit, and all positions count from another zero afterwards"
    words = "a wire that slips through the gripper"
    remedy = "close the gripper harder or clean its jaws; what has slipped is lost to every position since"
    candidates: ClassVar[Sequence[Candidate]] = (
        Slipping(shapes=("holding_n", "slipped_m"), grid=lambda e: _levels(e, e.stroke_m, _JUMPS)),
        Slipping(
            form="creep", shapes=("holding_n", "creep_n_s_m"),
            grid=lambda e: _levels(e, (e.high_n - e.low_n) / e.stroke_m, _CREEPS_S),
        ),
    )  # fmt: skip
    equation: ClassVar[tuple[str, ...]] = (
        "x less {slipped_m} m each time that the jaws' force passes {holding_n} N",
        "x less a creep of (F - {holding_n}) / {creep_n_s_m} m/s above {holding_n} N",
        "x less what slips away where the jaws' force passes {holding_n} N",
    )

    slip = Slip()

    def moved(self, m: Kinematics) -> Kinematics:
        """Instrument's motion for the stage's m, whose `force` is that at the jaws."""
        return self.slipped(m, m.force, 0.0)

    def slipped(self, m: Kinematics, force_n: Value, stiffness_n_m: float) -> Kinematics:
        """Instrument's motion where the jaws bear `force_n` less a stiffness times the way slipped."""
        holding_n, jump_m, creep_n_s_m = (self.values[p.name] for p in self.parameters)
        reach_m, per_n = SLIP_M_S * m.dt, m.dt / (creep_n_s_m + stiffness_n_m * m.dt)
        slipped_m, way_m = m.through(self.slip, force_n, stiffness_n_m, holding_n, jump_m, reach_m, per_n)
        least_s = 1e-12  # before the first sample no time has passed, and no way has been gone
        return m.along(m.x - slipped_m, m.v - way_m / (m.positive(m.dt - least_s) + least_s), m.a)


@dataclass(frozen=True, kw_only=True, eq=False)
class Bowed(Preloaded, Modulation):
    """Limit of the force that a straight wire would bear; shape: Euler's load at 0, free length, and `by_tip`
    the reading at which the wire bears nothing, else 0.
    """

    sizes: tuple[str, ...] | None = ("euler_n_m2",)

    def values_at(self, shape: Shape) -> Values:
        return {"euler_n_m2": shape[0] * shape[1] ** 2, "free_length_m": shape[1]}

    def factor(self, motion: MotionGrid, shape: Shape) -> Array:
        return _share_borne(self, motion, shape)


@lru_cache(4)  # for each cause of a model anew
def _share_borne(form: Bowed, motion: MotionGrid, shape: Shape) -> Array:
    """Factor, of shape (n,), from the force that a straight wire would bear to that of the bowed one. The
    force of the straight wire is fitted in rounds, to the samples where it is below the limit.
    """
    effect, zero_n = form.effect(shape), shape[-1] if form.by_tip else 0.0
    tip_n = motion.force - zero_n
    limit_n = force_n = effect.limit_n(motion)
    free = tip_n < _NEARLY * limit_n
    for _ in range(_ROUNDS):
        if np.count_nonzero(free) > _LEAST_ROWS:
            level_n, mass_n, _ = _fit_straight(motion, free, apart=False)
            force_n = level_n - zero_n
            free = (force_n < _NEARLY * limit_n) & (tip_n - mass_n < limit_n)
    return np.asarray(effect.factor(motion, force_n))


def _plateau_shapes(extent: Extent, shares: Sequence[float] = ()) -> list[Shape]:
    """Shapes of a plateau that are tried: load in N at position 0, free length in m and, with `shares`, a
    zero in N at each of these shares of the force's range. The load is such that the limit at the farthest
    position is a part (`_LIMITS`) of the highest force, less the zero.
    """
    low_n, high_n, high_m = extent.low_n, extent.high_n, extent.high_m
    lengths = [high_m + share * extent.range_m for share in _FREE if high_m + share * extent.range_m > 0.0]
    zeros: list[Shape] = [(low_n + share * (high_n - low_n),) for share in shares] or [()]
    return [
        (limit * (high_n - sum(zero)) * (1.0 - high_m / length_m) ** 2, length_m, *zero)
        for length_m, zero, limit in product(lengths, zeros, _LIMITS) if high_n > sum(zero)
    ]  # fmt: skip


class Buckling(FactorEffect):
    """`F <= euler_n_m2 / (free_length_m - x)^2`, euler_n_m2 = pi^2 EI / K^2: it bows out, and bears no more.

    The free length between gripper and sheath, of which at least a millimetre stays, gets shorter as the wire
    is pushed in. What is pushed in beyond goes into the bow and comes back from it. A pull has no limit.
    """

    name = "buckling"
    parameters = (
        Parameter("euler_n_m2", "N m^2", 1e3, 1e-12, 1e3, linear=False),
        Parameter("free_length_m", "m", 0.1, -10.0, 10.0, linear=False),
    )
    picture = "position"
    reference = "Euler, Methodus inveniendi lineas curvas, 1744; Timoshenko and Gere, Elastic Stability, 1961"
    fingerprint = "pushes, and no pulls, end at a plateau that is higher the further the wire is pushed in"
    words = "a wire that bows out between gripper and sheath"
    remedy = "shorten the free length, or lead the wire in a tube up to the sheath"
    candidates: ClassVar[Sequence[Candidate]] = (
        Bowed(shapes=("load_n", "free_length_m"), grid=_plateau_shapes),
        Bowed(
            form="offset", shapes=("load_n", "free_length_m", "zero_n"), by_tip=True,
            grid=lambda extent: _plateau_shapes(extent, _ZEROS),
        ),
    )  # fmt: skip
    equation = ("at most {euler_n_m2} / ({free_length_m} - x)^2",)

    def factor(self, m: Kinematics, force_n: Value) -> Value:
        """Share of the push that the wire bears, 1 below the limit."""
        limit_n = self.limit_n(m)
        return limit_n / (limit_n + m.positive(force_n - limit_n))

    def limit_n(self, m: Kinematics) -> Value:
        """Euler's load in N."""
        euler_n_m2, length_m = (self.values[p.name] for p in self.parameters)
        free_m = m.positive(length_m - m.x - _STRAIGHT_M) + _STRAIGHT_M
        return euler_n_m2 / (free_m * free_m)
