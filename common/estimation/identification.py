"""From the slave's samples to an estimate of the contact model: filter, regressors, recursive least squares.

Pairs are formed by the slave's own time stamps: position and force of one instant pass the same filter (see
`state_filter`), the model's regressors see the filtered motion, and the delay of the network has no part in
it. A sensor that lags or delays does so to each regressor; at the end of its range nothing is learned.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite, pi, sin, sqrt

from forefeel.common.causes.base import ForceEffect
from forefeel.common.causes.model import SCHEMA, ContactModel
from forefeel.common.causes.registry import effect_class
from forefeel.common.estimation.identifiability import (
    Array,
    Identifiability,
    analyse,
    information,
    informed_directions,
)
from forefeel.common.estimation.rls import RecursiveLeastSquares
from forefeel.common.estimation.sensor_model import SensorModel
from forefeel.common.estimation.state_filter import GAP_S, StateFilter

_NOISE_BANDWIDTH = (pi / 6.0) / sin(pi / 6.0)
"""Noise bandwidth of a third-order Butterworth low-pass, in units of its cutoff."""

_SETTLING_PERIODS = 2.0
"""Periods of the cutoff after which a restarted filter is within 0.5 % of its course."""


@dataclass(frozen=True, slots=True)
class IdentificationSettings:
    """How contact is identified.

    Attributes:
        memory_s: time constant of forgetting.
        cutoff_hz: of the filter that motion and force pass.
        min_updates: informative samples before an estimate is valid.
        noise_floor_n: errors below it never count as another tissue.
        nominal_amplitude_m: typical stroke, sets the scales of the regressors.
        prior_variance: of the model's own values, for scaled regressors, in units of the noise variance.
        bounded: parameters keep to their physical bounds. Not for a recording, which may show the reaction.
    """

    memory_s: float = 2.0
    cutoff_hz: float = 10.0
    min_updates: int = 200
    noise_floor_n: float = 0.001
    nominal_amplitude_m: float = 0.005
    prior_variance: float = 100.0
    bounded: bool = True


@dataclass(frozen=True, slots=True)
class ContactEstimate:
    """The identified parameters, within their physical bounds.

    Attributes:
        names, values: the linear parameters, in the order of the model's regressors.
        standard_deviations: these know of noise and its correlation behind the filter, not of model errors.
        valid: finite, enough informative samples, and motion in them.
        samples: taken in. updates: informative ones since the last reset. resets: returns to the prior.
        innovation_rms_n: of the a priori errors within the memory.
        noise_variance_n2: of the filtered force, robust to outliers.
        origin_ns: stamp of the model's time t = 0.
    """

    names: tuple[str, ...]
    values: tuple[float, ...]
    standard_deviations: tuple[float, ...]
    valid: bool
    samples: int
    updates: int
    resets: int
    innovation_rms_n: float
    noise_variance_n2: float
    origin_ns: int


class ContactIdentifier:
    """Identifies the linear parameters of one contact model from irregular samples with gaps.

    Attributes:
        ignored: samples whose stamp did not increase. refused: samples that are not finite.

    Raises:
        ValueError: a model without linear parameters, or a setting out of its range.
    """

    def __init__(self, model: ContactModel, settings: IdentificationSettings) -> None:
        self._runtime = model.runtime()
        self._settings = settings
        self.names = self._runtime.linear_names
        if not self.names:
            raise ValueError(f"model {model.name!r}: no linear parameter to identify")
        self._rls = RecursiveLeastSquares(
            nominal_scales(model, settings.nominal_amplitude_m),
            settings.memory_s,
            prior=self._runtime.linear_values,
            prior_variance=settings.prior_variance,
            bounds=linear_bounds(model, self.names) if settings.bounded else None,
            noise_floor=settings.noise_floor_n,
        )
        self._position = StateFilter(settings.cutoff_hz)
        self._force = StateFilter(settings.cutoff_hz)
        self._sensor = SensorModel(model)
        self._lines = self._sensor.lines(len(self.names) if self._sensor.delays else 0)
        self._settling_s = _SETTLING_PERIODS / settings.cutoff_hz
        self.samples = self.ignored = self.refused = 0
        self._origin_ns = 0
        self._last_ns: int | None = None
        self._undisturbed_s = 0.0
        self._period_s = 0.0
        self._innovation_variance = 0.0

    def observe(self, stamp_ns: int, position_m: float, force_n: float) -> None:
        """Takes in one sample of the slave: position and force at the same instant of the slave's clock."""
        if not (isfinite(position_m) and isfinite(force_n)):
            self.refused += 1
            return
        last_ns = self._last_ns
        if last_ns is None:
            self._origin_ns = stamp_ns
        elif stamp_ns <= last_ns:
            self.ignored += 1
            return
        self.samples += 1
        self._last_ns = stamp_ns
        dt = inf if last_ns is None else (stamp_ns - last_ns) * 1e-9
        if dt > GAP_S:
            self._restart(position_m, force_n)
        else:
            self._advance((stamp_ns - self._origin_ns) * 1e-9, position_m, force_n, dt)

    def _restart(self, position_m: float, force_n: float) -> None:
        self._runtime.reset()
        self._lines = self._sensor.lines(len(self._lines))
        for state, value in ((self._position, position_m), (self._force, force_n)):
            state.reset()
            state.step(value, 0.0)
        self._undisturbed_s = 0.0

    def _advance(self, t: float, position_m: float, force_n: float, dt: float) -> None:
        x, v, a = self._position.step(position_m, dt)
        y, _, _ = self._force.step(force_n, dt)
        phi = self._runtime.regressors(t, x, v, a, dt)
        if self._lines:
            phi = [sense(t, value, dt) for sense, value in zip(self._lines, phi, strict=True)]
        self._undisturbed_s = 0.0 if self._sensor.at_limit(force_n) else self._undisturbed_s + dt
        if self._undisturbed_s < self._settling_s:
            return
        e = self._rls.update(phi, y, dt)
        if e is None:
            self.refused += 1
            return
        rate = dt / (dt + self._settings.memory_s)
        self._innovation_variance += rate * (e * e - self._innovation_variance)
        self._period_s += rate * (dt - self._period_s) if self._period_s else dt

    def estimate(self) -> ContactEstimate:
        """What is known now; some 100 us, for tens of calls per second."""
        rls = self._rls
        values, variance = rls.parameters, rls.noise_variance
        deviations = self._standard_deviations(variance)
        finite = all(map(isfinite, (*values, *deviations)))
        return ContactEstimate(
            names=self.names,
            values=values,
            standard_deviations=deviations,
            valid=finite and rls.updates >= self._settings.min_updates and self._excited(),
            samples=self.samples,
            updates=rls.updates,
            resets=rls.resets,
            innovation_rms_n=sqrt(self._innovation_variance),
            noise_variance_n2=variance,
            origin_ns=self._origin_ns,
        )

    def identifiability(self) -> Identifiability:
        """What the motion within the memory leaves undetermined, and which parameters it identifies."""
        return analyse(self._information(), self.names, self._rls.scales)

    def identifiable(self) -> tuple[str, ...]:
        """The statements of `identifiability`; empty when every parameter is identified."""
        return self.identifiability().statements

    def _information(self) -> Array:
        return information(self._rls.covariance, self._rls.prior_diagonal, self._rls.scales)

    def _excited(self) -> bool:
        """Standing still informs one direction only (the level of force): not enough for a model of
        motion."""
        return informed_directions(self._information()) >= min(2, len(self.names))

    def _standard_deviations(self, variance: float) -> tuple[float, ...]:
        """sqrt(diag P) times the noise, times the samples that share one independent value of the filtered
        noise."""
        shared = 1.0
        if self._period_s > 0.0:
            shared = max(1.0, 1.0 / (2.0 * _NOISE_BANDWIDTH * self._settings.cutoff_hz * self._period_s))
        covariance = self._rls.covariance
        return tuple(sqrt(variance * shared * covariance[i][i]) for i in range(len(covariance)))


def nominal_scales(model: ContactModel, amplitude_m: float) -> tuple[float, ...]:
    """rms of each regressor on a nominal motion: two sinusoids of 0.5 and 1.3 Hz, in contact, free of play.

    A regressor that this motion does not excite has scale 1.
    """
    forces = tuple(entry for entry in model.effects if issubclass(effect_class(entry.effect), ForceEffect))
    runtime = ContactModel(model.name, forces).runtime()
    dt, steps = 0.01, 1000
    squares = [0.0] * len(runtime.linear_names)
    for step in range(1, steps + 1):
        t = step * dt
        for i, phi in enumerate(runtime.regressors(t, *_nominal_motion(t, amplitude_m), dt)):
            squares[i] += phi * phi
    return tuple(sqrt(total / steps) or 1.0 for total in squares)


def _nominal_motion(t: float, amplitude_m: float) -> tuple[float, float, float]:
    """(x, v, a), 0 <= x <= 2 amplitude."""
    w1, w2, half = 2.0 * pi * 0.5, 2.0 * pi * 1.3, 0.5 * amplitude_m
    s1, s2, c1, c2 = sin(w1 * t), sin(w2 * t), sin(w1 * t + 0.5 * pi), sin(w2 * t + 0.5 * pi)
    return amplitude_m + half * (s1 + s2), half * (w1 * c1 + w2 * c2), -half * (w1 * w1 * s1 + w2 * w2 * s2)


def linear_bounds(model: ContactModel, names: Sequence[str]) -> tuple[tuple[float, float], ...]:
    """(lower, upper) of each linear parameter of the model, by its runtime name `effect.parameter` or
    `effect-2.parameter`."""
    bounds: dict[str, tuple[float, float]] = {}
    for entry in model.effects:
        for parameter in effect_class(entry.effect).parameters:
            bounds[f"{entry.effect}.{parameter.name}"] = (parameter.lower, parameter.upper)
    return tuple(bounds[name if name in bounds else _unnumbered(name)] for name in names)


def _unnumbered(name: str) -> str:
    effect, _, parameter = name.rpartition(".")
    return f"{effect.rpartition('-')[0]}.{parameter}"


_LINEAR = (
    {
        "effect": "mass_damper_spring",
        "parameters": {"mass_kg": 0.0, "damping_n_s_m": 0.0, "stiffness_n_m": 0.0},
    },
    {"effect": "bias", "parameters": {"force_n": 0.0}},
)
_FRICTION = {"effect": "presliding_hysteresis", "parameters": {"force_n": 0.001, "stiffness_n_m": 4.0}}


def default_model() -> ContactModel:
    """`linear_model` and friction over 0.25 mm since a reversal, which saves a third of the error on the
    simulated catheter. The values are where learning starts.
    """
    return _model("m, b, k, bias and friction", (*_LINEAR, _FRICTION))


def linear_model() -> ContactModel:
    """Equation (1) of the paper and the bias that every load cell has; learning starts at zero."""
    return _model("m, b, k and bias", _LINEAR)


def _model(name: str, effects: Sequence[object]) -> ContactModel:
    return ContactModel.from_mapping({"schema": SCHEMA, "name": name, "effects": list(effects)})
