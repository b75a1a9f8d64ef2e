"""report.html of a diagnosis: the verdict in words, what is wrong in figures, each cause and its evidence."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from forefeel.common.causes.candidate import base_name
from forefeel.common.causes.catalogue import fingerprint, words
from forefeel.common.causes.model import ContactModel
from forefeel.common.error_size import Floats
from forefeel.common.events.text import quantity
from forefeel.common.recording.recording import Recording
from forefeel.diagnose.answer import failure, gain_text, headline, on_readings, said
from forefeel.diagnose.curves import TRIM, Curves, Rows, density, rms
from forefeel.diagnose.pictures import picture, sensor_picture
from forefeel.diagnosis.diagnose import Diagnosed
from forefeel.diagnosis.look import explained_share, strokes
from forefeel.diagnosis.prediction import Across
from forefeel.diagnosis.verdict import Cause, Diagnosis, Evidence, Look
from forefeel.report.svg_drawing import (
    BINS,
    BLACK,
    BLUE,
    GREY,
    ORANGE,
    AxisUnit,
    Drawing,
    band_about_zero,
    bars,
    cloud,
    common_legend,
    drawn,
    finish,
    limit_y,
    means,
    new_figure,
    one_plot,
    plain_numbers,
    plot,
    styled,
)
from forefeel.report.template import render
from forefeel.report.wording import Shown, plain_value, shown, split_unit

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
NOT_DRAWN = "A picture that failed"

Value = TypeVar("Value")
_DETAIL_S = 5.0  # of the worst stretch
_SIMULATION = "simulation"


@dataclass(frozen=True, slots=True)
class CauseSection:
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
    across: Across | str | None,
    given: ContactModel | None = None,
) -> str:
    """The diagnosis with its figures as one HTML file that needs nothing else."""
    diagnosis, curves = diagnosed.diagnosis, Curves.of(diagnosed.analysis, given)
    return render(
        "diagnose/page.html.j2",
        recording=recording,
        diagnosis=diagnosis,
        across=across if isinstance(across, Across) else None,
        headline=headline(diagnosis),
        said=said(diagnosis, across, None if given is None else given.name),
        gain=gain_text(diagnosis.held_out),
        on_readings=on_readings(diagnosis),
        on_readings_label=ON_READINGS,
        given=given is not None,
        extends=curves.extends,
        look=diagnosis.look and _attempted(partial(_look, recording.name, curves, diagnosis.look)),
        causes=[_section(recording.name, curves, cause) for cause in diagnosis.causes],
        suspects=[] if diagnosis.causes else _suspects(recording.name, curves, diagnosis),
        rows=_rows(diagnosis),
        drawings=drawings(recording.name, curves, diagnosis),
    )


def _section(stem: str, curves: Curves, cause: Cause) -> CauseSection:
    parameters = [shown(name, interval) for name, interval in cause.parameters.items()]
    explained = ("Its share of the force, rms", quantity(cause.explained_n, "N"))
    evidence = [explained, *_evidence(cause.evidence)]
    form, drawing = _drawn(stem, curves, cause.name)
    return CauseSection(
        cause.name, words(cause.name), _fingerprint(cause.name), form, parameters, evidence, drawing
    )


def _suspects(stem: str, curves: Curves, diagnosis: Diagnosis) -> list[CauseSection]:
    """What the search put into its model while the verdict names nothing; the simulation has a bias."""
    found = [(name, *_drawn(stem, curves, name)) for name in diagnosis.suspected if name != "bias"]
    return [
        CauseSection(name, words(name), _fingerprint(name), form, [], [], drawing)
        for name, form, drawing in found
    ]


def _drawn(stem: str, curves: Curves, name: str) -> tuple[str, Drawing | None]:
    """(what its form says, its picture)."""
    for fault in curves.analysis.faults:
        if fault.name == name:
            return "", _attempted(partial(sensor_picture, stem, curves.analysis, fault))
    for full in curves.analysis.fit.model:
        if base_name(full) == name:
            form = _FORMS.get(full.partition(":")[2], "")
            return form, _attempted(partial(picture, stem, curves, full))
    return "", None


def _fingerprint(name: str) -> str:
    """What the effect says of itself, ours or of another distribution."""
    text = fingerprint(name)
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def _evidence(evidence: Evidence) -> list[tuple[str, str]]:
    """The held-out gain; a fault of the sensor is seen on the readings themselves."""
    if evidence.gain:
        ends = f"{100 * evidence.gain_low:.0f} to {100 * evidence.gain_high:.0f} %"
        return [("Error on held-out blocks, less by", f"{100 * evidence.gain:.0f} % ({ends})")]
    return [] if evidence.likelihood else [(ON_READINGS, evidence.words)]


def _rows(diagnosis: Diagnosis) -> list[ParameterRow]:
    """The simulation's first, then those of the causes as they are listed."""
    before, after = (_owned(stage.parameters) for stage in (diagnosis.baseline, diagnosis.extended))
    intervals = {
        f"{cause.name}.{key}": interval
        for cause in diagnosis.causes
        for key, interval in cause.parameters.items()
    }
    intervals = _owned(diagnosis.extended.intervals) | intervals
    rows = []
    for key in dict.fromkeys([*before, *intervals, *after]):
        owner, _, name = key.rpartition(".")
        new = plain_value(name, after[key]) if key in after else ""
        if key in intervals:
            of = shown(name, intervals[key])
            new = " ".join(f"{of.value} {of.unit} ({of.interval})".split())
        old = plain_value(name, before[key]) if key in before else ""
        rows.append(ParameterRow(owner, split_unit(name)[0], old, new))
    return rows


def _owned(parameters: Mapping[str, Value]) -> dict[str, Value]:
    """By effect and name; those without an effect are of mass, damper and spring."""
    return {key if "." in key else f"mass_damper_spring.{key}": value for key, value in parameters.items()}


@styled()
def drawings(stem: str, curves: Curves, diagnosis: Diagnosis) -> list[Drawing]:
    """Force over time and its worst stretch; what is left over time, over the motion, its spectrum, its
    size.
    """
    attempts = (
        partial(_force, stem, curves),
        partial(_detail, stem, curves),
        partial(_over_time, stem, curves, diagnosis),
        partial(_over_motion, stem, curves),
        partial(_spectrum, stem, curves),
        partial(_sizes, stem, curves, diagnosis),
    )
    return [_attempted(attempt) for attempt in attempts]


def _attempted(draw: Callable[[], Value]) -> Value | Drawing:
    """A picture that fails is one line in its place."""
    try:
        return draw()
    except Exception as error:  # noqa: BLE001 - the page stands without it
        return Drawing(NOT_DRAWN, failure(error), "")


@styled()
def _look(stem: str, curves: Curves, seen: Look) -> Drawing:
    t, regression = curves.t[curves.rows], curves.analysis.regression
    x, measured, models = strokes(regression.signals, regression.motion({}), seen)
    lines = {"measured": measured}
    lines |= {f"{name}: {100 * explained_share(measured, of):.0f} %": of for name, of in models.items()}
    figure, axes = one_plot(3.4)
    position, force = AxisUnit("position", "m", x), AxisUnit("force", "N", measured)
    cloud(axes, position(x), force(measured), GREY, size=3.0)
    some = np.flatnonzero(np.abs(t - 0.5 * (t[0] + t[-1])) < 1.0 / seen.slow_hz)
    some = some[:: max(1, len(some) // BINS)]
    for (name, values), colour in zip(lines.items(), (BLACK, ORANGE, BLUE), strict=True):
        axes.plot(position(x[some]), force(values[some]), color=colour, label=name)
    limit_y(axes, force(measured), trim=TRIM, zero=True)
    finish(axes, position.label, force.label)
    first_s, *_, last_s = t[some].tolist()
    caption = (
        f"Above {seen.slow_hz:.2g} Hz: all as points, {first_s:.1f} to {last_s:.1f} s as lines; shares of "
        "held-out blocks. Ways that stay apart where the motion turns are friction, a bend is stiffening."
    )
    return drawn(figure, stem, "The force of the strokes over the position", caption)


def named(curves: Curves) -> str:
    return f"{_SIMULATION} ({'the given model' if curves.given else 'mass, damper, spring, bias'})"


def worst_stretch(curves: Curves, length_s: float = _DETAIL_S) -> tuple[float, float]:
    """From when to when the simulation errs most, in s since the start."""
    t, error = curves.t[curves.rows], curves.before[curves.rows] ** 2
    stretch = np.floor((t - t[0]) / length_s).astype(np.int64)
    total = np.bincount(stretch, error)
    count = np.bincount(stretch)
    mean = np.where(count > 0.5 * count.max(), total / np.maximum(count, 1), 0.0)
    start = float(t[0] + length_s * int(np.argmax(mean)))
    return start, min(start + length_s, float(t[-1]))


def _force(stem: str, curves: Curves) -> Drawing:
    band = curves.analysis.regression.signals.cutoff_hz
    caption = f"The whole recording below {band:.0f} Hz, the band in which motion and force are compared."
    return _forces(stem, curves, "Simulation and measurement", caption, curves.rows)


def _detail(stem: str, curves: Curves) -> Drawing:
    start, end = worst_stretch(curves)
    t = curves.t[curves.rows]
    rows = curves.rows[(t >= start) & (t <= end)]
    caption = f"{start:.1f} to {end:.1f} s, the stretch with the largest error."
    return _forces(stem, curves, "Where the simulation errs most", caption, rows)


def _forces(stem: str, curves: Curves, title: str, caption: str, rows: Rows) -> Drawing:
    figure, axes = one_plot(2.9)
    force = AxisUnit("force", "N", curves.force[rows])
    simulated, measured, extended = (
        force(values[rows]) for values in (curves.simulated, curves.force, curves.extended)
    )
    limit_y(axes, simulated, measured, extended, trim=TRIM, zero=True)
    gap_s = _gap_s(curves)
    plot(axes, curves.t[rows], measured, BLACK, "measured", width=2.0, gap_s=gap_s)
    plot(axes, curves.t[rows], simulated, ORANGE, named(curves), gap_s=gap_s)
    if curves.extends:
        plot(axes, curves.t[rows], extended, BLUE, "extended by the causes", gap_s=gap_s)
    finish(axes, "time in s", force.label)
    return drawn(figure, stem, title, caption)


def _over_time(stem: str, curves: Curves, diagnosis: Diagnosis) -> Drawing:
    rows, (figure, axes) = curves.rows, one_plot(2.5)
    residual = AxisUnit("residual", "N", curves.before[rows])
    limit_y(axes, *(residual(values[rows]) for values, _, _ in _left(curves)), trim=TRIM, zero=True)
    if diagnosis.noise_floor_n is not None:
        band_about_zero(axes, 2.0 * float(residual(diagnosis.noise_floor_n)), "± 2 x noise")
    for values, colour, name in _left(curves):
        plot(axes, curves.t[rows], residual(values[rows]), colour, name, gap_s=_gap_s(curves))
    finish(axes, "time in s", residual.label)
    return drawn(figure, stem, "What is left over time", "Measured less modelled force.")


def _over_motion(stem: str, curves: Curves) -> Drawing:
    rows = curves.rows
    columns = {
        ("position", "m"): curves.x,
        ("speed", "m/s"): curves.v,
        ("distance since reversal, by direction,", "m"): curves.since * curves.direction,
    }
    figure = new_figure(3.1)
    residual = AxisUnit("residual", "N", curves.before[rows])
    grid = figure.subplots(1, 3, sharey=True)
    for axes, ((label, unit), column) in zip(grid, columns.items(), strict=True):
        across = AxisUnit(label, unit, column[rows])
        for values, colour, name in _left(curves):
            cloud(axes, across(column[rows]), residual(values[rows]), colour)
            axes.plot(
                *means(across(column[rows]), residual(values[rows])),
                color=colour,
                linewidth=2.2,
                label=name,
                zorder=3,
            )
        axes.locator_params(axis="x", nbins=6)
        finish(axes, across.label, residual.label if axes is grid[0] else "", legend=False)
    common_legend(figure, grid[0])
    limit_y(grid[0], *(residual(values[rows]) for values, _, _ in _left(curves)), trim=TRIM, zero=True)
    caption = "Points, and their means in bins. A line that leaves zero is something missing."
    return drawn(figure, stem, "What is left over position, speed and distance since reversal", caption)


def _spectrum(stem: str, curves: Curves) -> Drawing:
    figure, axes = one_plot(2.6)
    for values, colour, name in _left(curves):
        axes.loglog(*density(curves.analysis.regression.signals, values), color=colour, label=name)
    plain_numbers(axes.xaxis, axes.yaxis)
    finish(axes, "frequency in Hz", "residual in N/√Hz")
    caption = "A peak is periodic or swings; noise is flat or falls slowly."
    return drawn(figure, stem, "Spectrum of what is left", caption)


def _sizes(stem: str, curves: Curves, diagnosis: Diagnosis) -> Drawing:
    rows = curves.rows
    first, *more = [(name, rms(values[rows]), colour) for values, colour, name in _left(curves)]
    shown = [first, *((cause.name, cause.explained_n, GREY) for cause in diagnosis.causes), *more]
    if diagnosis.noise_floor_n is not None:
        shown.append(("noise, at most", diagnosis.noise_floor_n, BLACK))
    figure = new_figure(0.75 + 0.33 * len(shown))
    bars(figure.subplots(), *(list(column) for column in zip(*shown, strict=True)))
    caption = (
        "rms. Grey is what the error on held-out blocks loses by one cause alone; squares add up, not bars."
    )
    return drawn(figure, stem, "How large it is", caption)


def _left(curves: Curves) -> list[tuple[Floats, str, str]]:
    """(what is left in N, colour, name) of the simulation, and of the extended model where it is another."""
    found = [(curves.before, ORANGE, f"left by the {_SIMULATION}")]
    return [*found, (curves.after, BLUE, "left by the extended model")] if curves.extends else found


def _gap_s(curves: Curves) -> float:
    return max(0.1, 3.0 / curves.analysis.regression.signals.coarse_rate_hz)
