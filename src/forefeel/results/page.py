"""report.html of a diagnosis: the verdict, one picture, each cause and its evidence, then details."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from forefeel.common.causes.candidate import base_name
from forefeel.common.causes.catalogue import cause_class, words
from forefeel.common.causes.model import ContactModel
from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.confirmation import Replay
from forefeel.diagnosis.diagnose import Diagnosed
from forefeel.diagnosis.plain_regressions import explained_share, strokes_in_band
from forefeel.diagnosis.prediction import Across
from forefeel.diagnosis.verdict import Diagnosis, Look
from forefeel.report.drawing import AxisUnit, Figure, Layer, binned, cloud, line, loop, panel, spec
from forefeel.report.template import render
from forefeel.report.wording import plain_value, shown
from forefeel.results.confirmation_text import confirmation_lines
from forefeel.results.curves import LEFT, MODEL, Curves, Rows, near, since_reversal
from forefeel.results.pictures import HEIGHT_PX, picture, sensor_picture, spectrum, timeline
from forefeel.results.verdict_text import (
    answer_lines,
    failure,
    follows_texts,
    gain_text,
    headline,
    next_steps,
    on_readings,
    stretch,
)

NOT_DRAWN = "A picture that failed"
_WORST_S = 5.0  # of the stretch that is drawn in full


def render_page(
    recording: Recording,
    diagnosed: Diagnosed,
    across: Across | str | None,
    given: ContactModel | None = None,
    replay: Replay | None = None,
    asked: Sequence[Figure] = (),
) -> str:
    """HTML page of a diagnosis; a figure that fails is one line in its place. `across`: the prediction, None,
    or why it failed; `given`: the simulation, None: the fitted one; `replay`: the model on another recording;
    `asked`: figures of the motion that was asked for.
    """
    diagnosis, curves = diagnosed.diagnosis, Curves.of(diagnosed.analysis, given)
    predicted = across if isinstance(across, Across) else None
    causes = {cause.name: cause for cause in diagnosis.causes}
    shown_names = causes or [name for name in diagnosis.suspected if name != "bias"]  # the simulation has one
    draws = {base_name(full): partial(picture, curves, full) for full in curves.analysis.fit.model}
    draws |= {of.name: partial(sensor_picture, curves.analysis, of) for of in curves.analysis.faults}
    details = {"What is left": [_draw(partial(draw, curves, diagnosis)) for draw in _LEFT_OVER]}
    if diagnosis.look is not None:
        details["The look before the search"] = [_draw(partial(_look, curves, diagnosis.look))]
    return render(
        "results/page.html.j2",
        recording=recording,
        diagnosis=diagnosis,
        across=predicted,
        headline=headline(diagnosis),
        steps=next_steps(diagnosis, across),
        said=answer_lines(diagnosis, across, None if given is None else given.name),
        confirmed=[] if replay is None else confirmation_lines(replay),
        replayed=None if replay is None else _draw(partial(_replayed, replay)),
        gain=gain_text(diagnosis.held_out),
        on_readings=on_readings(diagnosis),
        given=given,
        extends=curves.extends,
        asked=asked,
        picture_of_it=_draw(partial(_worst, curves, diagnosis)),
        sections=[(n, causes.get(n), _draw(draws[n]) if n in draws else None) for n in shown_names],
        details=details,
        follows=follows_texts(diagnosis),
        fingerprint=lambda name: cause_class(name).fingerprint,
        words=words,
        shown=shown,
        stretch=stretch,
        plain_value=plain_value,
    )


def render_figure(diagnosed: Diagnosed) -> str:
    """HTML page with nothing but measured, simulated and extended force."""
    curves = Curves.of(diagnosed.analysis, None)
    figure = _draw(partial(_worst, curves, diagnosed.diagnosis))
    return render("results/figure.html.j2", name=diagnosed.recording.name, figure=figure)


def _draw(draw: Callable[[], Figure]) -> Figure:
    """Draws a figure; one that fails is one line in its place."""
    try:
        return draw()
    except Exception as error:  # noqa: BLE001 - the page stands without it
        return Figure(NOT_DRAWN, failure(error), 0, ())


def worst_stretch(t: Floats, error_n: Floats, length_s: float = _WORST_S) -> tuple[float, float]:
    """Begin and end, in s as in `t`, of the slot of `length_s` with the largest mean square error. Slots lie
    end to end from the first row; one with half the rows of the fullest or fewer does not count.
    """
    error = error_n**2
    stretch = np.floor((t - t[0]) / length_s).astype(np.int64)
    total = np.bincount(stretch, error)
    count = np.bincount(stretch)
    mean = np.where(count > 0.5 * count.max(), total / np.maximum(count, 1), 0.0)
    start = float(t[0] + length_s * int(np.argmax(mean)))
    return start, min(start + length_s, float(t[-1]))


def _worst(curves: Curves, diagnosis: Diagnosis) -> Figure:
    """Figure of measured, simulated and extended force in the 5 s where the simulation errs most, and below
    of what is left there.
    """
    t = curves.t[curves.rows]
    start, end = worst_stretch(t, curves.before[curves.rows])
    rows = curves.rows[(t >= start) & (t <= end)]
    simulation = f"simulation ({'the given model' if curves.given else 'fitted'})"
    parts = [("measured", "measured", curves.force[rows]), (simulation, LEFT, curves.simulated[rows])]
    extended = "extended by the causes" if diagnosis.causes else "with what was tried"
    parts += [(extended, MODEL, curves.extended[rows])] if curves.extends else []
    above = timeline("force", curves.t[rows], parts, curves.gap_s, weight=2.5)
    caption = f"{start:.1f} to {end:.1f} s, where the simulation errs most; below, what is left of the force."
    drawn = spec([above, _residual(curves, diagnosis, rows)], unit="s")
    return Figure("Force, measured and simulated", caption, 440, (drawn,))


def _replayed(replay: Replay) -> Figure:
    """Figure of the forces in the 5 s of the other recording where the model errs most."""
    start, end = worst_stretch(replay.t, replay.force_n - replay.extended_n)
    rows = (replay.t >= start) & (replay.t <= end)
    parts = [
        ("measured", "measured", replay.force_n[rows]),
        ("simulation", LEFT, replay.simulated_n[rows]),
        ("extended by the causes", MODEL, replay.extended_n[rows]),
    ]
    drawn = spec(
        [timeline("force", replay.t[rows], parts if replay.confirmation.gain else parts[:2], 0.1)], unit="s"
    )
    caption = f"{replay.confirmation.recording}, {start:.1f} to {end:.1f} s, where the model errs most."
    return Figure("Force of the other recording, measured and simulated", caption, HEIGHT_PX, (drawn,))


def _residual(curves: Curves, diagnosis: Diagnosis, rows: Rows) -> Layer:
    """Measured less modelled force along time."""
    parts = [(name, colour, all_n[rows]) for name, colour, all_n in curves.left]
    return timeline("left", curves.t[rows], parts, curves.gap_s, 2.0 * (diagnosis.noise_floor_n or 0.0))


def _over_time(curves: Curves, diagnosis: Diagnosis) -> Figure:
    drawn = spec([_residual(curves, diagnosis, curves.rows)], unit="s")
    caption = (
        f"Below {curves.analysis.regression.signals.cutoff_hz:.0f} Hz, where motion and force are compared."
    )
    return Figure("Over time", caption, HEIGHT_PX, (drawn,))


def _over_motion(curves: Curves, _: Diagnosis) -> Figure:
    """Figure of the residuals, in three canvases: over position, speed, and distance since reversal with the
    sign of the direction.
    """
    rows, (direction, since) = curves.rows, since_reversal(curves)
    residual, specs = AxisUnit("left", "N", curves.before[curves.rows]), []
    y = near(residual, *(all_n[rows] for _, _, all_n in curves.left))
    columns = (
        ("position", "m", curves.x),
        ("speed", "m/s", curves.v),
        ("since reversal, by direction", "m", since * direction),
    )
    for label, unit, column in columns:
        across = AxisUnit(label, unit, column[rows])
        x, points, lines = across(column[rows]), [], []
        for name, colour, all_n in curves.left:
            points.append(cloud("", colour, x, residual(all_n[rows]), alpha=0.3))
            lines.append(line(name, colour, *binned(x, residual(all_n[rows]))))
        specs.append(spec([panel(residual.label, y, points=points, lines=lines)], label=across.label))
    caption = "Points, and their means in bins. A line that leaves zero is something missing."
    return Figure("Over position, speed and distance since reversal", caption, HEIGHT_PX, tuple(specs))


def _spectrum(curves: Curves, _: Diagnosis) -> Figure:
    caption = "A peak is periodic or swings; noise is flat or falls slowly."
    return Figure("Spectrum", caption, HEIGHT_PX, spectrum(curves, curves.left))


_LEFT_OVER = _over_time, _over_motion, _spectrum


def _look(curves: Curves, look: Look) -> Figure:
    """Figure of the force of the strokes over the position, as measured and by two plain regressions."""
    t, regression = curves.t[curves.rows], curves.analysis.regression
    x, measured, models = strokes_in_band(regression.signals, regression.motion({}), look)
    position, force = AxisUnit("position", "m", x), AxisUnit("force", "N", measured)
    some = np.abs(t - 0.5 * (t[0] + t[-1])) < 0.25 / look.slow_hz
    lines = [loop("measured", "measured", position(x[some]), force(measured[some]))]
    for (name, of), colour in zip(models.items(), (LEFT, MODEL), strict=True):
        text = f"{name}: {100 * explained_share(measured, of):.0f} %"
        lines.append(loop(text, colour, position(x[some]), force(of[some])))
    points = [cloud("", "soft", position(x), force(measured), alpha=0.4)]
    caption = (
        f"Above {look.slow_hz:.2g} Hz; some strokes as lines, shares of held-out blocks. Ways that stay "
        "apart where the motion turns are friction, a bend is stiffening."
    )
    drawn = spec(
        [panel(force.label, near(force, measured), points=points, lines=lines)], label=position.label
    )
    return Figure("The force of the strokes over the position", caption, 340, (drawn,))
