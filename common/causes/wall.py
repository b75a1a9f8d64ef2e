"""Wall: mass, damper, spring, stiffening, relaxation, a change, loss of contact, yield, prolapse."""

import numpy as np

from forefeel.common.causes.base import ContactEffect, ForceEffect, Parameter
from forefeel.common.causes.candidate import (
    Entry,
    Extent,
    Fitted,
    Form,
    Shape,
    Transmission,
    Values,
    entry,
    log_grid,
    two,
)
from forefeel.common.causes.motion import Kinematics, Lag, Most, MotionGrid, Relay, Value
from forefeel.common.causes.numerics import Array


class MassDamperSpring(ForceEffect):
    """`f = m a + b v + k x`."""

    name = "mass_damper_spring"
    site = "wall"
    parameters = (
        Parameter("mass_kg", "kg", 0.01, 0.0, 1e4),
        Parameter("damping_n_s_m", "N s/m", 0.1, 0.0, 1e6),
        Parameter("stiffness_n_m", "N/m", 1.0, -1e9, 1e9, explains=1.0),
    )
    reference = (
        "Study on Contact Force Prediction for the Vascular Interventional Surgical Robot "
        "Based on Parameter Identification, equation (1)"
    )
    fingerprint = "proportional to acceleration, velocity or position: ellipses without jumps or memory"

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        return m.a, m.v, m.x


_MOST = 50.0
"""Exponent at which the force is clipped: far outside of any tissue, and below an overflow."""


class ExponentialWall(ForceEffect):
    """`f = exponential_n (exp(x / L) - 1 - x / L)`, L = length_m.

    Fung's law without its linear part, which is the stiffness of `mass_damper_spring`; like that spring it
    acts on both sides of zero unless there is a `contact_loss`. To second and third order in x it is
    `stiffening`.
    """

    name = "exponential_wall"
    site = "wall"
    parameters = (
        Parameter("exponential_n", "N", 0.0, 0.0, 1e4),
        Parameter("length_m", "m", 0.01, 1e-9, 1e6, linear=False),
    )
    reference = "Fung, Elasticity of soft tissues in simple elongation, Am. J. Physiol. 213, 1967"
    fingerprint = "a curve over position that steepens without end, the same on the way in and out"

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        u = m.clip(m.x / self.values["length_m"], -_MOST, _MOST)
        return (m.expm1(u) - u,)


def _series(fitted: Fitted) -> Values:
    """Parameters of the exponential and the second and third order terms of its series."""
    (force_n,), (length_m,) = fitted.coefficients, fitted.shape
    return {
        "quadratic_n_m2": force_n / (2.0 * length_m**2), "cubic_n_m3": force_n / (6.0 * length_m**3),
        "exponential_n": force_n, "length_m": length_m,
    }  # fmt: skip


class Stiffening(ForceEffect):
    """`f = k2 x^2 + k3 x^3`."""

    name = "stiffening"
    site = "wall"
    parameters = (
        Parameter("quadratic_n_m2", "N/m^2", 0.0, -1e9, 1e9, explains=0.1),
        Parameter("cubic_n_m3", "N/m^3", 0.0, -1e12, 1e12, explains=0.1),
    )
    picture = "position"
    occasional = True
    reference = "polynomial restoring force, Duffing, Erzwungene Schwingungen, 1918"
    fingerprint = "a curve over position, the same on the way in and out and at any speed"
    words = "a spring whose stiffness changes with depth"
    equation = (
        "{quadratic_n_m2} x^2 + {cubic_n_m3} x^3",
        "{exponential_n} (exp(x/{length_m}) - 1)",
    )
    candidates = (
        Form(),
        Form(
            form="exponential", kind=ExponentialWall, shapes=("length_m",), naming=_series,
            grid=lambda e: log_grid(0.12 * e.reach_m, 1.5 * e.reach_m, 6), sizes=("exponential_n",),
        ),
    )  # fmt: skip

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        square = m.x * m.x
        return square, square * m.x


def _earlier(motion: MotionGrid, shape: Shape, _: Array) -> list[Array]:
    """Column exp(-t/tau) in the first piece, 0 after: rest of a stroke before the recording."""
    first = np.zeros_like(motion.x)
    first[motion.pieces[0]] = np.exp(-motion.t[motion.pieces[0]] / shape[0])
    return [first]


def _times(extent: Extent, count: int = 10) -> list[Shape]:
    return log_grid(2.0 / extent.cutoff_hz, 0.25 * extent.duration_s, count)


def _both(fitted: Fitted) -> Values:
    c, s = fitted.coefficients, fitted.shape
    return {
        "stiffness_n_m": c[0], "time_constant_s": s[0],
        "second_stiffness_n_m": c[2], "second_time_constant_s": s[1],
    }  # fmt: skip


def _branches(fitted: Fitted) -> list[Entry]:
    return [
        entry(StressRelaxation, {"stiffness_n_m": k, "time_constant_s": tau})
        for k, tau in zip(fitted.coefficients[::2], fitted.shape, strict=True)
    ]


class StressRelaxation(ForceEffect):
    """One Maxwell branch `df/dt = k v - f / tau`, k = stiffness_n_m, tau = time_constant_s.

    Its elongation q = f / k obeys `tau dq/dt = tau v - q`, solved exactly for a velocity constant over dt.
    A model may hold several branches.
    """

    name = "stress_relaxation"
    site = "wall"
    parameters = (
        Parameter("stiffness_n_m", "N/m", 1.0, 0.0, 1e9),
        Parameter("time_constant_s", "s", 1.0, 1e-4, 1e4, linear=False),
    )
    needs_spring = True
    reference = "Fung, Biomechanics: Mechanical Properties of Living Tissues, 2nd ed., chapter 2"
    fingerprint = (
        "an exponential fading during each hold, of opposite sign after a withdrawal; "
        "the loop is widest at one speed"
    )
    words = "a force that fades while the instrument is held"
    equation = ("{stiffness_n_m} z; z' = x' - z/{time_constant_s}",)
    candidates = (
        Form(shapes=("time_constant_s",), signs=(1, 0), beside=_earlier, grid=_times, at_start=(1,)),
        Form(
            form="two", plainer="", elements=2, values=lambda shape: {"time_constant_s": shape[0]},
            signs=(1, 0, 1, 0), beside=_earlier, grid=lambda extent: two(_times(extent, 6)), naming=_both,
            sizes=("stiffness_n_m",), making=_branches, at_start=(1, 3),
        ),
    )  # fmt: skip
    lag = Lag()

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        tau = self.values["time_constant_s"]
        return (m.through(self.lag, tau * m.rate, m.exp(-m.dt / tau)),)


def _instants(extent: Extent) -> list[Shape]:
    return [(float(t),) for t in np.linspace(0.0, extent.duration_s, 32)[2:-2]]


def _doubling(shape: Shape) -> Values:
    return {"time_s": shape[0], "ratio": 2.0}


def _ratio(fitted: Fitted) -> Values:
    change, stiffness = fitted.coefficients[0], fitted.base[2]
    return {
        "time_s": fitted.start_s + fitted.shape[0],
        "ratio": 1.0 + change / stiffness if stiffness else float("inf"),
    }


def _ratio_and_rest(fitted: Fitted) -> Values:
    change, level = fitted.coefficients
    return {**_ratio(fitted), "rest_position_m": -level / change if change else float("inf")}


def _change(fitted: Fitted) -> list[Entry]:
    """Returns one model.yaml entry, a `stiffness_change` from the stiffness of the fit, at least 1e-9 N/m. A
    second coefficient, a level in N, gives the rest position, else 0; time_s is a stamp of the recording.
    """
    stiffness = float(max(fitted.base[2], 1e-9))
    change, level = (*map(float, fitted.coefficients), 0.0)[:2]
    values = {
        "stiffness_n_m": stiffness,
        "time_s": fitted.start_s + fitted.shape[0],
        "ratio": 1.0 + change / stiffness,
        "rest_position_m": -level / change if change else 0.0,
    }
    return [entry(StiffnessChange, values)]


class StiffnessChange(ForceEffect):
    """Change of the wall's stiffness at `time_s`, by the factor `ratio`.

    It adds `f = stiffness_n_m (ratio - 1) (x - x0)` from `time_s` on. stiffness_n_m repeats the wall's before
    the change, whose spring is relaxed at x0 = rest_position_m; t counts from the caller's own zero.
    """

    name = "stiffness_change"
    site = "wall"
    parameters = (
        Parameter("stiffness_n_m", "N/m", 1.0, 1e-9, 1e9),
        Parameter("time_s", "s", 0.0, -1e9, 1e9, linear=False),
        Parameter("ratio", "", 1.0, 0.0, 1e3, linear=False),
        Parameter("rest_position_m", "m", 0.0, -1e6, 1e6, linear=False),
    )
    of_its_run = True
    clocked = True
    reference = "spring with a step in its stiffness; punctures: Okamura et al., IEEE T-BME 51(10), 2004"
    fingerprint = "nothing up to an instant, proportional to position from then on"
    words = "a stiffness that changes at an instant"
    candidates = (
        Form(values=_doubling, signs=(0,), logarithmic=False, grid=_instants, naming=_ratio, making=_change),
        Form(
            form="rest", values=_doubling, signs=(0, 0), logarithmic=False, grid=_instants,
            beside=lambda motion, shape, _: [np.asarray(motion.t >= shape[0], dtype=np.float64)],
            least_score=40.0, least_ratio=1.5,  # a stepping level fits a little of any slow change
            naming=_ratio_and_rest, making=_change,
        ),
    )  # fmt: skip

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        values = self.values
        return ((values["ratio"] - 1.0) * (m.x - values["rest_position_m"]) * (m.t >= values["time_s"]),)


def _places(extent: Extent) -> list[Shape]:
    """Contact positions that are tried; denser near the lowest, where it is lost for a moment only."""
    shares = (0.015, 0.035, *np.linspace(0.06, 0.85, 15))
    return [(extent.low_m + float(share) * extent.range_m,) for share in shares]


_RELEASES_S = 0.02, 0.06, 0.2  # s, damping over stiffness of tissue and vessels; chosen


class ContactLoss(ContactEffect):
    """Contact beyond `contact_position_m`; the wall's effects see the depth d beyond it as their position.

    A wall pushes and does not pull: contact is also lost while `d + release_s x' <= 0`, with release_s the
    wall's damping over its stiffness. With 0 it is lost by the position alone.
    """

    name = "contact_loss"
    parameters = (
        Parameter("contact_position_m", "m", 0.0, -1e6, 1e6, linear=False),
        Parameter("release_s", "s", 0.0, 0.0, 1e3, linear=False),
    )
    picture = "contact"
    reference = "Signorini's unilateral contact condition"
    fingerprint = "no force on one side of a position, a kink there, the model's force on the other side"
    words = "contact that begins at a certain position only"
    equation = (
        "x from the contact at {contact_position_m} m on, while x + {release_s} x' > {contact_position_m}",
        "x from the contact at {contact_position_m} m on",
    )
    candidates = (
        Transmission(shapes=("contact_position_m",), logarithmic=False, grid=_places),
        Transmission(
            form="carried", shapes=("contact_position_m",), logarithmic=False, grid=_places,
            mass_site="shaft",
        ),
        Transmission(
            form="dragging", shapes=("contact_position_m",), logarithmic=False, grid=_places,
            mass_site="shaft", drags=True, costly=True,
        ),
        Transmission(
            form="pushing", shapes=("contact_position_m", "release_s"), logarithmic=False,
            grid=lambda extent: [(*place, s) for place in _places(extent)[::2] for s in _RELEASES_S],
            mass_site="shaft", costly=True,
        ),
    )  # fmt: skip

    def _configure(self) -> None:
        self._position_m, self._release_s = self.values["contact_position_m"], self.values["release_s"]

    def contact(self, m: Kinematics) -> tuple[Value, Value]:
        """Returns (depth d in m, 1 while the wall pushes, else 0). It pushes while d and d + release_s x' are
        above 0; while not, the depth returned is 0 or less.
        """
        depth = m.x - self._position_m
        touching = m.above(depth)
        if self._release_s == 0.0:
            return depth, touching
        touching = touching * m.above(depth + self._release_s * m.v)
        return depth * touching, touching


def _yields(extent: Extent) -> list[Shape]:
    """Places where the wall begins, with depths from which it yields."""
    low, wide, depths = extent.low_m, extent.range_m, np.linspace(0.1, 0.95, 12).tolist()
    return [(low + p * wide, d * wide) for p in (0.0, 0.2, 0.45) for d in depths if p + d < 0.98]


def _moves_on(motion: MotionGrid, shape: Shape) -> bool:
    """True if a wall of that place and depth moves on by a twentieth of the travel."""
    return bool(np.max(motion.x) - sum(shape) > 0.05 * np.ptp(motion.x))


class YieldingWall(ForceEffect):
    """`f = k (x - x0 - p)` where positive; p grows so that f is `yield_n` at most.

    k = stiffness_n_m, x0 = contact_position_m. Linear in `yield_n` at the depth `yield_n / k`.
    """

    name = "yielding_wall"
    site = "shaft"
    parameters = (
        Parameter("yield_n", "N", 0.1, 1e-6, 1e4),
        Parameter("stiffness_n_m", "N/m", 50.0, 1e-6, 1e12, linear=False),
        Parameter("contact_position_m", "m", 0.0, -1e6, 1e6, linear=False),
    )
    picture = "memory"
    kin = "contact_loss"
    reference = "spring in series with dry friction, Prandtl, ZAMM 8(2), 1928, yielding to one side"
    fingerprint = "a plateau in strokes that go deeper than all before; later ones touch the wall deeper"
    words = "a wall that gives way for good where it is pushed too hard"
    remedy = "push less: the wall has moved on, and every later stroke meets it there"
    equation = (
        "{stiffness_n_m} max(x - {contact_position_m} - p, 0); p grows so that it is {yield_n} at most",
    )
    candidates = (
        Form(
            values=lambda s: {"yield_n": 1.0, "stiffness_n_m": 1.0 / s[1], "contact_position_m": s[0]},
            grid=_yields, logarithmic=False, sizes=("stiffness_n_m",), least_score=40.0, least_ratio=2.0,
            naming=lambda fit: {
                "yield_n": fit.coefficients[0], "stiffness_n_m": fit.coefficients[0] / fit.shape[1],
                "contact_position_m": fit.shape[0],
            },
            happens=_moves_on, costly=True,
        ),
    )  # fmt: skip
    most = Most()

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        yields_m = self.values["yield_n"] / self.values["stiffness_n_m"]
        depth = m.x - self.values["contact_position_m"]
        return (m.positive(depth - m.through(self.most, depth - yields_m)) / yields_m,)


def _let_goes(extent: Extent) -> list[Shape]:
    """Places where a tip lets go, with those where it stands again."""
    low, wide, places = extent.low_m, extent.range_m, (0.2, 0.35, 0.5, 0.65, 0.8, 0.92)
    return [(low + p * wide, low + share * p * wide) for p in places for share in (0.1, 0.3, 0.6)]


def _prolapse(fitted: Fitted) -> Values:
    """Parameters of a prolapse by name: stiffness, forces in N at which the wire folds and stands again, the
    share of the stiffness kept, and the rest position in m (infinite where no stiffness is lost).
    """
    (lost, level_n), (high_m, low_m), k = fitted.coefficients, fitted.shape, float(fitted.base[2])
    rest_m, share = low_m - level_n / lost if lost else np.inf, lost / k if k else np.inf
    return {
        "stiffness_n_m": k, "limit_n": k * (high_m - rest_m), "again_n": k * (low_m - rest_m),
        "kept": 1.0 - share, "rest_position_m": rest_m,
    }  # fmt: skip


def _state(motion: MotionGrid, shape: Shape) -> Array:
    return motion.through(Relay().step, motion.x, *shape)


def _lets_go_again(motion: MotionGrid, shape: Shape) -> bool:
    """True if it lets go twice, for once is a changed stiffness, and is unloaded by a tenth of the travel."""
    goes = np.diff(_state(motion, shape) > 0.5) & (np.diff(motion.x) > 0.0)
    return bool(np.count_nonzero(goes) > 1 and shape[0] - shape[1] > 0.1 * np.ptp(motion.x))


class Prolapse(ForceEffect):
    """Wall force k (x - x0), of which the share `kept` is left from `limit_n` on until it is below `again_n`.

    It adds `f = k (kept - 1) (x - x0)` then. k = stiffness_n_m repeats the wall's, x0 = rest_position_m.
    """

    name = "prolapse"
    site = "wall"
    parameters = (
        Parameter("stiffness_n_m", "N/m", 1.0, 1e-9, 1e9),
        Parameter("limit_n", "N", 1.0, 0.0, 1e4, linear=False),
        Parameter("again_n", "N", 0.1, 0.0, 1e4, linear=False),
        Parameter("kept", "", 0.5, 0.0, 0.9, linear=False),
        Parameter("rest_position_m", "m", 0.0, -1e6, 1e6, linear=False),
    )
    picture = "memory"
    reference = "relay, Krasnosel'skii and Pokrovskii, Systems with Hysteresis, 1989"
    fingerprint = "a fall of the force at a place on the way in, which comes back at another on the way out"
    words = "a wire that folds over above a force and stands again when it is unloaded"
    remedy = "stay below that force; draw back until the wire stands before the next push"
    equation = (
        "({kept} - 1) {stiffness_n_m} (x - {rest_position_m}) from {limit_n} N on, until {again_n} N",
    )
    candidates = (
        Form(
            values=lambda s: {
                "stiffness_n_m": 1.0, "limit_n": s[0] - s[1], "again_n": 0.0, "kept": 0.0,
                "rest_position_m": s[1],
            },
            beside=lambda motion, shape, _: [-_state(motion, shape)], signs=(1, 0),
            grid=_let_goes, logarithmic=False, naming=_prolapse, sizes=(), least_score=40.0, least_ratio=2.0,
            happens=_lets_go_again, costly=True,
        ),
    )  # fmt: skip
    relay = Relay()

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        values, k = self.values, self.values["stiffness_n_m"]
        depth = m.x - values["rest_position_m"]
        let_go = m.through(self.relay, depth, values["limit_n"] / k, values["again_n"] / k)
        return ((values["kept"] - 1.0) * depth * let_go,)
