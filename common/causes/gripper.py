"""Wire between gripper and sheath: it slips through the jaws, or bows out under a push."""

from math import copysign
from typing import ClassVar

from forefeel.common.causes.base import FactorEffect, MotionEffect, Parameter
from forefeel.common.causes.motion import Kinematics, Memory, Value
from forefeel.common.causes.numerics import Array, loop

SLIP_M_S = 0.15
"""Speed of a jump: a sliding friction of .1 to .5 N less than the holding force, on some 2 N s/m; chosen."""
_STRAIGHT_M = 1e-3  # m that are free at least: Euler's load has no bound where nothing is free


class Slip(Memory):
    """(Way slipped through the jaws, way of this step) in m; back is positive, as the force that pushes back.

    Above `holding_n` the wire jumps by `jump_m`, at most `reach_m` a step, whatever the force meanwhile.
    With a `jump_m` of 0 it creeps by `per_n` for each N above.
    """

    start = 0.0, 0.0

    def step(
        self, force_n: float, holding_n: float, jump_m: float, reach_m: float, per_n: float
    ) -> tuple[float, float]:
        slipped_m, left_m = self.value
        over_n = abs(force_n) - holding_n
        if left_m == 0.0 and over_n > 0.0:
            left_m = copysign(jump_m or over_n * per_n, force_n)
        way_m = min(max(left_m, -reach_m), reach_m)
        self.value = slipped_m + way_m, left_m - way_m if jump_m else 0.0
        return slipped_m + way_m, way_m

    @staticmethod
    def run(force_n: Array, holding_n: Array, jump_m: Array, reach_m: Array, per_n: Array) -> Array:
        return loop("slip", force_n, holding_n, jump_m, reach_m, per_n, outputs=2)


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
    reference = (
        "Coulomb's law at the jaws; creep: Bingham, Fluidity and Plasticity, 1922, a rate by what exceeds a "
        "limit"
    )
    fingerprint = "the force gives way above a limit, and all positions count from another zero afterwards"
    words = "a wire that slips through the gripper"
    remedy = "close the gripper harder or clean its jaws; what has slipped is lost to every position since"
    equation: ClassVar[tuple[str, ...]] = (
        "x less {slipped_m} m each time that the jaws' force passes {holding_n} N",
        "x less a creep of (F - {holding_n}) / {creep_n_s_m} m/s above {holding_n} N",
    )

    slip = Slip()

    def moved(self, m: Kinematics) -> Kinematics:
        """Instrument's motion for the stage's m, whose `force` is that at the jaws."""
        holding_n, jump_m, creep_n_s_m = (self.values[p.name] for p in self.parameters)
        reach_m, per_n = SLIP_M_S * m.dt, m.dt / creep_n_s_m
        slipped_m, way_m = m.through(self.slip, m.force, holding_n, jump_m, reach_m, per_n)
        least_s = 1e-12  # before the first sample no time has passed, and no way has been gone
        return m.along(m.x - slipped_m, m.v - way_m / (m.positive(m.dt - least_s) + least_s), m.a)


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
    equation = ("at most {euler_n_m2} / ({free_length_m} - x)^2",)

    def factor(self, m: Kinematics, force_n: Value) -> Value:
        """Share of the push that the wire bears, 1 below the limit."""
        euler_n_m2, length_m = (self.values[p.name] for p in self.parameters)
        free_m = m.positive(length_m - m.x - _STRAIGHT_M) + _STRAIGHT_M
        limit_n = euler_n_m2 / (free_m * free_m)
        return limit_n / (limit_n + m.positive(force_n - limit_n))
