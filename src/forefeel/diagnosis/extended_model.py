"""The extended model: the causes found as effects of a model.yaml, which the slave and the predictor load.

Times are the recording's own stamps. Where the recording shows the reaction the force is turned: positive
resists.
"""

from dataclasses import replace

import numpy as np

from forefeel.common.causes.candidate import Entry, Fitted, entry
from forefeel.common.causes.catalogue import CANDIDATES, cause_class
from forefeel.common.causes.model import SCHEMA, ContactModel
from forefeel.common.causes.motion import Motion
from forefeel.common.causes.registry import OWN
from forefeel.common.causes.wall import MassDamperSpring
from forefeel.common.error_size import Floats
from forefeel.common.errors import ConfigurationError
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.analysis import Analysis
from forefeel.diagnosis.regression import ModelFit, drags, forces_along, mass_site, motion_grid
from forefeel.diagnosis.signals import WIDEST, Signals, gapless, speed_band_m_s

FIXTURE = "unmodelled_resonance:fixture"


def extended_model(analysis: Analysis, name: str) -> ContactModel:
    """Makes the contact model `name` of the fitted mass, damper and spring, every cause of the fit and then
    the sensor's faults, signed so that a positive force resists. A resonance of the fixture becomes a free
    one, for which all coefficients are fitted anew.
    """
    regression, fit = analysis.regression, analysis.fit
    if FIXTURE in fit.model:  # with m, b and k the hanging mass spans a weak fixture, too
        fit = regression.fit(
            {("unmodelled_resonance:free" if n == FIXTURE else n): s for n, s in fit.model.items()}
        )
    base = fit.coefficients[:3] * regression.sense
    effects = _base(fit, *map(float, base))
    for form, shape in fit.model.items():
        coefficients = fit.of(form) * regression.sense
        start_s, column = regression.signals.origin_s, regression.column_of(form)
        effects += CANDIDATES[form].entries(Fitted(coefficients, shape, base, start_s, column))
    effects += [
        entry(OWN[fault.name], {key: interval.value for key, interval in fault.parameters.items()})
        for fault in analysis.faults
    ]
    return ContactModel.from_mapping({"schema": SCHEMA, "name": name, "effects": effects})


def simulated_n(model: ContactModel, recording: Recording) -> Floats:
    """Force of the model, whose positive resists, at the stamps of a recording, which are the model's times:
    from rest along the motion as a diagnosis conditions it, up to 0.45 of the sampling rate. Each piece
    without gaps is a new contact; in one too short to be conditioned speed is by differences, acceleration 0.

    Raises:
        ConfigurationError: the force is not finite, or the recording lacks a column that it follows.
    """
    for column in set(model.columns) - {column.name for column in recording.further}:
        place = f"{recording.source}: no column {column!r}"
        raise ConfigurationError(f"{place}, expected the one that model {model.name!r} follows")
    force_n = np.empty(len(recording))
    for piece in gapless(recording):
        part = recording.cut(piece)
        t, x = part.time_s, part.position_m
        signals = Signals.of_motion(t, x, WIDEST * recording.rate_hz, part.further)
        if signals is None:
            v = np.gradient(x, t) if len(t) > 1 else np.zeros_like(x)
            beside = {column.name: column.values for column in part.further}
            motion = replace(Motion.of(t, x, v, np.zeros_like(x)), further=beside)
            force_n[piece] = model.runtime().forces_n(motion)
            continue
        reach_hz = min(2.0 * signals.cutoff_hz, signals.motion_reach_hz)
        grid = motion_grid(signals, speed_band_m_s(signals.even_m, signals.even_hz, reach_hz))
        force_n[piece] = np.interp(t, grid.t + t[0], forces_along(model, grid, float(t[0])))
    for index in np.flatnonzero(~np.isfinite(force_n))[:1]:
        raise ConfigurationError(
            f"model {model.name!r}: gives {force_n[index]} N at {recording.time_s[index]:g} s, expected a "
            "finite force"
        )
    return force_n


def _base(fit: ModelFit, mass: float, damping: float, stiffness: float) -> list[Entry]:
    """Entries of mass, damper and spring for a model.yaml: one, or two where a cause puts the mass, or mass
    and damper, at a site before the contact. The damping is 0 where a cause of the fit takes its place.
    """
    if any(cause_class(name).instead_of == "damping_n_s_m" for name in fit.model):
        damping = 0.0
    site = mass_site(fit.model)
    if site == "wall":
        return [_mass_damper_spring(mass, damping, stiffness)]
    before, behind = (damping, 0.0) if drags(fit.model) else (0.0, damping)
    there = {**_mass_damper_spring(mass, before, 0.0), "site": site}
    return [there, _mass_damper_spring(0.0, behind, stiffness)]


def _mass_damper_spring(mass: float, damping: float, stiffness: float) -> Entry:
    return entry(MassDamperSpring, {"mass_kg": mass, "damping_n_s_m": damping, "stiffness_n_m": stiffness})
