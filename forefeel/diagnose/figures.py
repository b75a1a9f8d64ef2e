"""What is wrong, in figures: simulation beside measurement, and what is left against all that could explain
it.
"""

import numpy as np

from forefeel.diagnose.drawing import (
    Axis,
    bars,
    cloud,
    common_legend,
    density,
    drawn,
    finish,
    logarithmic,
    means,
    span,
)
from forefeel.diagnose.parts import Parts, Rows, rms
from forefeel.diagnosis.diagnose.verdict import Diagnosis
from forefeel.report.svg import BLACK, BLUE, GREY, ORANGE, Drawing, new_figure, plot, styled

_DETAIL_S = 5.0
_SIMULATION = "simulation"
_COLOURS = ORANGE, BLUE


def drawings(stem: str, parts: Parts, diagnosis: Diagnosis) -> list[Drawing]:
    """Force over time and its worst stretch; what is left over time, over the motion, its spectrum, its
    size.
    """
    with styled():
        return [
            _force(stem, parts),
            _detail(stem, parts),
            _over_time(stem, parts, diagnosis),
            _over_motion(stem, parts),
            _spectrum(stem, parts),
            _sizes(stem, parts, diagnosis),
        ]


def named(parts: Parts) -> str:
    """What the simulation is."""
    return f"{_SIMULATION} ({'the given model' if parts.given else 'mass, damper, spring'})"


def worst_stretch(parts: Parts, length_s: float = _DETAIL_S) -> tuple[float, float]:
    """From when to when the simulation errs most, in s since the start."""
    t, error = parts.t[parts.rows], parts.before[parts.rows] ** 2
    stretch = np.floor((t - t[0]) / length_s).astype(np.int64)
    total = np.bincount(stretch, error)
    count = np.bincount(stretch)
    mean = np.where(count > 0.5 * count.max(), total / np.maximum(count, 1), 0.0)
    start = float(t[0] + length_s * int(np.argmax(mean)))
    return start, min(start + length_s, float(t[-1]))


def _force(stem: str, parts: Parts) -> Drawing:
    band = parts.analysis.regression.signals.cutoff_hz
    caption = f"The whole recording below {band:.0f} Hz, the band in which motion and force are compared."
    return _forces(stem, parts, "Simulation and measurement", caption, parts.rows)


def _detail(stem: str, parts: Parts) -> Drawing:
    start, end = worst_stretch(parts)
    t = parts.t[parts.rows]
    rows = parts.rows[(t >= start) & (t <= end)]
    caption = f"{start:.1f} to {end:.1f} s, the stretch with the largest error."
    return _forces(stem, parts, "Where the simulation errs most", caption, rows)


def _forces(stem: str, parts: Parts, title: str, caption: str, rows: Rows) -> Drawing:
    figure = new_figure(2.9)
    axes = figure.subplots()
    force = Axis("force", "N", parts.force[rows])
    simulated, measured, extended = (
        force(values[rows]) for values in (parts.simulated, parts.force, parts.extended)
    )
    span(axes, simulated, measured, extended)
    gap_s = _gap_s(parts)
    plot(axes, parts.t[rows], measured, BLACK, "measured", width=2.0, gap_s=gap_s)
    plot(axes, parts.t[rows], simulated, ORANGE, named(parts), gap_s=gap_s)
    plot(axes, parts.t[rows], extended, BLUE, "extended by the causes", gap_s=gap_s)
    finish(axes, "time in s", force.label)
    return drawn(figure, stem, title, caption)


def _over_time(stem: str, parts: Parts, diagnosis: Diagnosis) -> Drawing:
    rows, figure = parts.rows, new_figure(2.5)
    axes = figure.subplots()
    residual = Axis("residual", "N", parts.before[rows])
    floor = float(residual(diagnosis.noise_floor_n))
    span(axes, *(residual(values[rows]) for values in (parts.before, parts.after)))
    axes.axhspan(-2.0 * floor, 2.0 * floor, color=GREY, alpha=0.35, linewidth=0, label="± 2 x noise")
    for values, colour, name in zip((parts.before, parts.after), _COLOURS, _names(), strict=True):
        plot(axes, parts.t[rows], residual(values[rows]), colour, name, gap_s=_gap_s(parts))
    finish(axes, "time in s", residual.label)
    return drawn(figure, stem, "What is left over time", "Measured less modelled force.")


def _over_motion(stem: str, parts: Parts) -> Drawing:
    rows = parts.rows
    columns = {
        ("position", "m"): parts.x,
        ("speed", "m/s"): parts.v,
        ("distance since reversal, by direction,", "m"): parts.since * parts.direction,
    }
    figure = new_figure(3.1)
    residual = Axis("residual", "N", parts.before[rows])
    grid = figure.subplots(1, 3, sharey=True)
    for axes, ((label, unit), column) in zip(grid, columns.items(), strict=True):
        across = Axis(label, unit, column[rows])
        for values, colour, name in zip((parts.before, parts.after), _COLOURS, _names(), strict=True):
            cloud(axes, across(column[rows]), residual(values[rows]), colour)
            axes.plot(
                *means(across(column[rows]), residual(values[rows])),
                color=colour,
                linewidth=2.2,
                label=name,
                zorder=3,
            )
        finish(axes, across.label, residual.label if axes is grid[0] else "", legend=False)
    common_legend(figure, grid[0])
    span(grid[0], *(residual(values[rows]) for values in (parts.before, parts.after)))
    caption = "Points, and their means in bins. A line that leaves zero is something missing."
    return drawn(figure, stem, "What is left over position, speed and distance since reversal", caption)


def _spectrum(stem: str, parts: Parts) -> Drawing:
    figure = new_figure(2.6)
    axes = figure.subplots()
    for values, colour, name in zip((parts.before, parts.after), _COLOURS, _names(), strict=True):
        axes.loglog(*density(parts.analysis.regression.signals, values), color=colour, label=name)
    logarithmic(axes)
    finish(axes, "frequency in Hz", "residual in N/√Hz")
    caption = "A peak is periodic or swings; noise is flat or falls slowly."
    return drawn(figure, stem, "Spectrum of what is left", caption)


def _sizes(stem: str, parts: Parts, diagnosis: Diagnosis) -> Drawing:
    rows = parts.rows
    shown = [(f"left by the {_SIMULATION}", rms(parts.before[rows]), ORANGE)]
    shown += [(cause.name, cause.explained_n, GREY) for cause in diagnosis.causes]
    shown += [
        ("left by the extended model", rms(parts.after[rows]), BLUE),
        ("noise floor", diagnosis.noise_floor_n, BLACK),
    ]
    figure = new_figure(0.75 + 0.33 * len(shown))
    bars(figure.subplots(), *(list(column) for column in zip(*shown, strict=True)))
    caption = (
        "rms. Grey is what the error on held-out blocks loses by one cause alone; squares add up, not bars."
    )
    return drawn(figure, stem, "How large it is", caption)


def _names() -> tuple[str, str]:
    return f"left by the {_SIMULATION}", "left by the extended model"


def _gap_s(parts: Parts) -> float:
    return max(0.1, 3.0 / parts.analysis.regression.signals.coarse_rate_hz)
