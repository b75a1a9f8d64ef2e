"""One picture for each cause: what is left without it, against the variable in which it shows, and the cause
itself over that.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from forefeel.common.error_size import Floats
from forefeel.diagnose.drawing import Axis, cloud, density, drawn, finish, logarithmic, medians, span
from forefeel.diagnose.parts import Parts, rms, share_of, strokes
from forefeel.diagnose.phase import phase
from forefeel.diagnose.units import plain_value
from forefeel.diagnosis.diagnose.candidates import Shape, base_name
from forefeel.diagnosis.diagnose.regression import ModelFit, RecordingRegression
from forefeel.diagnosis.diagnose.signals import Mask
from forefeel.report.svg import BLUE, GREY, ORANGE, VERMILION, Drawing, new_figure, plot, styled

WIDTH_IN, HEIGHT_IN = 6.2, 3.1
_FINE = 120
_WITHOUT = "left without it"
_OWN = "the cause"
_TREMOR = 0.5
"""Of a cause's length: a hand that trembles by less does not reverse."""


@dataclass(frozen=True, slots=True, eq=False)
class Component:
    """A cause within a fit: its own force, and that force with what the whole model leaves; rows that
    count.
    """

    parts: Parts
    name: str
    shape: Shape
    own: Floats
    left: Floats

    @classmethod
    def of(cls, parts: Parts, name: str) -> "Component":
        """Of a cause by the name of its form."""
        analysis = parts.analysis
        own = share_of(analysis.regression, analysis.fit, name)[parts.rows]
        return cls(parts, name, analysis.fit.model[name], own, own + parts.after[parts.rows])

    def column(self, values: Floats) -> Floats:
        """A column of the parts at the rows that count."""
        return np.asarray(values[self.parts.rows])


def picture(stem: str, parts: Parts, name: str) -> Drawing:
    """Of a cause of the model, by the name of its form; over time where no other picture suits it."""
    draw = _PICTURES.get(name, _PICTURES.get(base_name(name), _time))
    with styled():
        return draw(f"{stem} {name}", Component.of(parts, name))


def _against(
    stem: str,
    of: Component,
    x: Floats,
    label: tuple[str, str],
    y: tuple[Floats, Floats],
    title: str,
    caption: str,
) -> Drawing:
    """y = (left, own) over x as points and a line."""
    figure = new_figure(HEIGHT_IN, WIDTH_IN)
    axes = figure.subplots()
    left, own = y
    across, force = Axis(*label, x), Axis("force", "N", left)
    span(axes, force(left), force(own))
    cloud(axes, across(x), force(left), ORANGE, size=3.6)
    axes.plot([], [], ".", color=ORANGE, label=_WITHOUT)
    axes.plot(*medians(across(x), force(own), _FINE), color=BLUE, linewidth=1.5, label=_OWN, zorder=3)
    finish(axes, across.label, force.label)
    return drawn(figure, stem, title, caption)


def _speed(stem: str, of: Component) -> Drawing:
    title = "Over the speed"
    caption = "A jump at zero is dry friction, a slope damping, a bend drag, a peak at low speed Stribeck's."
    return _against(stem, of, of.column(of.parts.v), ("speed", "m/s"), (of.left, of.own), title, caption)


def _position(stem: str, of: Component) -> Drawing:
    title, caption = (
        "Over the position",
        "The same curve on the way in and out: a spring that is not straight.",
    )
    return _against(stem, of, of.column(of.parts.x), ("position", "m"), (of.left, of.own), title, caption)


def _contact(stem: str, of: Component) -> Drawing:
    """The spring's force with what is left: nothing before the contact, a slope behind it."""
    regression, fit = of.parts.analysis.regression, of.parts.analysis.fit
    spring = regression.block(fit.model, "", ())[:, 2] * fit.coefficients[2]
    own = of.column(spring)
    y = own + of.column(of.parts.after), own
    title, caption = "The elastic force over the position", "Nothing before the contact, a slope behind it."
    return _against(stem, of, of.column(of.parts.x), ("position", "m"), y, title, caption)


def _since(stem: str, of: Component) -> Drawing:
    """By direction, so that both branches lie on each other."""
    length = max(of.shape, default=0.0)
    direction, since = (of.column(values) for values in strokes(of.parts, _TREMOR * length))
    near = (direction != 0.0) & (since <= _reach(of, since))
    resists = of.parts.analysis.regression.sense * direction[near]
    y = of.left[near] * resists, of.own[near] * resists
    title = "Over the distance since the last reversal"
    caption = (
        f"Both directions laid on each other; positive resists the motion. Ways back of less than "
        f"{plain_value('way_m', _TREMOR * length)} are no reversal here."
    )
    return _against(stem, of, since[near], ("distance since reversal", "m"), y, title, caption)


def _reach(of: Component, since: Floats) -> float:
    """Some lengths of the cause, or all that was travelled."""
    most = float(np.quantile(since, 0.98)) if len(since) else 0.0
    return min(most, 8.0 * max(of.shape)) if of.shape else most


def _groups(
    stem: str,
    of: Component,
    x: Floats,
    label: tuple[str, str],
    groups: Mapping[str, Mask],
    words: tuple[str, str],
) -> Drawing:
    """Points and the cause's line for each group of rows, in a colour of its own."""
    figure = new_figure(HEIGHT_IN, WIDTH_IN)
    axes = figure.subplots()
    across, force = Axis(*label, x), Axis("force", "N", of.left)
    span(axes, force(of.left), force(of.own))
    for (name, rows), colour in zip(groups.items(), (ORANGE, BLUE), strict=False):
        if np.count_nonzero(rows) > _FINE:
            cloud(axes, across(x[rows]), force(of.left[rows]), colour, size=3.0)
            line = medians(across(x[rows]), force(of.own[rows]), _FINE)
            axes.plot(*line, color=colour, linewidth=1.8, label=f"{_OWN}, {name}", zorder=3)
    finish(axes, across.label, force.label)
    return drawn(figure, stem, *words)


def _along(stem: str, of: Component) -> Drawing:
    direction = of.column(of.parts.direction)
    groups = {"inserting": direction > 0.5, "withdrawing": direction < -0.5}
    words = (
        "Over the position, by direction",
        "Points: what is left without it. A jump that grows with the depth.",
    )
    return _groups(stem, of, of.column(of.parts.x), ("position", "m"), groups, words)


def _deep(stem: str, of: Component) -> Drawing:
    x = of.column(of.parts.x)
    low, high = np.quantile(x, (1.0 / 3.0, 2.0 / 3.0))
    words = (
        "Over the speed, by depth",
        "Points: what is left without it. A slope that is steeper where it is deep.",
    )
    groups = {"shallow third": x < low, "deep third": x > high}
    return _groups(stem, of, of.column(of.parts.v), ("speed", "m/s"), groups, words)


def _time(stem: str, of: Component) -> Drawing:
    start, end = _window(of)
    t = of.column(of.parts.t)
    rows = (t >= start) & (t <= end)
    figure = new_figure(HEIGHT_IN, WIDTH_IN)
    axes = figure.subplots()
    force = Axis("force", "N", of.left[rows])
    span(axes, force(of.left[rows]), force(of.own[rows]), least=0.0)
    plot(axes, t[rows], force(of.left[rows]), ORANGE, _WITHOUT, width=3.0)
    plot(axes, t[rows], force(of.own[rows]), BLUE, _OWN)
    if base_name(of.name) == "stiffness_change" and start < of.shape[0] < end:
        axes.axvline(of.shape[0], color=VERMILION, linewidth=1.4, label="the change")
    finish(axes, "time in s", force.label)
    whole = end - start >= 0.99 * float(t[-1] - t[0])
    return drawn(figure, stem, "Over time", "The whole recording." if whole else "Where it is largest.")


def _window(of: Component) -> tuple[float, float]:
    """All of the time, or where a force that fades is largest."""
    t = of.column(of.parts.t)
    if base_name(of.name) != "stress_relaxation" or not of.shape:
        return float(t[0]), float(t[-1])
    whole = float(t[-1] - t[0])
    length = min(whole, max(6.0, 8.0 * max(of.shape)))
    starts = t[0] + length * np.arange(max(1, int(whole / length)))
    inside = [(t >= start) & (t <= start + length) for start in starts]
    start = float(starts[int(np.argmax([rms(of.own[rows]) if rows.any() else 0.0 for rows in inside]))])
    return start, start + length


def _folded(stem: str, of: Component) -> Drawing:
    period = 1.0 / of.shape[0]
    x = of.column(of.parts.t) % period
    title, caption = (
        "Folded on its period",
        f"Every {period:.3g} s laid on the others; shown from 0 to one period.",
    )
    return _against(stem, of, x, ("time within the period", "s"), (of.left, of.own), title, caption)


def _peak(stem: str, of: Component) -> Drawing:
    parts = of.parts
    signals, own = parts.analysis.regression.signals, np.zeros_like(parts.t)
    own[parts.rows] = of.own
    figure = new_figure(HEIGHT_IN, WIDTH_IN)
    axes = figure.subplots()
    axes.loglog(*density(signals, own + parts.after), color=ORANGE, label=_WITHOUT)
    axes.loglog(*density(signals, own), color=BLUE, label=_OWN)
    axes.loglog(*density(signals, parts.after), color=GREY, label="left with it")
    axes.axvline(of.shape[0], color=VERMILION, linewidth=1.0)
    logarithmic(axes)
    finish(axes, "frequency in Hz", "force in N/√Hz")
    return drawn(figure, stem, "Spectrum", f"The peak at {of.shape[0]:.3g} Hz (line).")


def _phase(stem: str, of: Component) -> Drawing:
    regression: RecordingRegression = of.parts.analysis.regression
    fit: ModelFit = of.parts.analysis.fit
    return phase(stem, regression, fit, of.name)


_PICTURES: Mapping[str, Callable[[str, Component], Drawing]] = {
    "coulomb_friction": _speed,
    "stribeck_friction": _speed,
    "quadratic_drag": _speed,
    "asymmetric_damping": _speed,
    "hunt_crossley_damping": _deep,
    "stiffening": _position,
    "contact_loss": _contact,
    "position_dependent_friction": _along,
    "presliding_hysteresis": _since,
    "backlash": _since,
    "bias": _time,
    "stress_relaxation": _time,
    "sensor_drift": _time,
    "stiffness_change": _time,
    "pulsation": _folded,
    "unmodelled_resonance": _peak,
    "unmodelled_resonance:fixture": _phase,
    "time_delay": _phase,
    "sensor_lag": _phase,
}
