"""One picture for each cause: what is left without it, against the variable in which it shows, and the cause
itself over that. A fault of the sensor is shown on the force as recorded.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from forefeel.common.causes.candidate import base_name
from forefeel.common.causes.catalogue import CANDIDATES
from forefeel.common.causes.periodic import MainsHum
from forefeel.common.causes.wall import StiffnessChange
from forefeel.common.error_size import Floats
from forefeel.common.events.text import shown_unit
from forefeel.diagnosis.analysis import Analysis
from forefeel.diagnosis.regression import alignment
from forefeel.diagnosis.signals import Mask
from forefeel.diagnosis.verdict import Cause
from forefeel.report.drawing import DOTTED, AxisUnit, Figure, Layer, binned, cloud, line, panel, spec
from forefeel.results.curves import (
    LEFT,
    MODEL,
    Curves,
    Part,
    density,
    force_of_cause,
    near,
    response,
    since_reversal,
)

HEIGHT_PX = 280
Specs = tuple[Layer, ...]
_FINE = 120  # bins of a cause's own line
_WITHOUT, _CAUSE = "left without it", "the cause"
_TREMOR = 0.5  # of a cause's length: a hand that trembles by less does not reverse

_HIGHEST = 3.0  # ratio of forces that is shown
_AROUND_S = 2.0  # s to each side of the largest reading
_HUMS_S = 0.15  # the same where the mains hum


class Component:
    """A cause within a fit, by the name of its form, at the rows that count: `cause_n`, its force in N, and
    `left`, that force with what the whole model leaves.
    """

    def __init__(self, curves: Curves, name: str) -> None:
        regression, fit, rows = curves.analysis.regression, curves.analysis.fit, curves.rows
        self.curves, self.name, self.shape = curves, name, fit.model[name]
        self.cause_n = force_of_cause(regression, fit, name)[rows]
        self.left = self.cause_n + curves.after[rows]
        self.x: Part = "position", "m", curves.x[rows]
        self.v: Part = "speed", "m/s", curves.v[rows]


def picture(curves: Curves, name: str) -> Figure:
    """Figure of a cause of the fitted model over the variable in which it shows: what is left without it, and
    its own force. `name`: of its form.
    """
    draw, title, caption = _PICTURES[CANDIDATES[name].picture]
    return Figure(title, caption, HEIGHT_PX, draw(Component(curves, name)))


def sensor_picture(analysis: Analysis, fault: Cause) -> Figure:
    """Figure of a fault of the sensor along time: the readings about the one furthest from the median, as
    recorded and as cleaned for the comparison.
    """
    raw, t = analysis.recording.force_n, analysis.recording.time_s - analysis.recording.time_s[0]
    assert raw is not None
    around_s = _HUMS_S if fault.name == MainsHum.name else _AROUND_S
    rows = np.abs(t - t[int(np.argmax(np.abs(raw - np.median(raw))))]) < around_s
    parts = ("as recorded", LEFT, raw[rows]), ("as compared", MODEL, analysis.cleaned.force_n[rows])
    drawn = spec([timeline("force", t[rows], parts, _AROUND_S)], unit="s")
    return Figure("Over time", "About the largest reading.", HEIGHT_PX, (drawn,))


def timeline(
    label: str, t: Floats, parts: Sequence[Part], gap_s: float, within_n: float | None = None, **more: object
) -> Layer:
    """Panel of forces along time, a line for each of `parts`; the unit's prefix suits the first. `within_n`:
    shows zero, and shades up to so far from it. `more`: other fields of the panel.
    """
    unit = AxisUnit(label, "N", *(values for _, _, values in parts[:1]))
    lines = [
        line(name, colour, t, unit(values), gap_s, **(DOTTED if colour == "measured" else {}))
        for name, colour, values in parts
    ]
    size = float(unit(within_n or 0.0))
    rows = np.array([[t[0], -size, size], [t[-1], -size, size]])
    bands = [{"name": "± 2 × noise", "colour": "soft", "rows": rows}] if size else []
    y = near(unit, *(values for _, _, values in parts), zero=within_n is not None)
    return panel(unit.label, y, lines=lines, bands=bands, **more)


def _over(x: Part, left: Floats, cause_n: Floats, groups: Mapping[str, Mask] | None = None) -> Specs:
    """Canvas over x: the residual without the cause, `left`, as points, and the cause as a line of medians.
    `groups`: rows by name, two at most, each in a colour; a group of 120 rows or fewer is not drawn.
    """
    across, force = AxisUnit(*x), AxisUnit("force", "N", left)
    points, lines = [], []
    for (name, rows), colour in zip((groups or {"": np.isfinite(left)}).items(), (LEFT, MODEL), strict=False):
        if not groups or np.count_nonzero(rows) > _FINE:
            at = across(x[2][rows])
            points.append(cloud("" if groups else _WITHOUT, colour, at, force(left[rows]), alpha=0.4))
            middle = binned(at, force(cause_n[rows]), _FINE, np.median)
            lines.append(line(f"{_CAUSE}{name}", colour if groups else MODEL, *middle))
    drawn = panel(force.label, near(force, left, cause_n), points=points, lines=lines)
    return (spec([drawn], label=across.label),)


def _contact(of: Component) -> Specs:
    """Canvas over the position of the spring's force, and as points with what the model leaves."""
    regression, fit = of.curves.analysis.regression, of.curves.analysis.fit
    spring_n = (regression.block(fit.model, "", ())[:, 2] * fit.coefficients[2])[of.curves.rows]
    return _over(of.x, spring_n + of.left - of.cause_n, spring_n)


def _since(of: Component) -> Specs:
    """Canvas of residual and cause over the distance since reversal, the forces multiplied by the direction,
    so that both branches lie on each other and positive resists; the furthest distances are left out.
    """
    length = max(of.shape, default=0.0)
    direction, since = (values[of.curves.rows] for values in since_reversal(of.curves, _TREMOR * length))
    most = float(np.quantile(since, 0.98)) if len(since) else 0.0
    rows = (direction != 0.0) & (since <= (min(most, 8.0 * length) if of.shape else most))
    resists = of.curves.analysis.regression.sense * direction[rows]
    x = "distance since reversal", "m", since[rows]
    return _over(x, of.left[rows] * resists, of.cause_n[rows] * resists)


def _along(of: Component) -> Specs:
    direction = since_reversal(of.curves)[0][of.curves.rows]
    groups = {", inserting": direction > 0.0, ", withdrawing": direction < 0.0}
    return _over(of.x, of.left, of.cause_n, groups)


def _deep(of: Component) -> Specs:
    low, high = np.quantile(of.x[2], (1.0 / 3.0, 2.0 / 3.0))
    groups = {", shallow third": of.x[2] < low, ", deep third": of.x[2] > high}
    return _over(of.v, of.left, of.cause_n, groups)


def _time(of: Component) -> Specs:
    parts = (_WITHOUT, LEFT, of.left), (_CAUSE, MODEL, of.cause_n)
    changes = base_name(of.name) == StiffnessChange.name
    at = [{"name": "the change", "colour": "bad", "at": of.shape[0]}] if changes else []
    drawn = timeline("force", of.curves.t[of.curves.rows], parts, of.curves.gap_s, 0.0, rules=at)
    return (spec([drawn], unit="s"),)


def _folded(of: Component) -> Specs:
    x = "time within the period", "s", of.curves.t[of.curves.rows] % (1.0 / of.shape[0])
    return _over(x, of.left, of.cause_n)


def _peak(of: Component) -> Specs:
    curves, after, cause_n = of.curves, of.curves.after, np.zeros_like(of.curves.t)
    cause_n[curves.rows] = of.cause_n
    parts = (_WITHOUT, LEFT, cause_n + after), (_CAUSE, MODEL, cause_n), ("left with it", "soft", after)
    return spectrum(curves, parts, of.shape[0])


def spectrum(curves: Curves, parts: Sequence[Part], *peaks_hz: float) -> Specs:
    """Canvas of the amplitude densities of `parts` over the frequency, with a rule at each peak."""
    signals = curves.analysis.regression.signals
    lines = [line(name, colour, *density(signals, values)) for name, colour, values in parts]
    rules = [{"colour": "bad", "at": peak_hz} for peak_hz in peaks_hz]
    drawn = panel(f"force, {shown_unit('N')}/√Hz", {"log": True}, lines=lines, rules=rules)
    return (spec([drawn], log=True, unit="Hz"),)


def _phase(of: Component) -> Specs:
    """Canvases of phase and size of the ratio of the measured force to the model's without the cause, over
    the frequencies where both are coherent, beside the law of the cause.
    """
    frequency, ratio = response(of.curves.analysis.regression, of.curves.analysis.fit, of.name)
    hz = np.linspace(0.0, float(frequency.max(initial=1.0)), 400)
    law = alignment(2.0 * np.pi * hz, {of.name: of.shape})
    assert law is not None
    angle = np.unwrap(np.angle(law))
    beside = np.interp(frequency, hz, angle)  # of several turns the one beside the law
    measured = beside + np.angle(ratio * np.exp(-1j * beside))
    most = min(_HIGHEST, 1.2 * max(1.0, float(np.abs(law).max()), *np.abs(ratio).tolist()))
    specs = []
    for label, y, dots, law_y in (
        ("phase, degrees", None, np.degrees(measured), np.degrees(angle)),
        ("measured / modelled", {"min": 0.0, "max": most}, np.abs(ratio), np.abs(law)),
    ):
        points = [cloud("measured", LEFT, frequency, dots, size=3, alpha=1)]
        specs.append(
            spec([panel(label, y, points=points, lines=[line(_CAUSE, MODEL, hz, law_y)])], unit="Hz")
        )
    return tuple(specs)


_PICTURES: Mapping[str, tuple[Callable[[Component], Specs], str, str]] = {
    "contact": (_contact, "The elastic force over the position",
                "Nothing before the contact, a slope behind it."),
    "depth": (_deep, "Over the speed, by depth",
              "Points: what is left without it. A slope that is steeper where it is deep."),
    "direction": (_along, "Over the position, by direction",
                  "Points: what is left without it. A jump that grows with the depth."),
    "memory": (_along, "Over the position, by direction",
               "Points: what is left without it. The way out has less force than the way in, or none."),
    "period": (_folded, "Folded on its period", "All periods laid on each other."),
    "phase": (_phase, "Phase and size over the frequency",
              "A delay turns the phase evenly with the frequency, a lag by 90 degrees at most."),
    "position": (lambda of: _over(of.x, of.left, of.cause_n), "Over the position",
                 "The same curve on the way in and out: a spring that is bent, or a force of the place."),
    "reversal": (_since, "Over the distance since the last reversal",
                 "Both directions laid on each other; positive resists the motion."),
    "spectrum": (_peak, "Spectrum", "The line: its frequency."),
    "speed": (lambda of: _over(of.v, of.left, of.cause_n), "Over the speed",
              "A jump at zero is dry friction, a slope damping, a bend drag, a peak when slow Stribeck's."),
    "time": (_time, "Over time", "The whole recording."),
}  # fmt: skip
"""By the variable in which a cause shows, see `Candidate.picture`."""
