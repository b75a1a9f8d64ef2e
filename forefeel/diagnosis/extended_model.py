"""The extended model: the causes found as effects of a model.yaml, which the slave and the predictor load.

Times are the recording's own stamps. Where the recording shows the reaction the force is turned: positive
resists.
"""

from forefeel.common.causes.candidate import Entry, Fitted, entry
from forefeel.common.causes.catalogue import CANDIDATES, cause_class
from forefeel.common.causes.model import SCHEMA, ContactModel
from forefeel.common.causes.registry import OWN
from forefeel.common.causes.wall import MassDamperSpring
from forefeel.diagnosis.analysis import Analysis
from forefeel.diagnosis.regression import ModelFit, mass_site

FIXTURE = "unmodelled_resonance:fixture"


def extended_model(analysis: Analysis, name: str) -> ContactModel:
    """Makes the contact model, called `name`, of mass, damper, spring, every cause of the fit and then the
    sensor's faults; a positive force resists. A resonance of the fixture is replaced by a free one,
    coefficients fitted anew.
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
        effects += CANDIDATES[form].entries(Fitted(coefficients, shape, base, regression.signals.origin_s))
    effects += [
        entry(OWN[fault.name], {key: interval.value for key, interval in fault.parameters.items()})
        for fault in analysis.faults
    ]
    return ContactModel.from_mapping({"schema": SCHEMA, "name": name, "effects": effects})


def _base(fit: ModelFit, mass: float, damping: float, stiffness: float) -> list[Entry]:
    """Entries of mass, damper and spring for a model.yaml; two where a cause puts the mass at a site before
    the contact. The damping is 0 where a cause of the fit takes its place.
    """
    if any(cause_class(name).instead_of == "damping_n_s_m" for name in fit.model):
        damping = 0.0
    site = mass_site(fit.model)
    if site == "wall":
        return [_mass_damper_spring(mass, damping, stiffness)]
    mass_there = {**_mass_damper_spring(mass, 0.0, 0.0), "site": site}
    return [mass_there, _mass_damper_spring(0.0, damping, stiffness)]


def _mass_damper_spring(mass: float, damping: float, stiffness: float) -> Entry:
    return entry(MassDamperSpring, {"mass_kg": mass, "damping_n_s_m": damping, "stiffness_n_m": stiffness})
