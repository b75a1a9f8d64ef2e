"""One picture for each cause: what is left without it, against the variable in which it shows, and the cause
itself over that. One for each fault of the sensor, on the force as recorded.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import welch

from forefeel.common.causes.candidate import Shape, base_name
from forefeel.common.causes.catalogue import CANDIDATES
from forefeel.common.error_size import Floats
from forefeel.diagnose.curves import TRIM, Curves, density, response, rms, share_of, strokes
from forefeel.diagnosis.analysis import Analysis
from forefeel.diagnosis.regression import alignment
from forefeel.diagnosis.signals import Mask
from forefeel.diagnosis.verdict import Cause
from forefeel.report.svg_drawing import (
    BLUE,
    GREY,
    ORANGE,
    VERMILION,
    AxisUnit,
    Drawing,
    cloud,
    common_legend,
    drawn,
    finish,
    limit_y,
    medians,
    new_figure,
    one_plot,
    plain_numbers,
    plot,
    styled,
)
from forefeel.report.wording import plain_value

_WIDTH_IN, _HEIGHT_IN = 6.2, 3.1  # beside the numbers of its cause
_FINE = 120  # bins of a cause's own line
_WITHOUT = "left without it"
_OWN = "the cause"
_TREMOR = 0.5
"""Of a cause's length: a hand that trembles by less does not reverse."""

_HIGHEST = 3.0  # ratio of forces that is shown
_LEVELS = 8  # of a quantised force, shown to each side of the middle
_AROUND_HZ = 20.0  # of a line of the mains, to each side
_PHASES = {
    "time_delay": "A delay turns the phase evenly with the frequency and leaves the size as it is.",
    "unmodelled_resonance:fixture": "Below the mode the force is as modelled, above it turned and smaller.",
    "sensor_lag": "A lag turns the phase by 90 degrees at most and makes a fast force smaller.",
}
"""What a phase says, by the name of the cause."""


@dataclass(frozen=True, slots=True, eq=False)
class Component:
    """A cause within a fit: its own force, and that force with what the whole model leaves; rows that
    count.
    """

    curves: Curves
    name: str
    shape: Shape
    own: Floats
    left: Floats

    @classmethod
    def of(cls, curves: Curves, name: str) -> "Component":
        """Of a cause by the name of its form."""
        analysis = curves.analysis
        own = share_of(analysis.regression, analysis.fit, name)[curves.rows]
        return cls(curves, name, analysis.fit.model[name], own, own + curves.after[curves.rows])

    def column(self, values: Floats) -> Floats:
        """A column of the curves at the rows that count."""
        return np.asarray(values[self.curves.rows])


@styled()
def picture(stem: str, curves: Curves, name: str) -> Drawing:
    """Of a cause of the model, by the name of its form; over time where no other picture suits it."""
    draw = _DRAWINGS[CANDIDATES[name].picture]
    return draw(f"{stem} {name}", Component.of(curves, name))


@styled()
def sensor_picture(stem: str, analysis: Analysis, fault: Cause) -> Drawing | None:
    """Of a fault of the sensor, on the force as recorded; None where no picture suits it."""
    draw = _FAULTS.get(fault.name)
    return None if draw is None else draw(f"{stem} {fault.name}", analysis, fault)


def _against(
    stem: str, x: Floats, label: tuple[str, str], left: Floats, own: Floats, words: tuple[str, str]
) -> Drawing:
    """What is left as points, and the cause's own line, over x; `words`: title and caption."""
    figure, axes = one_plot(_HEIGHT_IN, _WIDTH_IN)
    across, force = AxisUnit(*label, x), AxisUnit("force", "N", left)
    limit_y(axes, force(left), force(own), trim=TRIM, zero=True)
    cloud(axes, across(x), force(left), ORANGE, size=3.6)
    axes.plot([], [], ".", color=ORANGE, label=_WITHOUT)
    axes.plot(*medians(across(x), force(own), _FINE), color=BLUE, linewidth=1.5, label=_OWN, zorder=3)
    finish(axes, across.label, force.label)
    return drawn(figure, stem, *words)


def _speed(stem: str, of: Component) -> Drawing:
    caption = "A jump at zero is dry friction, a slope damping, a bend drag, a peak at low speed Stribeck's."
    words = "Over the speed", caption
    return _against(stem, of.column(of.curves.v), ("speed", "m/s"), of.left, of.own, words)


def _position(stem: str, of: Component) -> Drawing:
    caption = "The same curve on the way in and out: a spring that is not straight, or a force of the place."
    words = "Over the position", caption
    return _against(stem, of.column(of.curves.x), ("position", "m"), of.left, of.own, words)


def _contact(stem: str, of: Component) -> Drawing:
    """The spring's force with what is left: nothing before the contact, a slope behind it."""
    regression, fit = of.curves.analysis.regression, of.curves.analysis.fit
    spring = regression.block(fit.model, "", ())[:, 2] * fit.coefficients[2]
    own = of.column(spring)
    left = own + of.column(of.curves.after)
    words = "The elastic force over the position", "Nothing before the contact, a slope behind it."
    return _against(stem, of.column(of.curves.x), ("position", "m"), left, own, words)


def _since(stem: str, of: Component) -> Drawing:
    """By direction, so that both branches lie on each other."""
    length = max(of.shape, default=0.0)
    direction, since = (of.column(values) for values in strokes(of.curves, _TREMOR * length))
    near = (direction != 0.0) & (since <= _reach(of, since))
    resists = of.curves.analysis.regression.sense * direction[near]
    left, own = of.left[near] * resists, of.own[near] * resists
    label = "distance since reversal", "m"
    caption = (
        f"Both directions laid on each other; positive resists the motion. Ways back of less than "
        f"{plain_value('way_m', _TREMOR * length)} are no reversal here."
    )
    words = "Over the distance since the last reversal", caption
    return _against(stem, since[near], label, left, own, words)


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
    figure, axes = one_plot(_HEIGHT_IN, _WIDTH_IN)
    across, force = AxisUnit(*label, x), AxisUnit("force", "N", of.left)
    limit_y(axes, force(of.left), force(of.own), trim=TRIM, zero=True)
    for (name, rows), colour in zip(groups.items(), (ORANGE, BLUE), strict=False):
        if np.count_nonzero(rows) > _FINE:
            cloud(axes, across(x[rows]), force(of.left[rows]), colour, size=3.0)
            line = medians(across(x[rows]), force(of.own[rows]), _FINE)
            axes.plot(*line, color=colour, linewidth=1.8, label=f"{_OWN}, {name}", zorder=3)
    finish(axes, across.label, force.label)
    return drawn(figure, stem, *words)


def _along(stem: str, of: Component) -> Drawing:
    direction = of.column(of.curves.direction)
    groups = {"inserting": direction > 0.5, "withdrawing": direction < -0.5}
    caption = "Points: what is left without it. A jump that grows with the depth."
    words = "Over the position, by direction", caption
    return _groups(stem, of, of.column(of.curves.x), ("position", "m"), groups, words)


def _deep(stem: str, of: Component) -> Drawing:
    x = of.column(of.curves.x)
    low, high = np.quantile(x, (1.0 / 3.0, 2.0 / 3.0))
    caption = "Points: what is left without it. A slope that is steeper where it is deep."
    words = "Over the speed, by depth", caption
    groups = {"shallow third": x < low, "deep third": x > high}
    return _groups(stem, of, of.column(of.curves.v), ("speed", "m/s"), groups, words)


def _time(stem: str, of: Component) -> Drawing:
    start, end = _window(of)
    t = of.column(of.curves.t)
    rows = (t >= start) & (t <= end)
    figure, axes = one_plot(_HEIGHT_IN, _WIDTH_IN)
    force = AxisUnit("force", "N", of.left[rows])
    limit_y(axes, force(of.left[rows]), force(of.own[rows]), trim=TRIM, zero=True)
    plot(axes, t[rows], force(of.left[rows]), ORANGE, _WITHOUT, width=3.0)
    plot(axes, t[rows], force(of.own[rows]), BLUE, _OWN)
    if base_name(of.name) == "stiffness_change" and start < of.shape[0] < end:
        axes.axvline(of.shape[0], color=VERMILION, linewidth=1.4, label="the change")
    finish(axes, "time in s", force.label)
    whole = end - start >= 0.99 * float(t[-1] - t[0])
    return drawn(figure, stem, "Over time", "The whole recording." if whole else "Where it is largest.")


def _window(of: Component) -> tuple[float, float]:
    """All of the time, or where a force that fades is largest."""
    t = of.column(of.curves.t)
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
    x = of.column(of.curves.t) % period
    words = "Folded on its period", f"Every {period:.3g} s laid on the others; shown from 0 to one period."
    return _against(stem, x, ("time within the period", "s"), of.left, of.own, words)


def _peak(stem: str, of: Component) -> Drawing:
    curves = of.curves
    signals, own = curves.analysis.regression.signals, np.zeros_like(curves.t)
    own[curves.rows] = of.own
    figure, axes = one_plot(_HEIGHT_IN, _WIDTH_IN)
    axes.loglog(*density(signals, own + curves.after), color=ORANGE, label=_WITHOUT)
    axes.loglog(*density(signals, own), color=BLUE, label=_OWN)
    axes.loglog(*density(signals, curves.after), color=GREY, label="left with it")
    axes.axvline(of.shape[0], color=VERMILION, linewidth=1.0)
    plain_numbers(axes.xaxis, axes.yaxis)
    finish(axes, "frequency in Hz", "force in N/√Hz")
    return drawn(figure, stem, "Spectrum", f"The peak at {of.shape[0]:.3g} Hz (line).")


def _phase(stem: str, of: Component) -> Drawing:
    """Phase and ratio of the measured force to the model's without the cause, where both go together."""
    frequency, ratio = response(of.curves.analysis.regression, of.curves.analysis.fit, of.name)
    figure = new_figure(_HEIGHT_IN, _WIDTH_IN)
    left, right = figure.subplots(1, 2)
    hz = np.linspace(0.0, float(frequency.max(initial=1.0)), 400)
    law = alignment(2.0 * np.pi * hz, {of.name: of.shape})
    assert law is not None
    angle = np.unwrap(np.angle(law))
    near = np.interp(frequency, hz, angle)  # of several turns the one beside the law
    measured = near + np.angle(ratio * np.exp(-1j * near))
    for axes, dots, line, label in (
        (left, np.degrees(measured), np.degrees(angle), "phase in degrees"),
        (right, np.abs(ratio), np.abs(law), "measured / modelled"),
    ):
        axes.plot(frequency, dots, ".", color=ORANGE, markersize=5, label="measured")
        axes.plot(hz, line, color=BLUE, linewidth=1.5, label=_OWN)
        finish(axes, "frequency in Hz", label, legend=False)
    common_legend(figure, left)
    right.set_ylim(0.0, min(_HIGHEST, 1.2 * max(1.0, float(np.abs(law).max()), *np.abs(ratio).tolist())))
    return drawn(figure, stem, "Phase and size over the frequency", _PHASES[of.name])


_DRAWINGS: Mapping[str, Callable[[str, Component], Drawing]] = {
    "contact": _contact,
    "depth": _deep,
    "direction": _along,
    "period": _folded,
    "phase": _phase,
    "position": _position,
    "reversal": _since,
    "spectrum": _peak,
    "speed": _speed,
    "time": _time,
}
"""By the variable in which a cause shows, see `Candidate.picture`."""


def _raw(analysis: Analysis) -> Floats:
    force_n = analysis.recording.force_n
    assert force_n is not None
    return force_n


def _levels(stem: str, analysis: Analysis, fault: Cause) -> Drawing:
    force_n, step = _raw(analysis), fault.parameters["step_n"].value
    middle = step * round(float(np.median(force_n)) / step)
    edges = middle + step * np.arange(-_LEVELS - 0.5, _LEVELS + 0.5 + 1e-9, 0.125)
    caption = f"Levels {1e3 * step:.4g} mN apart, and nothing between them."
    return _histogram(stem, force_n, edges, [], "Histogram of the readings", caption)


def _ends(stem: str, analysis: Analysis, fault: Cause) -> Drawing:
    force_n, limit = _raw(analysis), fault.parameters["limit_n"].value
    margin = 0.03 * float(np.ptp(force_n))
    edges = np.linspace(float(force_n.min()) - margin, float(force_n.max()) + margin, 121)
    span = 2e-3 * float(np.ptp(force_n))
    lines = [end for end in (limit, -limit) if force_n.min() - span <= end <= force_n.max() + span]
    caption = "Readings pile up where the range ends (line)."
    return _histogram(stem, force_n, edges, lines, "Histogram of the readings", caption)


def _histogram(
    stem: str, force_n: Floats, edges: Floats, lines: list[float], title: str, caption: str
) -> Drawing:
    figure, axes = one_plot(_HEIGHT_IN, _WIDTH_IN)
    inside = force_n[(force_n >= edges[0]) & (force_n <= edges[-1])]
    force = AxisUnit("force", "N", inside)
    axes.hist(force(inside), force(edges).tolist(), color=ORANGE)
    for line in lines:
        axes.axvline(float(force(line)), color=VERMILION, linewidth=1.4)
    finish(axes, force.label, "readings", legend=False)
    return drawn(figure, stem, title, caption)


def _spikes(stem: str, analysis: Analysis, fault: Cause) -> Drawing:
    t = analysis.recording.time_s - analysis.recording.time_s[0]
    raw, cleaned = _raw(analysis), analysis.cleaned.force_n
    figure, axes = one_plot(_HEIGHT_IN, _WIDTH_IN)
    force = AxisUnit("force", "N", raw)
    limit_y(axes, force(raw))
    plot(axes, t, force(raw), ORANGE, "as recorded")
    plot(axes, t, force(cleaned), BLUE, "without the outliers")
    finish(axes, "time in s", force.label)
    return drawn(figure, stem, "Over time", "Single readings far off their neighbours.")


def _line(stem: str, analysis: Analysis, fault: Cause) -> Drawing:
    frequency_hz, rate = fault.parameters["frequency_hz"].value, analysis.recording.rate_hz
    figure, axes = one_plot(_HEIGHT_IN, _WIDTH_IN)
    for force_n, colour, name in (
        (_raw(analysis), ORANGE, "as recorded"),
        (analysis.cleaned.force_n, BLUE, "without the line"),
    ):
        piece = max(analysis.recording.segments(), key=lambda s: s.stop - s.start)
        frequency, power = welch(force_n[piece], rate, nperseg=min(len(force_n[piece]), int(8.0 * rate)))
        near = np.abs(frequency - frequency_hz) < _AROUND_HZ
        axes.semilogy(frequency[near], np.sqrt(power[near]), color=colour, label=name)
    axes.axvline(frequency_hz, color=GREY, linewidth=1.0, zorder=0)
    plain_numbers(axes.yaxis)
    finish(axes, "frequency in Hz", "force in N/√Hz")
    return drawn(figure, stem, "Spectrum of the readings", f"A narrow line at {frequency_hz:.2f} Hz.")


_FAULTS: Mapping[str, Callable[[str, Analysis, Cause], Drawing]] = {
    "sensor_quantisation": _levels,
    "sensor_saturation": _ends,
    "sensor_spikes": _spikes,
    "mains_hum": _line,
}
