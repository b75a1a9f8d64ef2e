"""The extended model: the causes found as effects of a model.yaml, which the slave and the predictor load.

Times are the recording's own stamps. Where the recording shows the reaction the force is turned: positive
resists.
"""

from collections.abc import Callable

import numpy as np

from forefeel.common.effects.mains_hum import MainsHum
from forefeel.common.effects.model import SCHEMA, ContactModel
from forefeel.common.effects.pulsation import Pulsation
from forefeel.common.effects.registry import OWN
from forefeel.common.effects.stiffness_change import StiffnessChange
from forefeel.common.error_size import Floats
from forefeel.diagnosis.diagnose.analysis import Analysis
from forefeel.diagnosis.diagnose.candidates import Shape
from forefeel.diagnosis.diagnose.faults import Fault
from forefeel.diagnosis.diagnose.regression import ModelFit

Entry = dict[str, object]
Make = Callable[[Floats, Shape, Floats, float], list[Entry]]
"""Coefficients, shape, (m, b, k), stamp of the start -> entries."""

FIXTURE = "unmodelled_resonance:fixture"
_ORDER = "bias", "sensor_drift", "mains_hum"


def entry(effect: str, **parameters: float) -> Entry:
    """One effect, its parameters within the effect's bounds."""
    bounds = {p.name: (p.lower, p.upper) for p in OWN[effect].parameters}
    values = {
        name: float(np.clip(value, *bounds[name])) if name in bounds else float(value)
        for name, value in parameters.items()
    }
    return {"effect": effect, "parameters": values}


def _branches(c: Floats, s: Shape, base: Floats, start: float) -> list[Entry]:
    return [
        entry("stress_relaxation", stiffness_n_m=k, time_constant_s=tau)
        for k, tau in zip(c[::2], s, strict=True)
    ]


def _drift(c: Floats, s: Shape, base: Floats, start: float) -> list[Entry]:
    rate = c[0] if not s else c[0] / s[0]
    shift = [] if not start else [entry("bias", force_n=-rate * start)]
    return [entry("sensor_drift", rate_n_s=rate), *shift]


def _pulses(c: Floats, s: Shape, base: Floats, start: float) -> list[Entry]:
    return [_periodic(Pulsation, c, s[0], start)]


def _periodic(kind: type[Pulsation] | type[MainsHum], c: Floats, frequency_hz: float, start: float) -> Entry:
    """sin and cos of three harmonics since the start, as amplitude, ratios and phases by the stamp."""
    wave = c[:3] + 1j * c[3:]  # sin + i cos: amplitude times exp(i phase) of a sine
    wave = wave * np.exp(-2j * np.pi * frequency_hz * start * np.arange(1, 4))
    size = float(abs(wave[0])) or 1e-300
    wrapped = np.angle(wave)
    values = {
        "amplitude_n": size,
        "frequency_hz": frequency_hz,
        "phase_rad": wrapped[0],
        "second_harmonic_ratio": abs(wave[1]) / size,
        "second_harmonic_phase_rad": wrapped[1] - 2.0 * wrapped[0],
        "third_harmonic_ratio": abs(wave[2]) / size,
        "third_harmonic_phase_rad": wrapped[2] - 3.0 * wrapped[0],
    }
    known = {p.name for p in kind.parameters}
    for key in ("second_harmonic_phase_rad", "third_harmonic_phase_rad"):
        values[key] = float(np.angle(np.exp(1j * values[key])))
    return entry(kind.name, **{key: float(value) for key, value in values.items() if key in known})


def _mode(c: Floats, s: Shape, base: Floats, start: float) -> list[Entry]:
    w = 2.0 * np.pi * s[0]
    damper = c[1] if len(c) > 1 else 2.0 * s[1] * c[0]
    return [
        entry(
            "unmodelled_resonance",
            stiffness_n_m=c[0] * w * w,
            damping_n_s_m=damper * w,
            frequency_hz=s[0],
            damping_ratio=s[1],
        )
    ]


def _change(c: Floats, s: Shape, base: Floats, start: float) -> list[Entry]:
    k = float(max(base[2], 1e-9))
    kind = StiffnessChange(stiffness_n_m=k, time_s=start + s[0])
    values = kind.from_span([float(c[0]), 0.0])
    return [entry("stiffness_change", **values)]


MAKERS: dict[str, Make] = {
    "bias": lambda c, s, b, t: [entry("bias", force_n=c[0])],
    "coulomb_friction": lambda c, s, b, t: [entry("coulomb_friction", forward_n=c[0], backward_n=c[0])],
    "coulomb_friction:asymmetric": lambda c, s, b, t: [
        entry("coulomb_friction", forward_n=c[0], backward_n=c[1])
    ],
    "stribeck_friction": lambda c, s, b, t: [
        entry("stribeck_friction", coulomb_n=c[0], static_n=c[0] + c[1], stribeck_velocity_m_s=s[0])
    ],
    "stribeck_friction:exponential": lambda c, s, b, t: [
        entry("stribeck_friction", coulomb_n=c[0], static_n=c[0] + c[1], stribeck_velocity_m_s=s[0])
    ],
    "presliding_hysteresis": lambda c, s, b, t: [
        entry("presliding_hysteresis", force_n=c[0], stiffness_n_m=c[0] / s[0])
    ],
    "presliding_hysteresis:bristles": lambda c, s, b, t: [
        entry("presliding_hysteresis", force_n=c[0], stiffness_n_m=c[0] / s[0])
    ],
    "presliding_hysteresis:two": lambda c, s, b, t: [
        entry("presliding_hysteresis", force_n=f, stiffness_n_m=f / length)
        for f, length in zip(c, s, strict=True)
    ],
    "backlash": lambda c, s, b, t: [entry("backlash", width_m=s[0])],
    "stiffening": lambda c, s, b, t: [entry("stiffening", quadratic_n_m2=c[0], cubic_n_m3=c[1])],
    "stiffening:exponential": lambda c, s, b, t: [
        entry("exponential_wall", exponential_n=c[0], length_m=s[0])
    ],
    "hunt_crossley_damping": lambda c, s, b, t: [entry("hunt_crossley_damping", damping_n_s_m2=c[0])],
    "quadratic_drag": lambda c, s, b, t: [entry("quadratic_drag", drag_n_s2_m2=c[0])],
    "stress_relaxation": _branches,
    "stress_relaxation:two": _branches,
    "contact_loss": lambda c, s, b, t: [entry("contact_loss", contact_position_m=s[0])],
    "contact_loss:carried": lambda c, s, b, t: [entry("contact_loss", contact_position_m=s[0])],
    "position_dependent_friction": lambda c, s, b, t: [
        entry("position_dependent_friction", force_per_length_n_m=c[0])
    ],
    "stiffness_change": _change,
    "time_delay": lambda c, s, b, t: [entry("time_delay", delay_s=s[0])],
    "sensor_lag": lambda c, s, b, t: [entry("sensor_lag", time_constant_s=s[0])],
    "sensor_drift": _drift,
    "sensor_drift:creep": _drift,
    "pulsation": _pulses,
    "unmodelled_resonance": _mode,
    "unmodelled_resonance:free": _mode,
}


def extended_model(analysis: Analysis, name: str) -> ContactModel:
    """Mass, damper, spring and every cause that the search named, sensor's faults last."""
    regression, fit = analysis.regression, analysis.fit
    if FIXTURE in fit.model:  # with m, b and k the hanging mass spans a weak fixture, too
        fit = regression.fit(
            {("unmodelled_resonance:free" if n == FIXTURE else n): s for n, s in fit.model.items()}
        )
    entries = _base(fit, regression.sense)
    base = fit.coefficients[:3] * regression.sense
    for cause, shape in fit.model.items():
        if cause != "asymmetric_damping":
            entries += MAKERS[cause](
                fit.of(cause) * regression.sense, shape, base, regression.signals.origin_s
            )
    entries += [_sensor(fault) for fault in analysis.faults]
    return ContactModel.from_mapping({"schema": SCHEMA, "name": name, "effects": entries})


def _base(fit: ModelFit, sense: float) -> list[Entry]:
    m, b, k = fit.coefficients[:3] * sense
    extra: list[Entry] = []
    if "asymmetric_damping" in fit.model:
        more = float(fit.of("asymmetric_damping")[0]) * sense
        extra = [entry("asymmetric_damping", forward_n_s_m=b + more, backward_n_s_m=b - more)]
        b = 0.0
    if "contact_loss:carried" in fit.model:  # the mass is carried before the contact, too
        mass = entry("mass_damper_spring", mass_kg=m, damping_n_s_m=0.0, stiffness_n_m=0.0)
        carried = {**mass, "site": "shaft"}
        return [carried, entry("mass_damper_spring", mass_kg=0.0, damping_n_s_m=b, stiffness_n_m=k), *extra]
    return [entry("mass_damper_spring", mass_kg=m, damping_n_s_m=b, stiffness_n_m=k), *extra]


def _sensor(fault: Fault) -> Entry:
    known = {p.name for p in OWN[fault.name].parameters}
    return entry(fault.name, **{key: float(v[0]) for key, v in fault.parameters.items() if key in known})
