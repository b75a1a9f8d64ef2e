"""The prior of an axis: what its session starts from, and whether what it learned is kept."""

from datetime import date

from forefeel.common.errors import ConfigurationError, RunError
from forefeel.common.estimation.contact_prior import ContactPrior, force_ratio
from forefeel.common.estimation.learner import Learner
from forefeel.common.prior_file import keep_prior, nearest
from forefeel.master.settings import PredictionSettings

LEAST_CONTACT_S = 5.0
_SUSPECT_S, _SUSPECT = 3.0, 1.7
"""After 3 s of contact a gain of 2 reads 1.8 to 2.0, one of 1/2 0.51 to 0.52, a right one 0.99 to 1.02."""


def load(wanted: PredictionSettings, accept_other: bool) -> tuple[ContactPrior | None, str]:
    """Prior that the session starts from, and one line on its origin; None and the reason where there is
    none, or its file is refused. None and an empty line where the settings name no prior_dir, instrument or
    patient. `accept_other`: the prior of another patient is taken, too.
    """
    if wanted.prior_dir is None or wanted.instrument is None or wanted.patient is None:
        return None, ""
    try:
        start = nearest(wanted.prior_dir, wanted.instrument, wanted.patient)
    except ConfigurationError as error:
        return None, f"none, refused: {error}"
    if start is None:
        return None, f"none yet of {wanted.instrument}"
    if start.patient != wanted.patient and not accept_other:
        return None, f"none; to start from that of {start.origin}, type --accept-prior"
    return start.prior, start.origin


def suspicion(learner: Learner) -> str:
    """Warning in one line where forces are beyond 1.7 times the prior's, or below 1/1.7; else empty, as it is
    without a prior, before 3 s of contact and before a fit.
    """
    prior = learner.prior
    if prior is None or learner.contact_s < _SUSPECT_S or (learned := learner.learned) is None:
        return ""
    if 1.0 / _SUSPECT < (ratio := force_ratio(prior, learned)) < _SUSPECT:
        return ""
    return f"forces are {ratio:.2g} times those of the prior: check instrument, patient and load cell's gain"


def objection(contact_s: float, ratio: float, faulted: bool) -> str | None:
    """Reason not to keep what was learned: a fault, under 5 s of contact, or a prediction no better than the
    zero-order hold (`ratio`, rms over rms, above 1 or NaN); else None.
    """
    if faulted:
        return "there was a fault or a stop"
    if contact_s < LEAST_CONTACT_S:
        return f"{contact_s:.1f} s of contact; expected at least {LEAST_CONTACT_S:g} s"
    if not ratio <= 1.0:
        return "the prediction was no better than the zero-order hold"
    return None


def keep(wanted: PredictionSettings, learner: Learner, faulted: bool, today: date) -> str:
    """Writes what a session learned into the prior file of its instrument and patient; returns one line:
    kept, or not kept and why (an objection, nothing learned, a file error, which is not raised). Empty, and
    nothing is written, where the settings name no prior_dir, instrument or patient.
    """
    if wanted.prior_dir is None or wanted.instrument is None or wanted.patient is None:
        return ""
    learned, why = learner.learned, objection(learner.contact_s, learner.ratio, faulted)
    if learned is None or why is not None:
        return f"not kept: {why or 'nothing was learned'}"
    try:
        stored = keep_prior(wanted.prior_dir, wanted.instrument, wanted.patient, learned, today)
    except (ConfigurationError, RunError) as error:
        return f"not kept: {error}"
    return f"kept: {stored.instrument}, patient {stored.patient}: {stored.amount}"
