"""Dry friction along the shaft: Coulomb, Stribeck, presliding, growing with depth."""

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.candidate import Entry, Extent, Fitted, Form, Shape, Values, entry, log_grid, two
from forefeel.common.causes.motion import Bristle, Kinematics, MotionGrid, PrandtlElement, Value
from forefeel.common.causes.numerics import Array

BREAKAWAY = Parameter("breakaway_m", "m", 0.0, 0.0, 1e6, linear=False)
"""Distance over which friction grows from 0 to its full size; 0: at once."""
# of the stroke, and their number; longer ones are described by presliding_hysteresis
_SHORTEST, _LONGEST, _LENGTHS = 1e-5, 6e-4, 4


def breakaways_m(extent: Extent, longest: float = _LONGEST, count: int = _LENGTHS) -> list[Shape]:
    return log_grid(_SHORTEST * extent.stroke_m, longest * extent.stroke_m, count)


class _AlongDirection(ForceEffect):
    """Friction along the direction s of the motion: sign(v); with a breakaway distance L the state
    `s <- clip(s + dx / L, -1, 1)`: the stiffness of load cell, holder and asperities.
    """

    rubs = True
    element = PrandtlElement()

    def _configure(self) -> None:
        self._breakaway_m = self.values["breakaway_m"]

    @property
    def remembers(self) -> bool:
        return self._breakaway_m > 0.0

    def direction(self, m: Kinematics) -> Value:
        """s, from -1 to 1; advances `element` if there is a breakaway distance and m is a sample."""
        if self._breakaway_m <= 0.0:
            return m.direction()
        return m.through(self.element, m.rate * m.dt / self._breakaway_m)


def _by_direction(fitted: Fitted) -> Values:
    forward_n, backward_n = fitted.coefficients
    return {"force_n": 0.5 * (forward_n + backward_n), "forward_n": forward_n, "backward_n": backward_n}


def _transitions(extent: Extent) -> list[Shape]:
    return log_grid(max(2e-3 * extent.speed_m_s, 4.0 * extent.speed_band), 0.2 * extent.speed_m_s, 6)


class CoulombFriction(_AlongDirection):
    """`f = forward_n` while inserting, `-backward_n` while retracting; `force_n` sets both.

    With a transition speed, and without a breakaway distance, the direction is `tanh(v / v_t)`: lubricated
    friction, and that of most simulators.
    """

    name = "coulomb_friction"
    site = "shaft"
    parameters = (
        Parameter("forward_n", "N", 0.0, 0.0, 1e4),
        Parameter("backward_n", "N", 0.0, 0.0, 1e4),
        BREAKAWAY,
        Parameter("transition_speed_m_s", "m/s", 0.0, 0.0, 1e5, linear=False),
    )
    shorthands = {"force_n": ("forward_n", "backward_n")}  # noqa: RUF012 - a ClassVar of the base
    picture = "speed"
    kin = "dry friction"
    reference = "Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30(7), 1994"
    fingerprint = "two levels by the sign of the velocity: a jump at each reversal, no growth with speed"
    words = "dry friction"
    equation = (
        "{force_n} s; ds = dx/{breakaway_m} within -1 to 1",
        "{force_n} tanh(x'/{transition_speed_m_s})",
        "{forward_n} [x' > 0] - {backward_n} [x' < 0]",
        "{force_n} sgn(x')",
    )
    candidates = (
        Form(coefficients=("force_n",), mix=((1, 1),), signs=(1,)),
        Form(form="asymmetric", naming=_by_direction, sizes=("force_n",)),
        Form(
            form="elastic", coefficients=("force_n",), mix=((1, 1),), shapes=("breakaway_m",), signs=(1,),
            grid=breakaways_m, costly=True,
        ),
        Form(
            form="smooth", coefficients=("force_n",), mix=((1, 1),), shapes=("transition_speed_m_s",),
            signs=(1,), grid=_transitions, costly=True,
        ),
    )  # fmt: skip

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        s = self.direction(m)
        return m.positive(s), m.negative(s)

    def direction(self, m: Kinematics) -> Value:
        speed_m_s = self.values["transition_speed_m_s"]
        if speed_m_s <= 0.0 or self.remembers:
            return super().direction(m)
        return m.tanh(m.v / speed_m_s)


def _speeds(extent: Extent) -> list[Shape]:
    return log_grid(max(0.02 * extent.speed_m_s, 4.0 * extent.speed_band), 0.4 * extent.speed_m_s, 6)


class StribeckFriction(_AlongDirection):
    """`f = (Fc + (Fs - Fc) exp(-(v / vs)^2)) sign(v)`.

    Fc = coulomb_n, Fs = static_n, vs = stribeck_velocity_m_s; linear in Fc and Fs.
    """

    name = "stribeck_friction"
    site = "shaft"
    parameters = (
        Parameter("coulomb_n", "N", 0.0, 0.0, 1e4),
        Parameter("static_n", "N", 0.0, 0.0, 1e4),
        Parameter("stribeck_velocity_m_s", "m/s", 0.005, 1e-9, 1e5, linear=False),
        BREAKAWAY,
    )
    picture = "speed"
    kin = "dry friction"
    reference = "Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30(7), 1994, Gaussian form"
    fingerprint = "two levels by the sign of the velocity with a peak at low speed that falls with speed"
    words = "dry friction that is larger at low speed"
    equation = (
        "s ({coulomb_n} + ({static_n} - {coulomb_n}) exp(-(x'/{stribeck_velocity_m_s})^2)); "
        "ds = dx/{breakaway_m} within -1 to 1",
        "sgn(x') ({coulomb_n} + ({static_n} - {coulomb_n}) exp(-(x'/{stribeck_velocity_m_s})^2))",
    )
    # the coefficients are Fc and Fs - Fc, both positive
    candidates = (
        Form(mix=((1, 1), (0, 1)), shapes=("stribeck_velocity_m_s",), grid=_speeds, sizes=("static_n",)),
        Form(
            form="exponential", mix=((1, 1),), shapes=("stribeck_velocity_m_s",), grid=_speeds,
            naming=lambda fitted: {
                "coulomb_n": fitted.coefficients[0], "static_n": float(np.sum(fitted.coefficients)),
                "stribeck_velocity_m_s": fitted.shape[0],
            },
            beside=lambda m, shape, _: [m.direction() * np.exp(-np.abs(m.v) / shape[0])],
            sizes=("static_n",),
        ),
        Form(
            form="elastic", mix=((1, 1), (0, 1)), shapes=("stribeck_velocity_m_s", "breakaway_m"),
            grid=lambda e: [(*speed, *length) for speed in _speeds(e)[::2] for length in breakaways_m(e)],
            sizes=("static_n",), costly=True,
        ),
    )  # fmt: skip

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        s, share = self.direction(m), m.v / self.values["stribeck_velocity_m_s"]
        static = s * m.exp(-share * share)
        return s - static, static


def _lengths(extent: Extent, count: int = 10) -> list[Shape]:
    return log_grid(0.003 * extent.stroke_m, 0.7 * extent.stroke_m, count)


def _unit(shape: Shape) -> Values:
    """A force of 1 N over a presliding length."""
    return {"force_n": 1.0, "stiffness_n_m": 1.0 / shape[0]}


def _sum(fitted: Fitted) -> Values:
    forces_n = fitted.coefficients[: len(fitted.shape)]
    return {"force_n": sum(forces_n), "stiffness_n_m": float(np.sum(forces_n / np.array(fitted.shape)))}


def _slip_elements(fitted: Fitted) -> list[Entry]:
    """Entries, one an element, of a generalised Maxwell slip (Al-Bender et al., IEEE T-AC 50(11), 2005)."""
    return [
        entry(PreslidingHysteresis, {"force_n": force_n, "stiffness_n_m": force_n / length_m})
        for force_n, length_m in zip(fitted.coefficients, fitted.shape, strict=True)
    ]


def _rates(motion: MotionGrid, _: Shape, phi: Array) -> list[Array]:
    """Rate of the bristles' deflection, as in the LuGre model: dphi/dt within each piece."""
    return [np.concatenate([np.gradient(phi[0][p], motion.t[p]) for p in motion.pieces])]


class PreslidingHysteresis(ForceEffect):
    """Dahl's model `df/dx = sigma (1 - (f / Fc) sign(v))`, Fc = force_n, sigma = stiffness_n_m.

    Rate independent. With u = f / Fc and travel d = |v| dt in direction s, exact at constant velocity:
    `u(t + dt) = s - (s - u(t)) exp(-sigma d / Fc)`. u depends on the presliding length Fc / sigma only, so
    the force is linear in `force_n` **at that length**: a fit of `force_n` alone scales the stiffness too.
    """

    name = "presliding_hysteresis"
    site = "shaft"
    parameters = (
        Parameter("force_n", "N", 0.01, 1e-6, 1e4),
        Parameter("stiffness_n_m", "N/m", 50.0, 1e-6, 1e12, linear=False),
    )
    picture = "reversal"
    kin = "dry friction"
    rubs = True
    reference = "Dahl, A Solid Friction Model, Aerospace Corporation TOR-0158(3107-18)-1, 1968"
    fingerprint = "a curve over the distance since the last reversal that saturates, the same at any speed"
    words = "friction that builds up over a distance after each reversal"
    equation = ("{force_n} u; {force_n} du/dx = {stiffness_n_m} (1 - u sgn(x'))",)
    bristle = Bristle()
    candidates = (
        Form(values=_unit, grid=_lengths, naming=_sum, sizes=("force_n",)),
        Form(
            form="bristles", signs=(1, 1), values=_unit, beside=_rates, grid=_lengths, naming=_sum,
            sizes=("force_n",),
        ),
        Form(
            form="two", plainer="", elements=2, signs=(1, 1), values=_unit,
            grid=lambda extent: two(_lengths(extent, 5)), naming=_sum, sizes=("force_n",),
            making=_slip_elements,
        ),
    )  # fmt: skip

    def _configure(self) -> None:
        self._per_m = self.values["stiffness_n_m"] / self.values["force_n"]

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        d = m.rate * m.dt * self._per_m
        return (m.through(self.bristle, d, m.exp(-abs(d))),)


def _build_ups(extent: Extent, count: int = 8) -> list[Shape]:
    """Lengths over which a shaft in a path lets go, one part after the other."""
    return breakaways_m(extent, 0.1, count)


def _parts(fitted: Fitted) -> Values:
    """Sum of two parts, and the mean of their breakaways by the growth."""
    growths, forces_n = np.reshape(fitted.coefficients, (2, 2)).T
    return {
        "force_per_length_n_m": float(np.sum(growths)), "force_n": float(np.sum(forces_n)),
        "breakaway_m": float(growths @ np.array(fitted.shape) / max(float(np.sum(growths)), 1e-300)),
    }  # fmt: skip


def _friction_entries(fitted: Fitted) -> list[Entry]:
    """Returns two `position_dependent_friction` entries of a model.yaml, one for each friction fitted."""
    growths, forces_n = np.reshape(fitted.coefficients, (2, 2)).T.tolist()
    names = "force_per_length_n_m", "force_n", "breakaway_m"
    return [
        entry(PositionDependentFriction, dict(zip(names, part, strict=True)))
        for part in zip(growths, forces_n, fitted.shape, strict=True)
    ]


class PositionDependentFriction(_AlongDirection):
    """`f = (force_n + force_per_length_n_m max(x, 0)) s`: the capstan's law to first order in the length.

    force_n: of what is inserted already where the position is 0.
    """

    name = "position_dependent_friction"
    site = "wall"
    parameters = (
        Parameter("force_per_length_n_m", "N/m", 0.0, 0.0, 1e6),
        Parameter("force_n", "N", 0.0, 0.0, 1e4, explains=0.01),
        BREAKAWAY,
    )
    picture = "direction"
    kin = "friction of the length"
    reference = "capstan (Euler-Eytelwein) equation, linearised in the length of contact"
    fingerprint = "a jump at each reversal that is larger the deeper the instrument is"
    words = "friction along the path, which grows with the inserted length"
    equation = (
        "({force_n} + {force_per_length_n_m} max(x, 0)) s; ds = dx/{breakaway_m} within -1 to 1",
        "{force_per_length_n_m} max(x, 0) s; ds = dx/{breakaway_m} within -1 to 1",
        "{force_per_length_n_m} max(x, 0) sgn(x')",
    )
    candidates = (
        Form(coefficients=("force_per_length_n_m",), mix=((1, 0),), signs=(1,)),
        Form(
            form="elastic", coefficients=("force_per_length_n_m",), mix=((1, 0),), signs=(1,),
            shapes=("breakaway_m",), grid=_build_ups,
        ),
        Form(
            form="level", plainer="elastic", coefficients=("force_per_length_n_m", "force_n"),
            mix=((1, 0), (0, 1)), signs=(1, 1), shapes=("breakaway_m",), grid=_build_ups,
            sizes=("force_per_length_n_m",),
        ),
        Form(
            form="two", plainer="level", elements=2, mix=((1, 0), (0, 1)), signs=(1, 1, 1, 1),
            values=lambda shape: {"breakaway_m": shape[0]}, grid=lambda extent: two(_build_ups(extent, 5)),
            naming=_parts, sizes=("force_per_length_n_m",), making=_friction_entries,
        ),
    )  # fmt: skip

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        s = self.direction(m)
        return m.depth * s, s
