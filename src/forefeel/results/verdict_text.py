"""A verdict in plain words, with the next steps, for an engineer who has to decide what to do."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from forefeel.common.causes.catalogue import cause_class, words
from forefeel.common.causes.catalogue import equation as cause_equation
from forefeel.common.events.console import printable
from forefeel.common.events.text import quantity, units_of
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.verdict import (
    MOST_TIMES_THE_NOISE,
    SLOW,
    Cause,
    Diagnosis,
    ExpectedGain,
    HeldOut,
    Look,
    NextMotion,
)
from forefeel.report.wording import DISCLAIMER, plain_value, shown, split_unit

if TYPE_CHECKING:
    from forefeel.diagnosis.prediction import Across

FLAGS = {
    "non_uniform": "the samples are unevenly spaced, so fast effects are less certain",
    "gaps": "the recording has gaps; nothing was assumed about what happened in them",
    "clipped": "where the force stood at the end of its range it was left out",
    "searched_on_stretches": "stretches of it were diagnosed; the model was held against all of it",
    "step_response": "the force has a few levels only, and the motion was simulated from it: strokes would "
    "tell friction, or a spring that stiffens",
    "ramp_and_hold": "one ramp and hold: it tells whether the force fades, not friction, damping or mass",
    "slow_force": "mass, damper and spring explain the strokes; what is left is slower than they are",
    "short": "under 10 s, so what is slow (relaxation, drift, breath) can hardly be told",
    "force_is_the_reaction": "force and position count in opposite directions here; signs were turned",
}
_MOST_SIZES = 3  # that would have shown, on the terminal
_ALIKE = 0.05  # two errors ahead that differ by less of them are alike
_CAUSES_BELOW = {
    "cause_found": "The simulation leaves out the causes below, the largest first.",
    "partly_explained": "The simulation leaves out the causes below, and more that has no name.",
}
_VERDICT_TEXT = {
    "nothing_missing": "Nothing is missing: mass, damper and spring explain the force{}.",
    "nothing_found": (
        "No cause was found. Whether anything is missing can not be said: the recording does not tell how "
        "large its noise is."
    ),
    "not_driven_by_this_axis": (
        "The motion of this axis does not cause the force: the force's own past tells more of it."
    ),
    "not_separable": ("Something is missing, and this motion can not tell which of several causes it is."),
    "unexplained": (
        "Something is missing that none of the known causes explains. None is named, for too much would be "
        "left."
    ),
}
_NEEDED_FOR = {
    "mass_kg": "quicker motions", "damping_n_s_m": "motions of another speed",
    "stiffness_n_m": "strokes of another depth",
}  # fmt: skip


def failure(error: Exception) -> str:
    """Type and text of an error as one line, for the place of the result that failed."""
    return " ".join(f"{type(error).__name__}: {error}".split())


def headline(diagnosis: Diagnosis) -> str:
    """Sentence on the verdict: where causes are named these, the bias only if alone; where more is missing
    also the gain and the rms that is left.
    """
    if not diagnosis.names_causes:
        known = "" if diagnosis.noise_floor_n is None else " down to its noise"
        return _VERDICT_TEXT[diagnosis.verdict].format(known)
    causes = [cause for cause in diagnosis.causes if cause.name != "bias"] or list(diagnosis.causes)
    *more, last = [words(cause.name, cause.column) for cause in causes]
    named = f"{', '.join(more)}{' and ' if more else ''}{last}"
    if diagnosis.verdict == "cause_found":
        return f"The simulation leaves out {named}."
    held = diagnosis.held_out
    return (
        f"The largest thing that the simulation leaves out is {named}: {gain_text(held)} error; "
        f"{quantity(held.rmse_after_n, 'N')} are left that no known cause explains."
    )


def on_readings(diagnosis: Diagnosis) -> bool:
    """True where all causes were seen on the readings, and taken out before models were compared."""
    return bool(diagnosis.causes) and not any(
        cause.evidence.likelihood or cause.evidence.gain for cause in diagnosis.causes
    )


def gain_text(held: HeldOut) -> str:
    word = "less" if held.gain >= 0.0 else "more"
    ends = sorted(100.0 * (end if held.gain >= 0.0 else -end) for end in (held.gain_low, held.gain_high))
    return f"{abs(100.0 * held.gain):.0f} % {word} ({ends[0]:.0f} to {ends[1]:.0f} %)"


def answer(
    recording: Recording, diagnosis: Diagnosis, across: "Across | str | None", given: str | None = None
) -> list[str]:
    """Lines for the terminal: recording, verdict, those of `answer_lines`, disclaimer."""
    below = _CAUSES_BELOW.get(diagnosis.verdict)
    with units_of(recording.columns):
        return [
            f"{printable(recording.name)}: {len(recording)} samples, {recording.sampled_s:.1f} s, "
            f"{recording.rate_hz:.4g} Hz",
            f"Verdict     {diagnosis.verdict}. {below or headline(diagnosis)}",
            *labelled(answer_lines(diagnosis, across, given)),
            DISCLAIMER,
        ]


def labelled(lines: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    """Lines for the terminal, each with its label in a column of its own."""
    return tuple(f"{label:<11} {text}" for label, text in lines)


def answer_lines(
    diagnosis: Diagnosis, across: "Across | str | None", given: str | None = None
) -> list[tuple[str, str]]:
    """(label, text) of each line of an answer, for terminal and page; an empty label continues the last one.

    `given`: name of the simulation. `across`: the prediction, or why it failed.
    """
    extended = diagnosis.names_causes
    parts = [
        *(("Rivals", [f"{name}: {words(name)}" for name in group]) for group in diagnosis.rivals),
        ("Nearest", _nearest(diagnosis)),
        ("Look", look_texts(diagnosis.look)),
        ("Simulation", [_simulation(diagnosis, given)]),
        *(("Cause", _cause(cause)) for cause in diagnosis.causes),
        ("Extended", [_extended(diagnosis, given)] if extended else []),
        ("Follows", follows_texts(diagnosis)),
        ("Would show", _detectable_sizes(diagnosis)),
        ("Elsewhere", _elsewhere(diagnosis.other_motion)),
        ("Predicted", _predicted(diagnosis, across) if extended else []),
        ("Model", _model(diagnosis)),
        *(("Caution", [text]) for text in (*_times_the_noise(diagnosis), *_unknown(diagnosis))),
        *(("Caution", [FLAGS.get(flag, flag.replace("_", " "))]) for flag in diagnosis.flags),
        ("Next", next_steps(diagnosis, across)),
    ]
    return [("" if i else label, text) for label, texts in parts for i, text in enumerate(texts)]


def look_texts(look: Look | None) -> list[str]:
    """Results of plain regressions before the search: band, direction, shares of the force, family; empty
    without a look.
    """
    if look is None:
        return []
    way = "resists the motion" if look.sense > 0.0 else "pushes along the motion, a reaction"
    family = "none of the three takes a quarter of the rest"
    if look.family is not None:
        family = f"{look.family} is the best of the three"
    shares = look.spring, look.spring_in_band, look.explained
    spring, in_band, best = (f"{100 * max(share, 0.0):.0f} %" for share in shares)
    return [
        f"strokes above {look.slow_hz:.2g} Hz; a positive force {way}",
        f"mass, damper and spring explain {spring} of the force on held-out blocks, {in_band} of that of the "
        "strokes",
        f"friction, relaxation and stiffening beside them: {best}; {family}",
    ]


def noise_text(diagnosis: Diagnosis) -> str:
    """Noise of the force: at most, as it holds what is fast and not modelled; or `unknown`."""
    floor_n = diagnosis.noise_floor_n
    return "unknown" if floor_n is None else f"at most {quantity(floor_n, 'N')}"


def named(diagnosis: Diagnosis) -> str:
    names = [cause.name for cause in diagnosis.causes] or [" | ".join(group) for group in diagnosis.rivals]
    return f"{diagnosis.verdict}{': ' if names else ''}{', '.join(names)}"


def _simulation(diagnosis: Diagnosis, given: str | None) -> str:
    size = quantity(diagnosis.baseline.rmse_n, "N")
    return (
        f"{'' if given is None else f'{given!r} is '}off by {size} rms; noise is {noise_text(diagnosis)}; "
        f"fit {diagnosis.baseline.fit_percent:.0f} %"
    )


def _nearest(diagnosis: Diagnosis) -> list[str]:
    """Suspected causes that lower the error of an unexplained recording; none for other verdicts."""
    names = [words(name) for name in diagnosis.suspected if name != "bias"]
    if diagnosis.verdict != "unexplained" or not names or diagnosis.held_out.gain_low <= 0.0:
        return []
    return [f"{' and '.join(names)}: the error is {gain_text(diagnosis.held_out)}, and too much is left"]


def _cause(cause: Cause) -> list[str]:
    """Two lines on a cause: its parameters, then its description with its rms; of a bias, that the fitted
    simulation has one.
    """
    parameters = "; ".join(str(shown(name, value)) for name, value in cause.parameters.items())
    values = {name: interval.value for name, interval in cause.parameters.items()}
    described = cause_class(cause.name).described(values, plain_value)
    size = f", {quantity(cause.explained_n, 'N')} rms of the force"
    share = "; the fitted simulation has one, too" if cause.name == "bias" else size
    name = f"with {cause.column}" if cause.column else cause.name
    return [f"{name}: {parameters}", f"{words(cause.name, cause.column)}{described}{share}"]


def _extended(diagnosis: Diagnosis, given: str | None) -> str:
    """Text on error and gain of the extended model on stretches that it was not fitted to; where all causes
    were seen on the readings, only that they were taken out.
    """
    held = diagnosis.held_out
    if on_readings(diagnosis):
        return "the readings were freed of it before the rest was compared"
    return (
        f"off by {quantity(held.rmse_after_n, 'N')} rms on stretches it was not fitted to, {gain_text(held)}"
        f"{'' if given is None else ' than a fitted mass, damper, spring'}; "
        f"fit {diagnosis.extended.fit_percent:.0f} %"
    )


def follows_texts(diagnosis: Diagnosis) -> list[str]:
    """Lines on the rms residual and the variables that explain a share of it; empty where none does."""
    if not diagnosis.follows:
        return []
    first, *more = (f"{of.variable} {100.0 * of.share:.0f} %" for of in diagnosis.follows)
    low, high = (quantity(end, "m") for end in (diagnosis.follows[0].low_m, diagnosis.follows[0].high_m))
    left = f"the {quantity(diagnosis.held_out.rmse_after_n, 'N')} that are left follow {first}"
    return [f"{left}; most of it at {low} to {high}", *([f"then {', '.join(more)}"] if more else [])]


def _detectable_sizes(diagnosis: Diagnosis) -> list[str]:
    """Line on up to three absent causes, no bias, with the least size detectable here; empty without any."""
    sizes = []
    for name, size in diagnosis.detectable.items():
        cause, parameter = name.split(".")
        if cause != "bias":
            sizes.append(f"{words(cause)} above {plain_value(parameter, size)}")
    return [", ".join(sizes[:_MOST_SIZES])] if sizes else []


def _elsewhere(expected: ExpectedGain | None) -> list[str]:
    """Line on the gain expected on another motion, and the range where it holds; empty without one."""
    if expected is None:
        return []
    low, high = sorted((expected.gain_low, expected.gain_high))
    ends_m = expected.low_m, expected.high_m
    low_m, high_m = (0.0 if abs(end_m) < 1e-3 * (ends_m[1] - ends_m[0]) else end_m for end_m in ends_m)
    return [
        f"expected of another motion: {100.0 * expected.gain:.0f} % less error "
        f"({100.0 * low:.0f} to {100.0 * high:.0f} %) within {quantity(low_m, 'm')} to "
        f"{quantity(high_m, 'm')}, up to {quantity(expected.fastest_m_s, 'm/s')}"
    ]


def equation(diagnosis: Diagnosis) -> str:
    """Equation `f = ...` of the model in SI units: extended where causes are named, else the simulation.
    Conditions follow, each after a semicolon.
    """
    model = diagnosis.extended if diagnosis.names_causes else diagnosis.baseline
    m, b, k = (model.parameters.get(name, 0.0) for name in ("mass_kg", "damping_n_s_m", "stiffness_n_m"))
    terms = [f"{value:.3g} {of}" for value, of in ((m, "x''"), (b, "x'"), (k, "x")) if value]
    causes = {cause.name: {key: p.value for key, p in cause.parameters.items()} for cause in diagnosis.causes}
    if "bias" not in causes and "bias.force_n" in model.parameters:
        causes["bias"] = {"force_n": model.parameters["bias.force_n"]}
    if any(cause_class(name).instead_of == "damping_n_s_m" for name in causes):
        terms = [term for term in terms if not term.endswith(" x'")]
    besides: list[str] = []
    for name, parameters in causes.items():
        adds, text = cause_equation(name, parameters)
        term, _, condition = text.partition("; ") if adds else ("", "", text)
        terms += [term] if term else []
        besides += [condition] if condition else []
    summed = " + ".join(terms).replace("+ -", "- ")
    return "; ".join([f"f = {summed}", *besides])


def _model(diagnosis: Diagnosis) -> list[str]:
    """Equation of the model, and its mass, damping and stiffness; empty without these."""
    model = diagnosis.extended if diagnosis.names_causes else diagnosis.baseline
    values = "; ".join(
        str(shown(name, of)) if of.value else f"{split_unit(name)[0]} not told from zero"
        for name, of in model.intervals.items()
    )
    return [equation(diagnosis), values] if values else []


def _times_the_noise(diagnosis: Diagnosis) -> list[str]:
    """Caution where causes are named and more is left than three times the noise."""
    floor_n, left_n = diagnosis.noise_floor_n, diagnosis.held_out.rmse_after_n
    if not diagnosis.names_causes or not floor_n or left_n < MOST_TIMES_THE_NOISE * floor_n:
        return []
    return [f"{left_n / floor_n:.0f} times the noise are left: something is missing beside what is named"]


def _unknown(diagnosis: Diagnosis) -> list[str]:
    """Cautions on mass, damping, stiffness not told from zero by this motion; none if no cause is named."""
    if not diagnosis.names_causes:
        return []
    return [
        f"this motion does not tell the {split_unit(name)[0]} from zero; {_NEEDED_FOR[name]} may differ"
        for name, interval in diagnosis.extended.intervals.items()
        if interval.low <= 0.0 <= interval.high
    ]


def _predicted(diagnosis: Diagnosis, across: "Across | str | None") -> list[str]:
    """Errors of the prediction across the delay, or why it failed; empty where none was made."""
    if across is None:
        return []
    if isinstance(across, str):
        return [f"failed: {across}"]
    return [
        f"{quantity(across.delay_s, 's')} ahead, {stretch(across)}, rms: "
        f"{quantity(across.before_n, 'N')} before, {quantity(across.after_n, 'N')} extended, "
        f"{quantity(across.zoh_n, 'N')} by a zero-order hold",
        *why_no_better(diagnosis, across),
    ]


def stretch(across: "Across") -> str:
    return f"{across.from_s:.3g} to {across.to_s:.3g} s"


def next_steps(diagnosis: Diagnosis, across: "Across | str | None") -> list[str]:
    """Advice on bench, model or the next recording, by verdict."""
    motion, verdict = diagnosis.next_motion, diagnosis.verdict
    if diagnosis.names_causes:
        remedies = [kind.remedy for cause in diagnosis.causes if (kind := cause_class(cause.name)).remedy]
        more = [] if motion is None else [f"for what is left record {_motion(motion)}"]
        return [
            *(f"on the bench: {text}" for text in remedies[:1]),
            *more,
            *_with_the_model(diagnosis, across),
        ]
    if verdict == "nothing_missing":
        return ["nothing to mend; model.yaml holds this simulation for forefeel simulate and loopback"]
    if verdict == "not_driven_by_this_axis":
        return ["record the axis that pushes, or strokes of this one that nobody else touches"]
    if SLOW in diagnosis.flags:
        return [
            "record a minute at rest at no load: a force that wanders then is of the bench, not of contact"
        ]
    steps = [] if motion is None else [f"record {_motion(motion)}"]
    if verdict == "unexplained":
        steps.append("look at the bench where and when the report shows that most is left")
    return steps


def _motion(motion: NextMotion) -> str:
    asked = f"the {motion.duration_s:.0f} s of motion that forefeel investigate makes of this recording"
    return motion.words or f"{asked}; it judges the answer, too"


def _with_the_model(diagnosis: Diagnosis, across: "Across | str | None") -> list[str]:
    """Advice on the use of model.yaml; in the master only where it predicts better across a delay."""
    simulated = "load model.yaml where the force is simulated: forefeel simulate, loopback --slave-model"
    if across is None or isinstance(across, str):
        return [simulated, "what the master gains by it: forefeel evaluate FILE --model model.yaml"]
    if not better(across):
        alone = "better" if _compared(across) == "worse" else "no worse"
        return [simulated, f"leave model.yaml out of the master: it predicts this motion {alone} alone"]
    further = [cause.column for cause in diagnosis.causes if cause.column]
    return [
        "use it: prediction: {model: model.yaml} in the settings of forefeel master",
        f"its column {further[0]} has to be the name of another axis of the cell"
        if further
        else "try it first: forefeel loopback --recording FILE --master-model model.yaml",
    ]


def better(across: "Across") -> bool:
    """True where the extended model predicts clearly better than the master does without a model."""
    return _compared(across) == "better"


def _compared(across: "Across") -> str:
    """`better`, `the same` or `worse`: the prediction with the extended model beside that without one."""
    ratio = across.after_n / across.before_n if across.before_n > 0.0 else 1.0
    return "better" if ratio < 1.0 - _ALIKE else "worse" if ratio > 1.0 + _ALIKE else "the same"


def why_no_better(diagnosis: Diagnosis, across: "Across") -> list[str]:
    """Line that says whether the extended model predicts the same or worse, and why; none where better."""
    if better(across):
        return []
    compared, learned = _compared(across), "as much"
    if compared == "worse":
        compared, learned = f"{100.0 * (across.after_n / across.before_n - 1.0):.0f} % worse", "more"
    if across.zoh_n < min(across.before_n, across.after_n):
        return [f"{compared}: on this motion the newest late force is nearest"]
    kinds = [cause_class(named.name) for named in diagnosis.causes]
    if all(kind.of_its_run or kind.sized_anew for kind in kinds):
        return [f"{compared}: what was found in one run says nothing of the next, and is learned anew"]
    return [f"{compared}: the predictor learned {learned} from the late forces"]
