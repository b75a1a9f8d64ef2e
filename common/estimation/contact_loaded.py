"""What a model.yaml adds to the causes of `contact_model`: further ones, and means for those that both know.

A bias, a phase and the instant of a change belong to the run that they were found in, and so do the grid of
steps and the instants of spikes. Of a drift and of a wave it is known that they are there, and how fast the
wave is: their sizes are told anew.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import pi

from forefeel.common.causes.base import ForceEffect
from forefeel.common.causes.model import ContactModel, EffectEntry
from forefeel.common.causes.periodic import PeriodicForce
from forefeel.common.causes.registry import effect_class

OWN = (
    "contact_loss",
    "bias",
    "presliding_hysteresis",
    "position_dependent_friction",
    "stress_relaxation",
    "mass_damper_spring",
    "stiffening",
    "hunt_crossley_damping",
)
"""The causes of `contact_model` but its waves."""
OF_ITS_RUN = ("sensor_quantisation", "sensor_spikes", "stiffness_change")
TOLD_ANEW = ("bias", "sensor_drift")
_LEAST_RATIO = 0.02  # a harmonic below this part of its fundamental is not told from noise
_WAVES_HZ = {"heart": (0.6, 3.0), "breath": (0.1, 0.6)}  # of adults at rest and at work


@dataclass(frozen=True)
class LoadedCauses:
    """`further`: causes that are not among `OWN`, or are there once more or elsewhere. `means`: by the names
    of a `ContactPrior`.
    """

    further: tuple[EffectEntry, ...]
    means: Mapping[str, float]


def loaded_causes(model: ContactModel) -> LoadedCauses:
    """What holds for another run."""
    further: list[EffectEntry] = []
    means: dict[str, float] = {}
    count = Counter(OWN)
    shared: set[str] = set()
    for entry in model.effects:
        name, kind, values = entry.effect, effect_class(entry.effect), dict(entry.parameters)
        elsewhere = issubclass(kind, ForceEffect) and entry.site not in (None, kind.site)
        if name in OF_ITS_RUN:
            continue
        if issubclass(kind, PeriodicForce):
            wave = next(
                (w for w, (low, high) in _WAVES_HZ.items() if low <= values["frequency_hz"] < high), ""
            )
            if name == "pulsation" and wave and f"{wave}.frequency_hz" not in means:
                means |= _of_wave(wave, values)
            else:
                further += _sines(entry, values)
        elif name in OWN and name not in shared and not elsewhere:
            shared.add(name)
            means |= _of_shared(name, values) if name not in TOLD_ANEW else {}
        else:
            count[name] += 1
            label = name if count[name] == 1 else f"{name}-{count[name]}"
            further.append(entry)
            if issubclass(kind, ForceEffect) and name != "sensor_drift":
                means |= {f"{label}.{p.name}": values[p.name] for p in kind.parameters if p.linear}
    return LoadedCauses(tuple(further), means)


def _of_shared(name: str, values: Mapping[str, float]) -> dict[str, float]:
    """Means of a cause that is among `OWN`; a part that is 0 is not known, but for that of a curve."""
    linear = [p.name for p in effect_class(name).parameters if p.linear]
    means = {key: values[key] for key in linear if values[key] or name == "stiffening"}
    if name == "contact_loss":
        means["contact_position_m"] = values["contact_position_m"]
    elif name == "presliding_hysteresis":
        means["length_m"] = values["force_n"] / values["stiffness_n_m"]
    elif name == "stress_relaxation":
        means["time_constant_s"] = values["time_constant_s"]
    return {f"{name}.{key}": value for key, value in means.items()}


def _of_wave(wave: str, values: Mapping[str, float]) -> dict[str, float]:
    means = {f"{wave}.frequency_hz": values["frequency_hz"], f"{wave}.amplitude_n": values["amplitude_n"]}
    if wave == "heart":
        means["heart.second_harmonic_n"] = values["amplitude_n"] * values["second_harmonic_ratio"]
    return {name: abs(value) for name, value in means.items() if value}


def _sines(entry: EffectEntry, values: Mapping[str, float]) -> Iterator[EffectEntry]:
    """A sine and a cosine of each of a wave's frequencies."""
    ratios = 1.0, values["second_harmonic_ratio"], values["third_harmonic_ratio"]
    for order, ratio in enumerate(ratios, 1):
        for phase_rad in (0.0, 0.5 * pi) if abs(ratio) > _LEAST_RATIO else ():
            wave = ("frequency_hz", order * values["frequency_hz"]), ("phase_rad", phase_rad)
            yield EffectEntry(entry.effect, wave, entry.site)
