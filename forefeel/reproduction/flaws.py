"""The figures of the six things that the paper's simulation gets wrong, and of the human thresholds."""

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from forefeel.diagnosis.reproduction.identifiability import AmplitudeTraces
from forefeel.diagnosis.reproduction.memory import MemoryTraces
from forefeel.diagnosis.reproduction.results import BaselineRow, MemoryResult, Thresholds, Unidentifiable
from forefeel.diagnosis.reproduction.simulated import SimulatedTraces
from forefeel.diagnosis.reproduction.thresholds import METHODS
from forefeel.diagnosis.reproduction.unmodelled import SHOWN_N, UnmodelledTraces
from forefeel.diagnosis.reproduction.windup import WindupTraces
from forefeel.report.svg import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, VERMILION, limit_y, plot
from forefeel.reproduction.captions import CAPTIONS, TITLES
from forefeel.reproduction.drawing import FAR, Picture, finish, picture

_BY_METHOD = {"hold": ORANGE, "paper": VERMILION, "product": BLUE}


def _made(key: str, height_in: float, draw: Callable[[Figure], None]) -> Picture:
    return picture(key, TITLES[key], CAPTIONS[key], height_in, draw)


def identifiability_picture(numbers: Unidentifiable, traces: AmplitudeTraces) -> Picture:
    """(a) Predicted force amplitude over frequency."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        w = traces.omega_rad_s
        axes.plot(w, traces.true_n, color=GREY, linewidth=5, label="truth")
        axes.plot(w, traces.paper_n, color=VERMILION, linewidth=1.6, label="paper's algorithm")
        axes.plot(w, traces.product_n, color=BLUE, linewidth=1.6, label="product (says: m, k not separable)")
        axes.plot(
            w,
            traces.product_two_frequencies_n,
            color=GREEN,
            linewidth=1.6,
            dashes=(4, 3),
            label="product, after a second frequency",
        )
        for row in numbers.amplitudes:
            axes.plot(row.omega_rad_s, row.paper_n, "o", color=VERMILION, markersize=5)
            axes.annotate(f"{row.paper_n:.3g} N", (row.omega_rad_s, row.paper_n), (6, -12), **_OFFSET)
            axes.plot(row.omega_rad_s, row.true_n, "o", color=BLACK, markersize=4)
        axes.axvline(1.0, color=BLACK, linewidth=0.9, linestyle="dotted")
        axes.annotate("learned here", (1.0, 30.0), (5, 0), **_OFFSET)
        axes.set_yscale("log")
        axes.set_xlim(0, 12)
        axes.yaxis.set_major_formatter("{x:g}")
        finish(axes, "force amplitude in N, for 1 m", "angular frequency of the motion in rad/s")

    return _made("flaw_a", 3.6, draw)


_OFFSET: dict[str, Any] = {"textcoords": "offset points", "color": "#3c4450", "fontsize": 9.5}


def windup_picture(traces: WindupTraces) -> Picture:
    """(b) Growth of the covariance, and the parameters under noise."""

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        colours = (PURPLE, VERMILION, ORANGE, GREEN)
        for (lam, growth), colour in zip(traces.paper_growth.items(), colours, strict=False):
            time_s, powers = traces.time_s[: len(growth)], np.log10(growth)
            left.plot(time_s, powers, color=colour, label=f"λ {lam:g}")
            left.plot(time_s[-1], powers[-1], "x", color=colour, markersize=8)
        left.plot(traces.time_s, np.log10(traces.product_growth), color=BLUE, linewidth=2, label="product")
        finish(left, "growth of trace P, powers of ten", "time in s", columns=5)
        n = len(traces.noisy_largest)
        right.axhline(0.0, color=GREY, linewidth=5, zorder=0, label="true k")
        right.plot(traces.time_s[:n], np.log10(traces.noisy_largest), color=VERMILION, label="paper, λ 0.96")
        right.plot(traces.time_s, np.log10(traces.product_largest), color=BLUE, linewidth=2, label="product")
        finish(right, "largest parameter, powers of ten", "time in s", columns=3)

    return _made("flaw_b", 3.4, draw)


def memory_picture(numbers: MemoryResult, traces: list[MemoryTraces]) -> Picture:
    """(c) Error by sample rate, and the prediction at 100 Hz."""

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.3))
        rates = [row.rate_hz for row in numbers.rows]
        middle = [row.paper_rms_n for row in numbers.rows]
        spread = [
            [row.paper_rms_n - row.paper_lowest_n for row in numbers.rows],
            [row.paper_highest_n - row.paper_rms_n for row in numbers.rows],
        ]
        left.errorbar(rates, middle, spread, fmt="o-", color=VERMILION, capsize=4, label="paper's algorithm")
        left.plot(rates, [row.known_mass_rms_n for row in numbers.rows], "s--", color=PURPLE, label="m known")
        left.plot(rates, [row.product_rms_n for row in numbers.rows], "o-", color=BLUE, label="product")
        left.loglog()
        left.set_xticks(rates, [f"{rate:g}" for rate in rates])
        left.xaxis.set_minor_formatter("")
        left.yaxis.set_major_formatter("{x:g}")
        finish(left, "rms error in N", "sample rate in Hz", columns=3)
        shown = traces[1]
        limit_y(right, 2.0 * shown.force_n)
        plot(right, shown.time_s, shown.paper_n.clip(-FAR, FAR), VERMILION, "paper's algorithm, 100 Hz")
        plot(right, shown.time_s, shown.force_n, BLACK, "true force", width=1.6)
        plot(right, shown.time_s, shown.product_n, BLUE, "product")
        right.set_xlim(0, shown.time_s[-1])
        finish(right, "force in N", "time in s", columns=3)

    return _made("flaw_c", 3.4, draw)


def unmodelled_picture(traces: list[UnmodelledTraces]) -> Picture:
    """(d) The error that an unmodelled bias or friction leaves."""

    def draw(figure: Figure) -> None:
        grid = figure.subplots(1, len(traces), sharey=True, squeeze=False)[0]
        for axes, one in zip(grid, traces, strict=True):
            paper_mn, product_mn = (1e3 * (made - one.force_n) for made in (one.paper_n, one.product_n))
            late = one.time_s > 6.0
            limit_y(axes, paper_mn[late], product_mn[late])
            plot(axes, one.time_s, paper_mn, VERMILION, "paper's algorithm", 1.5)
            plot(axes, one.time_s, product_mn, BLUE, "product", 1.5)
            axes.set_xlim(0, one.time_s[-1])
            finish(axes, "error in mN", f"time in s, {one.what} of {1e3 * SHOWN_N:g} mN", columns=2)

    return _made("flaw_d", 2.9, draw)


def baseline_picture(rows: tuple[BaselineRow, ...]) -> Picture:
    """(e) Every run's error relative to the hold."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        labels = {"paper's algorithm": VERMILION, "paper's algorithm, tared": GREEN, "product": BLUE}
        _ratios(axes, rows, labels, ("paper", "tared", "product"))

    return _made("flaw_e", 1.2 + 0.27 * len(rows), draw)


def _ratios(
    axes: Axes, rows: tuple[BaselineRow, ...], labels: dict[str, str], methods: tuple[str, ...]
) -> None:
    """One line per run, rms over that of the hold on a logarithmic axis."""
    places = np.arange(len(rows))[::-1]
    axes.axvline(1.0, color=ORANGE, linewidth=2.5, label="hold")
    markers = ("o", "s", "D")
    for (label, colour), method, marker in zip(labels.items(), methods, markers, strict=False):
        known = [
            (getattr(row, f"{method}_over_hold"), place) for row, place in zip(rows, places, strict=True)
        ]
        drawn = [(value, place) for value, place in known if value is not None]
        axes.plot(*zip(*drawn, strict=True), marker, color=colour, markersize=7, label=label)
        for value, place in known:
            if value is None:
                axes.annotate("diverged", (1.0, place), (8, -4), **{**_OFFSET, "color": colour})
    axes.set_yticks(places, [f"{row.name} ({_source(row)})" for row in rows])
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter("")
    finish(axes, "", "rms error / that of the hold")


def _source(row: BaselineRow) -> str:
    return "simulated bench" if row.source == "simulated bench" else "measured"


def pairing_picture(rows: tuple[BaselineRow, ...], simulated: SimulatedTraces) -> Picture:
    """(f) Both pairings on x = sin t and on every run."""

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.25))
        late = simulated.time_s > 2 * np.pi
        time_s, truth = simulated.time_s[late], simulated.force_n[late]
        left.plot(time_s, 1e3 * (simulated.arrived_n[late] - truth), color=ORANGE, linewidth=7, label="hold")
        left.plot(
            time_s,
            1e3 * (simulated.newest_n[late] - truth),
            color=PURPLE,
            linewidth=2.4,
            dashes=(4, 3),
            label="newest motion",
        )
        stamps = 1e3 * (simulated.predicted_n[late] - truth)
        left.plot(time_s, stamps, color=VERMILION, linewidth=1.6, label="by stamps")
        finish(left, "error in mN, x = sin t", "time in s", columns=3)
        _ratios(right, rows, {"newest motion": PURPLE, "by stamps": VERMILION}, ("newest", "paper"))

    return _made("flaw_f", max(3.2, 1.2 + 0.27 * len(rows)), draw)


def threshold_picture(numbers: Thresholds) -> Picture:
    """Share of the time in which the error is not felt, by instrument, style and method."""

    def draw(figure: Figure) -> None:
        instruments = list(dict.fromkeys(row.instrument for row in numbers.rows))
        grid = figure.subplots(1, len(instruments), sharey=True, squeeze=False)[0]
        for axes, instrument in zip(grid, instruments, strict=True):
            _shares(axes, numbers, instrument)

    return _made("thresholds", 3.3, draw)


def _shares(axes: Axes, numbers: Thresholds, instrument: str) -> None:
    styles = list(numbers.styles)
    scale = next(row.force_scale for row in numbers.rows if row.instrument == instrument)
    for index, method in enumerate(METHODS):
        rows = [r for r in numbers.rows if r.instrument == instrument and r.method == method]
        places = np.arange(len(styles)) + 0.27 * (index - 1)
        strict = [100 * (row.strict_share or 0.0) for row in rows]
        lenient = [100 * (row.lenient_share or 0.0) for row in rows]
        colour = _BY_METHOD[method]
        axes.bar(places, lenient, 0.24, color=colour, alpha=0.35)
        axes.bar(places, strict, 0.24, color=colour, label={"paper": "paper's algorithm"}.get(method, method))
        for place, value in zip(places, strict, strict=True):
            axes.annotate(f"{value:.0f}", (float(place), 2.0), ha="center", fontsize=9, color="#1a1a1a")
    axes.set_xticks(range(len(styles)), styles)
    axes.set_ylim(0, 100)
    axes.grid(visible=False, axis="x")
    finish(axes, "share of the time in %", f"{instrument}, force scale {scale:g}", columns=3)
