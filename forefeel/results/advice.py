"""Next steps after a verdict, and reasons why an extended model predicts no better across a delay."""

from typing import TYPE_CHECKING

from forefeel.common.causes.catalogue import cause_class
from forefeel.diagnosis.verdict import Diagnosis

if TYPE_CHECKING:  # loads the predictor
    from forefeel.diagnosis.prediction import Across

_ALIKE = 0.05  # two errors ahead that differ by less of them are alike


def next_steps(diagnosis: Diagnosis, across: "Across | str | None") -> list[str]:
    """Advice on bench, model or the next recording, by verdict."""
    motion, verdict = diagnosis.suggested_motion, diagnosis.verdict
    if verdict == "cause_found":
        remedies = [kind.remedy for cause in diagnosis.causes if (kind := cause_class(cause.name)).remedy]
        return [*(f"on the bench: {text}" for text in remedies[:1]), *_with_the_model(across)]
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
    """Advice on the use of model.yaml; in the master only where it predicts better across a delay."""
    simulated = "load model.yaml where the force is simulated: forefeel simulate, loopback --slave-model"
    if across is None or isinstance(across, str):
        return [simulated, "what the master gains by it: forefeel evaluate FILE --model model.yaml"]
    if not better(across):
        return [simulated, "leave model.yaml out of the master: it predicts this motion no worse alone"]
    return [
        "use it: prediction: {model: model.yaml} in the settings of forefeel master",
        "try it first: forefeel loopback --master-model model.yaml",
    ]


def better(across: "Across") -> bool:
    """True where the extended model predicts clearly better than the master does without a model."""
    return across.after_n < (1.0 - _ALIKE) * across.before_n


def why_no_better(diagnosis: Diagnosis, across: "Across") -> list[str]:
    """Line on why the extended model predicts no better; none where it does."""
    if better(across):
        return []
    if across.zoh_n < min(across.before_n, across.after_n):
        return ["no better: on this motion the newest late force is nearest"]
    kinds = [cause_class(named.name) for named in diagnosis.causes]
    if all(kind.of_its_run or kind.sized_anew for kind in kinds):
        return ["no better: what was found in one run says nothing of the next, and is learned anew"]
    return ["no better: the predictor learned as much from the late forces"]
