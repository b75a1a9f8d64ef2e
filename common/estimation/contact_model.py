"""The contact model of the paper, extended by the causes of a vessel, as a list of causes.

    f = f0 + Fc u + [d > 0] (m x'' + b x' + k d + k2 d^2 + k3 d^3 + g d x' + (p0 + p d) s + c q + W)
    d = x - x0,   L du = (1 - u sgn(x')) dx,   l ds = dx within -1 <= s <= 1,   q' = x' - q / tau
    W = waves of heart (w_h and 2 w_h) and breath (w_b)

f is linear in theta: f0, Fc, m, b, p0, p, c, k, k2, k3, g and a sine and a cosine of each wave. It is not
linear in the shape: x0, log L, log tau, the frequencies of heart and breath, and log l. A model of a
diagnosis adds its other causes, whose shapes stay fixed.
"""

import re
from dataclasses import dataclass
from math import nan, pi, remainder
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from forefeel.common.causes.base import Effect, ForceEffect, Parameter
from forefeel.common.causes.damping import HuntCrossleyDamping
from forefeel.common.causes.friction import PositionDependentFriction, PreslidingHysteresis
from forefeel.common.causes.model import ContactModel, EffectEntry
from forefeel.common.causes.periodic import Pulsation
from forefeel.common.causes.registry import effect_class
from forefeel.common.causes.sensor import Bias
from forefeel.common.causes.wall import ContactLoss, MassDamperSpring, Stiffening, StressRelaxation
from forefeel.common.estimation.contact_loaded import BASE, LoadedCauses, loaded_causes
from forefeel.common.estimation.contact_prior import CONTACT, ContactPrior, exactly, joined, widened
from forefeel.common.estimation.path_force import PathForce

Array = NDArray[np.float64]

SHAPE = (
    CONTACT,
    "presliding_hysteresis.length_m",
    "stress_relaxation.time_constant_s",
    "heart.frequency_hz",
    "breath.frequency_hz",
    "position_dependent_friction.breakaway_m",
)
WAVES = ("heart.amplitude_n", "heart.second_harmonic_n", "breath.amplitude_n")
_PULSATIONS = Pulsation.name, *(f"{Pulsation.name}-{n}" for n in range(2, 2 * len(WAVES) + 1))
_BASE_NAMES = frozenset(kind.name for kind in BASE)
NOISE = "residual.rms_n"
_LOGARITHMIC = np.array([False, True, True, False, False, True])
# A little less than what the causes accept, in m, log m, log s and Hz; 2 w_h is a pulsation, too.
_LOWEST = np.array([-900.0, np.log(2e-9), np.log(2e-4), 0.06, 0.06, np.log(2e-9)])
_HIGHEST = np.array([900.0, np.log(900.0), np.log(9e3), 24.0, 49.0, np.log(900.0)])

# Shape without a prior; lengths relative to the range of motion.
_TYPICAL_BREAKAWAY = 0.001
_TYPICAL_S = 0.6  # s of relaxation
_TYPICAL_HZ = (1.2, 0.25)  # of heart and breath
_TYPICAL_SD = (1.5, 1.0, 0.15, 0.05, 1.5)  # of log L, log tau, the two frequencies and log l
# Least motion that determines a length, a speed or an acceleration: 0.1 mm at 10 rad/s.
_LEAST_RANGE_M, _LEAST_RATE_S = 1e-4, 10.0

# Part of `Parameter.explains` for a cause that a loaded model lacks, as its diagnosis has rejected it.
# Without, relaxation took half of a loaded resonance's stiffness in the first second: 35 mN rms for 6.
_UNNAMED = 0.1


class MotionExtent(NamedTuple):
    """Lowest and highest position of a motion in m."""

    low_m: float
    high_m: float

    @property
    def range_m(self) -> float:
        return self.high_m - self.low_m


@dataclass(frozen=True, eq=False)
class Belief:
    """Means and standard deviations of theta, shape and noise before any force; NaN where unknown. `path`:
    the force by place, None where unknown.
    """

    theta: Array
    theta_sd: Array
    shape: Array
    shape_sd: Array
    noise_n: float
    noise_sd_n: float
    path: PathForce | None = None

    def shape_of(self, motion: MotionExtent) -> tuple[Array, Array]:
        """Mean and standard deviation of the shape, typical ones for that motion where unknown."""
        mean, sd = typical_shape(motion)
        known = np.isfinite(self.shape)
        return np.where(known, self.shape, mean), np.where(known, self.shape_sd, sd)


def typical_shape(motion: MotionExtent) -> tuple[Array, Array]:
    """Mean and standard deviation of the shape without a prior, by the extent of the motion."""
    range_m = max(motion.range_m, _LEAST_RANGE_M)
    lengths = motion.low_m + 0.2 * range_m, np.log(0.01 * range_m)
    mean = np.array([*lengths, np.log(_TYPICAL_S), *_TYPICAL_HZ, np.log(_TYPICAL_BREAKAWAY * range_m)])
    return accepted(mean), np.array([range_m, *_TYPICAL_SD])


_STIFFNESS = "mass_damper_spring.stiffness_n_m"


class Causes:
    """Causes of the contact model, their parameters and names.

    Attributes:
        linear: `cause.parameter` of theta, in the order of the model's regressors.
        names: of all parameters: forces, waves by their amplitude, shape, and the rms of what is left.
        columns: what the loaded model follows beside the motion.
        forces: of theta: all but the waves, in the order of the names.
        positive: of theta: terms that have one sign only in a passive contact.
        occasional: of theta: terms that take part only if they explain enough.
        cold: standard deviation of each term before anything is known, over the spread of the force.
        least: rms of each regressor below which it does not determine its term.
    """

    def __init__(self, loaded: ContactModel | None = None) -> None:
        self._loaded = LoadedCauses((), {}) if loaded is None else loaded_causes(loaded)
        self.columns = () if loaded is None else loaded.columns
        # A loaded wall without a contact effect is touched everywhere.
        effects = () if loaded is None else loaded.effects
        kinds = [(entry.effect, effect_class(entry.effect)) for entry in effects]
        walls = [kind for _, kind in kinds if issubclass(kind, ForceEffect) and kind.site == "wall"]
        self._gated = not walls or any(kind is ContactLoss for _, kind in kinds)
        # A factor needs them for the sign of the force.
        self._linear: dict[str, dict[str, float]] = {}
        for name, value in self._loaded.means.items():
            effect, _, parameter = name.partition(".")
            if effect in _BASE_NAMES and any(
                p.linear and p.name == parameter for p in effect_class(effect).parameters
            ):
                self._linear.setdefault(effect, {})[parameter] = value
        runtime = self.model(typical_shape(MotionExtent(0.0, 0.0))[0], 0.0).runtime()
        self.linear = runtime.linear_names
        waves = [self.linear.index(f"{name}.amplitude_n") for name in _PULSATIONS]
        self._waves = np.array(waves).reshape(len(WAVES), 2)
        self.forces = [i for i in range(len(self.linear)) if i not in waves]
        self.names = (*(self.linear[i] for i in self.forces), *WAVES, *SHAPE, NOISE)
        away = self._loaded.means.get(_STIFFNESS, 0.0) < 0.0  # a weight that stands upright, a magnet
        self.positive = tuple(
            i
            for i in self.forces
            if _parameter(self.linear[i]).lower >= 0.0 or (self.linear[i] == _STIFFNESS and not away)
        )
        self.cold = np.array([_parameter(name).explains for name in self.linear])
        self.least = np.array([_least_rms(_parameter(name).unit) for name in self.linear])
        if loaded is not None:
            self.cold[[i for i, name in enumerate(self.linear) if self._unnamed(name)]] *= _UNNAMED
        self.occasional = tuple(i for i, name in enumerate(self.linear) if _kind(name).occasional)

    def model(self, shape: Array, origin_s: float) -> ContactModel:
        """Returns the causes as a contact model, with the parameters that the coordinates of a shape give.

        The contact effect, if any, comes first, the further effects of a loaded model last. Each wave is a
        sine, 0 at stamp `origin_s`, and its cosine.
        """
        contact_m, length_m, time_s, heart_hz, breath_hz, breakaway_m = shape_values(shape).tolist()
        waves = [
            EffectEntry(Pulsation.name, (("frequency_hz", hz), ("phase_rad", 2.0 * pi * turns)))
            for hz in (heart_hz, 2.0 * heart_hz, breath_hz)
            for turns in (remainder(lead - hz * origin_s, 1.0) for lead in (0.0, 0.25))
        ]
        # A scale: within it the cause accepts the stiffness of every length of an accepted shape.
        friction_n = min(max(self._loaded.means.get("presliding_hysteresis.force_n", 1.0), 1e-3), 1e3)
        hysteresis = {"force_n": friction_n, "stiffness_n_m": friction_n / length_m}
        gate = (self._entry(ContactLoss, contact_position_m=contact_m),) if self._gated else ()
        entries = (
            *gate,
            self._entry(Bias),
            self._entry(PreslidingHysteresis, **hysteresis),
            self._entry(PositionDependentFriction, breakaway_m=breakaway_m),
            self._entry(StressRelaxation, time_constant_s=time_s),
            self._entry(MassDamperSpring),
            self._entry(Stiffening),
            self._entry(HuntCrossleyDamping),
            *waves,
            *self._loaded.further,
        )
        return ContactModel("contact", entries)

    def _entry(self, kind: type[Effect], **values: float) -> EffectEntry:
        return EffectEntry(kind.name, tuple((self._linear.get(kind.name, {}) | values).items()))

    def _unnamed(self, linear: str) -> bool:
        """True if `linear`, `cause.parameter`, is of a wave or `BASE` effect that the loaded model lacks. The
        model has a wave, of heart or breath, if it gives its frequency; another effect, if any parameter. The
        bias and effects outside of `BASE` give False.
        """
        effect = linear.partition(".")[0]
        if effect in _PULSATIONS:
            wave = WAVES[_PULSATIONS.index(effect) // 2].partition(".")[0]
            return f"{wave}.frequency_hz" not in self._loaded.means
        named = {name.partition(".")[0] for name in self._loaded.means}
        return effect in _BASE_NAMES and effect != "bias" and effect not in named

    def with_loaded(self, prior: ContactPrior | None) -> ContactPrior | None:
        """The prior with the means of the loaded model, widened, that it lacks; None without either."""
        if not self._loaded.means:
            return prior
        loaded = widened(exactly(self._loaded.means), 1.0)
        return loaded if prior is None else joined(prior, loaded)

    def belief(self, prior: ContactPrior | None) -> Belief:
        """Returns the means and deviations of theta, shape and noise that a prior gives; NaN where unknown.

        An unknown theta has a mean of 0, and so have the sine and cosine of a wave, whose standard deviation
        is its size: its phase is not known. The presliding length, time constant and breakaway of the shape
        become logarithms.
        """
        n = len(self.linear)
        theta, theta_sd = np.zeros(n), np.full(n, nan)
        shape, shape_sd = np.full(len(SHAPE), nan), np.full(len(SHAPE), nan)
        if prior is None:
            return Belief(theta, theta_sd, shape, shape_sd, nan, nan)
        known = dict(zip(prior.names, zip(prior.values, prior.standard_deviations, strict=True), strict=True))
        for i in self.forces:
            if self.linear[i] in known:
                theta[i], theta_sd[i] = known[self.linear[i]]
        for pair, name in zip(self._waves, WAVES, strict=True):
            if name in known:
                theta_sd[pair] = np.hypot(*known[name])
        for i, name in enumerate(SHAPE):
            if name in known:
                value, sd = known[name]
                if _LOGARITHMIC[i]:  # a length or time of a file may be 0
                    value = max(value, float(np.exp(_LOWEST[i])))
                    shape[i], shape_sd[i] = np.log(value), sd / value
                else:
                    shape[i], shape_sd[i] = value, sd
        noise = known.get(NOISE, (nan, nan))
        return Belief(theta, theta_sd, accepted(shape), shape_sd, *noise, path=prior.path)

    def named(self, theta: Array, shape: Array, covariance: Array) -> tuple[Array, Array]:
        """Returns values, in SI units, and covariance of all `names` but the last, from theta and shape.

        `covariance`: of (theta, shape). A wave has sqrt(sine^2 + cosine^2), its variance to first order.
        """
        pairs = theta[self._waves]
        sizes = np.hypot(pairs[:, 0], pairs[:, 1])
        values = np.concatenate([theta[self.forces], sizes, shape_values(shape)])
        to = np.zeros((len(values), len(theta) + len(shape)))
        forces = len(self.forces)
        to[range(forces), self.forces] = 1.0
        for i, (pair, size) in enumerate(zip(self._waves, sizes, strict=True)):
            to[forces + i, pair] = theta[pair] / size if size > 0.0 else (1.0, 0.0)
        to[range(forces + len(sizes), len(values)), range(len(theta), to.shape[1])] = shape_slopes(shape)
        return values, to @ covariance @ to.T


def accepted(shape: Array) -> Array:
    """Clips a shape to the bounds of the causes."""
    return np.clip(shape, _LOWEST, _HIGHEST)


def shape_values(shape: Array) -> Array:
    """Values of a shape in the units of `SHAPE`."""
    return np.where(_LOGARITHMIC, np.exp(np.where(_LOGARITHMIC, shape, 0.0)), shape)


def shape_slopes(shape: Array) -> Array:
    """d value / d coordinate of a shape."""
    return np.where(_LOGARITHMIC, shape_values(shape), 1.0)


def _least_rms(unit: str) -> float:
    """Returns the rms of a regressor at the least motion, for a parameter in `unit`: N s^q / m^p, or kg. It
    is (0.1 mm)^p (10 / s)^q.
    """
    over, _, under = unit.replace("kg", "N s^2/m").partition("/")
    lengths, times = (
        sum(int(power or 1) for power in re.findall(pattern, text))
        for pattern, text in ((r"m\^?(\d?)", under), (r"s\^?(\d?)", over))
    )
    return _LEAST_RANGE_M**lengths * _LEAST_RATE_S**times


def _parameter(name: str) -> Parameter:
    """The linear parameter of that name."""
    return next(p for p in _kind(name).parameters if p.name == name.partition(".")[2])


def _kind(name: str) -> type[Effect]:
    """The cause of a linear parameter, such as `stress_relaxation-2.stiffness_n_m`."""
    return effect_class(name.partition(".")[0].partition("-")[0])
