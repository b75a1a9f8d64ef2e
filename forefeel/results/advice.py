"""What to do after a verdict, and why an extended model does not predict better across a delay."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from forefeel.common.causes.catalogue import remedy
from forefeel.common.estimation.contact_loaded import OF_ITS_RUN, OWN, TOLD_ANEW
from forefeel.common.events.text import quantity
from forefeel.diagnosis.verdict import Diagnosis
from forefeel.report.wording import share

if TYPE_CHECKING:  # loads the predictor
    from forefeel.diagnosis.prediction import Across

_ALIKE = 0.05  # two errors ahead that differ by less of them are alike
_LED = 0.1  # of the time, below which the contact model has no say in the prediction
_NEAR_NOISE = 1.5  # ratio of an error to the noise


def next_steps(diagnosis: Diagnosis, across: "Across | str | None") -> list[str]:
    motion, verdict = diagnosis.suggested_motion, diagnosis.verdict
    if verdict == "cause_found":
        remedies = [found for cause in diagnosis.causes if (found := remedy(cause.name))]
        return [*(f"on the bench: {found}" for found in remedies[:1]), *_with_the_model(across)]
    if verdict == "nothing_missing":
        return ["nothing to mend; model.yaml holds this simulation for forefeel simulate and loopback"]
    if verdict == "not_driven_by_this_axis":
        return ["record the axis that pushes, or strokes of this one that nobody else touches"]
    if motion is None:  # what is left is slower than the strokes
        return [
            "record a minute at rest at no load: a force that wanders then is of the bench, not of contact"
        ]
    after = "then diagnose both recordings with --together"
    if verdict == "not_separable":
        after = f"it tells the rivals apart; {after}"
    if verdict == "unexplained":
        after = "and look at the bench where and when the report shows that most is left"
    return [f"record {motion}", after]


def _with_the_model(across: "Across | str | None") -> list[str]:
    simulated = "load model.yaml where the force is simulated: forefeel simulate, loopback --slave-model"
    if across is None or isinstance(across, str):
        return [simulated, "what the master gains by it: forefeel evaluate FILE --model model.yaml"]
    if not better(across):
        return [simulated, "leave it out of the master, which predicts this motion as well without it"]
    return [
        "use it: prediction: {model: model.yaml} in the settings of forefeel master",
        "try it first: forefeel loopback --master-model model.yaml",
    ]


def better(across: "Across") -> bool:
    """Whether the extended model predicts better than mass, damper, spring and bias."""
    return across.after_n < (1.0 - _ALIKE) * across.before_n


def why_no_better(diagnosis: Diagnosis, across: "Across") -> Iterator[str]:
    """What the numbers tell where it does not: a reason, when it errs otherwise, how near the noise is."""
    if better(across):
        return
    word = "no better" if across.after_n <= (1.0 + _ALIKE) * across.before_n else "worse"
    names = [cause.name for cause in diagnosis.causes if cause.name != "bias"]
    own = [name for name in names if name in OWN]
    if not set(names) - {*OF_ITS_RUN, *TOLD_ANEW}:
        what = " and ".join(names) or "bias"
        yield f"{word}: {what} of one run says nothing of the next, and is learned anew"
    elif across.contact_share < _LED:
        led = share(across.contact_share)
        yield f"{word}: model.yaml changes the contact model, which led {led} of the time;"
        yield "the experts beside it, which learn from the late forces whatever the cause, had erred less"
    else:
        has = f"has {' and '.join(own)} of its own and " if own else ""
        yield f"{word}: the predictor {has}learned as much from the late forces"
    (before_n, after_n), late_n = across.early_n, across.late_n
    if late_n is not None and abs(after_n - before_n) > _ALIKE * before_n:
        sizes = [quantity(size, "N") for size in (before_n, after_n, *late_n)]
        text = "in the first {:g} s {} before, {} extended; from then on {} and {}"
        yield text.format(across.early_s, *sizes)
    floor_n = diagnosis.noise_floor_n
    if floor_n is not None and across.before_n < _NEAR_NOISE * floor_n:
        yield f"little is left to gain: the noise alone is up to {quantity(floor_n, 'N')}"
