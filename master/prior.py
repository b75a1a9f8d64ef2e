"""The prior of an axis: what its session starts from, and whether what it learned is kept."""

from datetime import date

from forefeel.common.errors import ConfigurationError, RunError
from forefeel.common.estimation.contact_prior import ContactPrior
from forefeel.common.estimation.learner import Learner
from forefeel.common.prior_file import keep_prior, nearest
from forefeel.master.settings import PredictionSettings

LEAST_CONTACT_S = 5.0


def load(wanted: PredictionSettings) -> tuple[ContactPrior | None, str]:
    """(what the session starts from, in one line what it is); None where it starts cold, and why. The line is
    empty where the settings name no folder.
    """
    if wanted.prior_dir is None or wanted.instrument is None or wanted.patient is None:
        return None, ""
    try:
        start = nearest(wanted.prior_dir, wanted.instrument, wanted.patient)
    except ConfigurationError as error:
        return None, f"none, refused: {error}"
    if start is None:
        return None, f"none yet of {wanted.instrument}"
    return start


def objection(contact_s: float, ratio: float, faulted: bool) -> str | None:
    """Why what a session learned is not kept; None where it is. `ratio`: rms of the prediction over that of
    the zero-order hold.
    """
    if faulted:
        return "there was a fault or a stop"
    if contact_s < LEAST_CONTACT_S:
        return f"{contact_s:.1f} s of contact; expected at least {LEAST_CONTACT_S:g} s"
    if not ratio <= 1.0:
        return "the prediction was no better than the zero-order hold"
    return None


def keep(wanted: PredictionSettings, learner: Learner, faulted: bool, today: date) -> str:
    """Writes what a session learned into the file of its instrument and patient, unless there is an
    objection; in one line what became of it. Empty where the settings name no folder.
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
