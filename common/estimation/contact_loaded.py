"""Causes that a model.yaml adds to those of `contact_model`, and means for those in both.

A bias, a phase, the instant of a change, the grid of steps and the instants of spikes hold for their own run
only. A drift is taken over without its size, a wave with its frequency; a wave other than heart and breath
is learned anew in size.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import pi

from forefeel.common.causes.base import Effect, ForceEffect
from forefeel.common.causes.damping import HuntCrossleyDamping
from forefeel.common.causes.friction import PositionDependentFriction, PreslidingHysteresis
from forefeel.common.causes.model import ContactModel, EffectEntry
from forefeel.common.causes.periodic import PeriodicForce, Pulsation
from forefeel.common.causes.registry import effect_class
from forefeel.common.causes.sensor import Bias
from forefeel.common.causes.wall import ContactLoss, MassDamperSpring, Stiffening, StressRelaxation

BASE: tuple[type[Effect], ...] = (
    ContactLoss, Bias, PreslidingHysteresis, PositionDependentFriction, StressRelaxation, MassDamperSpring,
    Stiffening, HuntCrossleyDamping,
)  # fmt: skip
"""The causes of `contact_model` but its waves."""
_SEARCHED: Mapping[type[Effect], str] = {
    ContactLoss: "contact_position_m", StressRelaxation: "time_constant_s",
}  # fmt: skip
_LEAST_RATIO = 0.02  # a harmonic below this part of its fundamental is lost in noise
_WAVES_HZ = {"heart": (0.6, 3.0), "breath": (0.1, 0.6)}  # of adults at rest and at work


@dataclass(frozen=True)
class LoadedCauses:
    """`further`: causes not in `BASE`, elsewhere, or a second time. `means`: by names of a `ContactPrior`."""

    further: tuple[EffectEntry, ...]
    means: Mapping[str, float]


def loaded_causes(model: ContactModel) -> LoadedCauses:
    """Splits a model into `further` effects and `means`; leaves out what holds for its own run only.

    Means: of the first effect of each kind in `BASE` at its own site, and of the first wave in the range of
    heart and of breath. Other waves are further, as sines and cosines without size; all else is further, the
    linear parameters of its forces are means. A kind that is `sized_anew` gives no means.
    """
    further: list[EffectEntry] = []
    means: dict[str, float] = {}
    count = Counter(kind.name for kind in BASE)
    shared: set[type[Effect]] = set()
    for entry in model.effects:
        name, kind, values = entry.effect, effect_class(entry.effect), dict(entry.parameters)
        elsewhere = issubclass(kind, ForceEffect) and entry.site not in (None, kind.site)
        if kind.of_its_run:
            continue
        if issubclass(kind, PeriodicForce):
            wave = next(
                (w for w, (low, high) in _WAVES_HZ.items() if low <= values["frequency_hz"] < high), ""
            )
            if issubclass(kind, Pulsation) and wave and f"{wave}.frequency_hz" not in means:
                means |= _of_wave(wave, values)
            else:
                further += _sines(Pulsation.name if issubclass(kind, Pulsation) else name, entry, values)
        elif kind in BASE and kind not in shared and not elsewhere:
            shared.add(kind)
            means |= {} if kind.sized_anew else _base_means(kind, values)
        else:
            count[name] += 1
            label = name if count[name] == 1 else f"{name}-{count[name]}"
            further.append(entry)
            if issubclass(kind, ForceEffect) and (kind in BASE or not kind.sized_anew):
                means |= {f"{label}.{p.name}": values[p.name] for p in kind.parameters if p.linear}
    return LoadedCauses(tuple(further), means)


def _base_means(kind: type[Effect], values: Mapping[str, float]) -> dict[str, float]:
    """Returns the means, by `cause.parameter`, of an effect in `BASE`: linear parameters and one of shape.
    Leaves out a linear parameter of 0, unless it may be negative. That of shape is the presliding length,
    place of the contact, time constant or, unless 0, breakaway; other kinds have none.
    """
    linear = [p for p in kind.parameters if p.linear]
    means = {p.name: values[p.name] for p in linear if values[p.name] or p.lower < 0.0}
    if kind is PreslidingHysteresis:
        means["length_m"] = values["force_n"] / values["stiffness_n_m"]
    elif kind in _SEARCHED:
        means[_SEARCHED[kind]] = values[_SEARCHED[kind]]
    elif kind is PositionDependentFriction and values["breakaway_m"]:
        means["breakaway_m"] = values["breakaway_m"]
    return {f"{kind.name}.{key}": value for key, value in means.items()}


def _of_wave(wave: str, values: Mapping[str, float]) -> dict[str, float]:
    means = {f"{wave}.frequency_hz": values["frequency_hz"], f"{wave}.amplitude_n": values["amplitude_n"]}
    if wave == "heart":
        means["heart.second_harmonic_n"] = values["amplitude_n"] * values["second_harmonic_ratio"]
    return {name: abs(value) for name, value in means.items() if value}


def _sines(name: str, entry: EffectEntry, values: Mapping[str, float]) -> Iterator[EffectEntry]:
    """Yields a sine and a cosine, as effects `name`, of each harmonic of a wave; leaves out those that
    are negligible, or beyond the frequencies of that effect.
    """
    upper_hz = next(p.upper for p in effect_class(name).parameters if p.name == "frequency_hz")
    ratios = 1.0, values["second_harmonic_ratio"], values["third_harmonic_ratio"]
    for order, ratio in enumerate(ratios, 1):
        frequency_hz = order * values["frequency_hz"]
        if abs(ratio) <= _LEAST_RATIO or frequency_hz > upper_hz:
            continue
        for phase_rad in (0.0, 0.5 * pi):
            wave = ("frequency_hz", frequency_hz), ("phase_rad", phase_rad)
            yield EffectEntry(name, wave, entry.site)
