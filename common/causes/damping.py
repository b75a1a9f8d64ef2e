"""Forces of the speed: viscous by direction, drag with its square, damping that grows with depth."""

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.candidate import Fitted, Form, Values
from forefeel.common.causes.motion import Kinematics, Value


def _by_direction(fitted: Fitted) -> Values:
    (more,), damping = fitted.coefficients, fitted.base[1]
    return {"forward_n_s_m": damping + more, "backward_n_s_m": damping - more}


class AsymmetricDamping(ForceEffect):
    """`f = forward_n_s_m v` while inserting, `backward_n_s_m v` while retracting.

    It adds to the `damping_n_s_m` of a `mass_damper_spring`. Only the sums of that one and these are
    determined: where the damping is 0, these are the coefficients by direction.
    """

    name = "asymmetric_damping"
    site = "shaft"
    parameters = (
        Parameter("forward_n_s_m", "N s/m", 0.0, 0.0, 1e6),
        Parameter("backward_n_s_m", "N s/m", 0.0, 0.0, 1e6),
    )
    picture = "speed"
    instead_of = "damping_n_s_m"
    reference = "Janot, Gautier and Brunot, Data Set and Reference Models of EMPS, 2019, asymmetric friction"
    fingerprint = "two slopes over velocity that meet at rest: a share proportional to |v|"
    words = "damping that differs by direction"
    equation = ("{forward_n_s_m} max(x', 0) + {backward_n_s_m} min(x', 0)",)
    candidates = (Form(mix=((1, -1),), signs=(0,), site="wall", naming=_by_direction),)

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        return m.positive(m.v), m.negative(m.v)


class QuadraticDrag(ForceEffect):
    """`f = drag_n_s2_m2 v |v|`."""

    name = "quadratic_drag"
    site = "shaft"
    parameters = (Parameter("drag_n_s2_m2", "N s^2/m^2", 0.0, 0.0, 1e9),)
    picture = "speed"
    reference = "Newton's law of drag, Batchelor, An Introduction to Fluid Dynamics, 1967"
    fingerprint = "odd in the velocity and growing with its square, without a jump at rest"
    words = "drag with the square of the speed"
    equation = ("{drag_n_s2_m2} x' |x'|",)
    candidates = (Form(),)

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        return (m.v * abs(m.v),)


class HuntCrossleyDamping(ForceEffect):
    """`f = damping_n_s_m2 max(x, 0) v`: without a jump of force where the contact begins.

    The damping part of Hunt and Crossley's law for a linear spring, whose elastic part the model has already.
    """

    name = "hunt_crossley_damping"
    site = "wall"
    parameters = (Parameter("damping_n_s_m2", "N s/m^2", 0.0, 0.0, 1e9),)
    picture = "depth"
    occasional = True
    reference = "Hunt and Crossley, Coefficient of Restitution Interpreted as Damping, J. Appl. Mech. 42(2)"
    fingerprint = "proportional to speed, and more so the deeper: a loop that widens with depth and speed"
    words = "damping that grows with depth"
    equation = ("{damping_n_s_m2} max(x, 0) x'",)
    candidates = (Form(),)

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        return (m.depth * m.v,)
