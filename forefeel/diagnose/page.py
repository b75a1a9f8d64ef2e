"""report.html of a diagnosis."""

from collections.abc import Mapping
from dataclasses import dataclass

from forefeel.common.effects.model import ContactModel
from forefeel.common.effects.registry import effect_class
from forefeel.common.recording.recording import Recording
from forefeel.diagnose.figures import drawings, named
from forefeel.diagnose.parts import Parts
from forefeel.diagnose.pictures import picture
from forefeel.diagnose.sensor_pictures import sensor_picture
from forefeel.diagnose.units import Shown, plain_value, shown, split_unit
from forefeel.diagnose.words import caution, gain_text, headline, on_readings, plain
from forefeel.diagnosis.diagnose import Diagnosed
from forefeel.diagnosis.diagnose.candidates import base_name
from forefeel.diagnosis.diagnose.prediction import Across
from forefeel.diagnosis.diagnose.verdict import Cause, Diagnosis, Evidence
from forefeel.report.svg import Drawing
from forefeel.report.template import render
from forefeel.report.wording import quantity

_FORMS = {
    "asymmetric": "Its level differs by direction.",
    "exponential": "It falls exponentially with the speed.",
    "bristles": "With bristles that are damped, after LuGre.",
    "two": "In two parts, a short one and a long one.",
    "carried": "The mass is carried before the contact, too.",
    "creep": "It settles: a creep rather than a ramp.",
    "fixture": "It swings between stage and load cell, with the whole instrument.",
}
"""What a form of a cause says beyond its name."""

ON_READINGS = "Seen on the readings"


@dataclass(frozen=True, slots=True)
class Section:
    """One cause, or one that was suspected, on the page."""

    name: str
    plain: str
    fingerprint: str
    form: str
    parameters: list[Shown]
    evidence: list[tuple[str, str]]
    drawing: Drawing | None


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """One parameter of the two models, in words."""

    owner: str
    label: str
    before: str
    after: str


def render_page(
    recording: Recording,
    diagnosed: Diagnosed,
    across: Across | None,
    given: ContactModel | None = None,
    model_yaml: str = "",
) -> str:
    """The diagnosis with its figures as one HTML file that needs nothing else."""
    diagnosis, parts = diagnosed.diagnosis, Parts.of(diagnosed.analysis, given)
    return render(
        "diagnose/page.html.j2",
        recording=recording,
        diagnosis=diagnosis,
        across=across,
        headline=headline(diagnosis),
        gain=gain_text(diagnosis.held_out),
        on_readings=on_readings(diagnosis),
        on_readings_label=ON_READINGS,
        cautions=[caution(flag) for flag in diagnosis.flags],
        simulation=named(parts),
        given=given is not None,
        causes=[_section(recording.name, parts, cause) for cause in diagnosis.causes],
        suspects=[] if diagnosis.causes else _suspects(recording.name, parts, diagnosis),
        rows=_rows(diagnosis),
        plain=plain,
        model_yaml=model_yaml,
        drawings=drawings(recording.name, parts, diagnosis),
    )


def _section(stem: str, parts: Parts, cause: Cause) -> Section:
    parameters = [shown(name, interval) for name, interval in cause.parameters.items()]
    explained = ("Its share of the force, rms", quantity(cause.explained_n, "N"))
    evidence = [explained, *_evidence(cause.evidence, cause.probability)]
    form, drawing = _drawn(stem, parts, cause.name)
    return Section(
        cause.name, plain(cause.name), _fingerprint(cause.name), form, parameters, evidence, drawing
    )


def _suspects(stem: str, parts: Parts, diagnosis: Diagnosis) -> list[Section]:
    """What the search put into its model while the verdict names nothing."""
    found = [(name, *_drawn(stem, parts, name)) for name in diagnosis.suspected]
    return [
        Section(name, plain(name), _fingerprint(name), form, [], [], drawing) for name, form, drawing in found
    ]


def _drawn(stem: str, parts: Parts, name: str) -> tuple[str, Drawing | None]:
    """(what its form says, its picture)."""
    for fault in parts.analysis.faults:
        if fault.name == name:
            return "", sensor_picture(stem, parts.analysis, fault)
    for full in parts.analysis.fit.model:
        if base_name(full) == name:
            return _FORMS.get(full.partition(":")[2], ""), picture(stem, parts, full)
    return "", None


def _fingerprint(name: str) -> str:
    """What the effect says of itself, ours or of another distribution."""
    try:
        text = effect_class(name).fingerprint
    except ValueError:
        return ""
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def _evidence(evidence: Evidence, probability: float) -> list[tuple[str, str]]:
    """Held-out gain, likelihood, probability; a fault of the sensor is seen on the readings themselves."""
    found = []
    if evidence.gain:
        ends = f"{100 * evidence.gain_low:.0f} to {100 * evidence.gain_high:.0f} %"
        found.append(("Error on held-out blocks, less by", f"{100 * evidence.gain:.0f} % ({ends})"))
    if not evidence.likelihood:
        return [*found, (ON_READINGS, evidence.words.partition(";")[0])]
    likely = "over 99.9 %" if probability > 0.999 else f"{100 * probability:.1f} %"
    return [
        *found,
        ("Penalised -2 log likelihood, less by", f"{evidence.likelihood:.0f}"),
        ("Probability, against leaving it out", likely),
    ]


def _rows(diagnosis: Diagnosis) -> list[ParameterRow]:
    """The simulation's first, then those of the causes as they are listed."""
    before, after = (_owned(stage.parameters) for stage in (diagnosis.baseline, diagnosis.extended))
    intervals = {
        f"{cause.name}.{key}": interval
        for cause in diagnosis.causes
        for key, interval in cause.parameters.items()
    }
    rows = []
    for key in dict.fromkeys([*before, *intervals, *after]):
        owner, _, name = key.rpartition(".")
        said = plain_value(name, after[key]) if key in after else ""
        if key in intervals:
            of = shown(name, intervals[key])
            said = " ".join(f"{of.value} {of.unit} ({of.interval})".split())
        old = plain_value(name, before[key]) if key in before else ""
        rows.append(ParameterRow(owner, split_unit(name)[0], old, said))
    return rows


def _owned(parameters: Mapping[str, float]) -> dict[str, float]:
    """By effect and name; those without an effect are of mass, damper and spring."""
    return {key if "." in key else f"mass_damper_spring.{key}": value for key, value in parameters.items()}
