"""reproduction.html: its figures, each as PNG too, its sentences, and the short table for the terminal."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from forefeel.common.events.text import quantity
from forefeel.report.drawing import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    Drawing,
    band_about_zero,
    drawn,
    finish,
    limit_y,
    new_figure,
    one_plot,
    plain_numbers,
    plot,
    styled,
)
from forefeel.report.template import render
from forefeel.report.wording import DISCLAIMER, ratio, share
from forefeel.studies.paper.assemble import Traces
from forefeel.studies.paper.bench import FIGURES, BenchTraces
from forefeel.studies.paper.identifiability import AmplitudeTraces
from forefeel.studies.paper.memory import MemoryTraces
from forefeel.studies.paper.results import (
    BaselineRow,
    BenchFigure,
    MemoryResult,
    Reproduction,
    Thresholds,
    Unidentifiable,
)
from forefeel.studies.paper.simulated import SimulatedTraces
from forefeel.studies.paper.thresholds import METHODS
from forefeel.studies.paper.unmodelled import SHOWN_N, UnmodelledTraces
from forefeel.studies.paper.windup import WindupTraces

_BENCH = "Simulated bench, not the paper's phantom"
_BY_METHOD = {"zoh": ORANGE, "paper": VERMILION, "product": BLUE}
_LABEL: dict[str, Any] = {"textcoords": "offset points", "color": "#3c4450", "fontsize": 9.5}
_WIDE = 0.05  # share of the axis beside what is drawn, where a marker or a bar stands at its end

_Figure = tuple[str, Figure, str, str]
"""(name, figure, title, caption)"""


def render_page(numbers: Reproduction, drawings: dict[str, Drawing]) -> str:
    """The page; `drawings` as `draw_all` makes them."""
    return render("studies/paper/page.html.j2", all=numbers, flaws=numbers.flaws, drawings=drawings)


@styled()
def draw_all(numbers: Reproduction, traces: Traces) -> dict[str, Drawing]:
    """By name: figures 4, 5, 7 to 10, the six flaws, the thresholds."""
    flaws, (prompt, delayed) = numbers.flaws, traces.simulated
    figures: list[_Figure] = [
        (
            "figure_04",
            _prompt(prompt),
            "Figure 4: simulation without delay",
            "x = sin t, m 0.01 kg, b 0.1 N s/m, k 1 N/m, lambda 0.96, 100 Hz; prediction one sample ahead. "
            "Both curves coincide, as the paper says; the parameters behind the prediction are wrong, see "
            "(a).",
        ),
        (
            "figure_05",
            _delayed(delayed),
            "Figure 5: the same with 300 ms delay",
            "Paired by the slave's stamps the prediction leads the measured force as it arrives by the "
            "delay, and coincides with the force at the contact now. Paired with the newest motion, which "
            "is how the paper describes it, the prediction only repeats the delayed force, see (f).",
        ),
        *(
            figure
            for bench, one in zip(traces.bench, numbers.bench, strict=True)
            for figure in _bench_figures(bench, one)
        ),
        (
            "flaw_a",
            _amplitudes(flaws.unidentifiable, traces.amplitudes),
            "(a) Mass and stiffness can not be told apart",
            "With x = sin t, x'' = -x: two columns of the regression are one. The prediction at 1 rad/s is "
            "perfect, at any other frequency it is wrong. The product says what it can not know, keeps mass "
            "and stiffness within physical bounds, and finds both once a second frequency is there.",
        ),
        (
            "flaw_b",
            _windup(traces.windup),
            "(b) The update overflows",
            "At 1 kHz. Left, without noise: in the direction that sin t does not excite, P grows as λ to "
            "the power -k until it passes the largest number that a computer holds (crosses). Right, with 1 "
            "mN of noise: long before that the parameters are arbitrary. The product updates only where "
            "there is information.",
        ),
        (
            "flaw_c",
            _memory(flaws.memory, traces.memory[1]),
            "(c) The forgetting factor is a memory in samples",
            "λ = 0.96 with 5 mN noise and 300 ms delay. Left: median of five noises, bars from the lowest "
            "to the highest. With m known nothing is unidentifiable, and what remains is the short memory "
            "alone. The product's memory is 2 s at any rate. Right: clipped at twice the force.",
        ),
        (
            "flaw_d",
            _unmodelled(traces.unmodelled),
            "(d) No bias and no friction in the model",
            "The paper's simulation at 10 Hz, where its algorithm works best, 300 ms late, without noise. A "
            "bias stays in the error as it is; of Coulomb friction the model takes up the part that looks "
            "like damping. In longer runs either also drives the wind-up of (b).",
        ),
        (
            "flaw_e",
            _baseline(flaws.baseline.rows),
            "(e) No baseline: simply holding the late force",
            "rms at 300 ms, each run relative to holding the newest force that has arrived. An error "
            "without the hold beside it is no evidence: where a predictor lies right of the line, doing "
            "nothing is better. Tared: the paper's algorithm on the force less its first value, which "
            "spares it most of (d).",
        ),
        (
            "flaw_f",
            _pairing(flaws.baseline.rows, delayed),
            "(f) The late force paired with the newest motion",
            "Left, the paper's simulation: paired with the newest motion, the algorithm learns the delayed "
            "force, and its error is that of the hold. Right, the runs, rms relative to the hold. Where the "
            "right pairing is worse, its 25 samples of memory (c) and the missing bias (d) carry it astray "
            "over 300 ms, while the wrong one follows the hold.",
        ),
        (
            "thresholds",
            _thresholds(numbers.thresholds),
            "Share of the time in which the error is not felt, simulated bench",
            "Simulated bench, three styles of the simulated operator. Full bars and numbers: error below 29 "
            "mN or 7 % of the force, whichever is larger; light bars: 44 mN or 10 %. As shown to the hand, "
            "after force scaling.",
        ),
    ]
    return {
        name: drawn(figure, name, title, caption, with_png=True) for name, figure, title, caption in figures
    }


def _prompt(traces: SimulatedTraces) -> Figure:
    figure, axes = one_plot(2.9)
    axes.plot(traces.time_s, traces.force_n, color=GREY, linewidth=5, label="measured")
    axes.plot(
        traces.time_s,
        traces.predicted_n,
        color=VERMILION,
        linewidth=1.4,
        label="predicted (paper's algorithm)",
    )
    axes.set_xlim(0, traces.time_s[-1])
    finish(axes, "time in s", "force in N")
    return figure


def _delayed(traces: SimulatedTraces) -> Figure:
    figure, axes = one_plot(2.9)
    time_s = traces.time_s
    axes.plot(time_s, traces.force_n, color=GREY, linewidth=5, label="force at the contact, now")
    axes.plot(time_s, traces.predicted_n, color=VERMILION, linewidth=1.4, label="predicted, paired by stamps")
    axes.plot(time_s, traces.arrived_n, color=BLACK, linewidth=1.4, label="measured, as it arrives")
    axes.plot(
        time_s,
        traces.newest_n,
        color=PURPLE,
        linewidth=2.2,
        dashes=(3, 3),
        label="predicted, paired with the newest motion",
    )
    axes.set_xlim(0, 4 * np.pi)
    finish(axes, "time in s", "force in N")
    return figure


def _bench_figures(traces: BenchTraces, numbers: BenchFigure) -> list[_Figure]:
    """Prediction and error of one instrument: figures 7 and 8, or 9 and 10."""
    first, second = FIGURES[traces.instrument]
    what = traces.instrument
    return [
        (
            f"figure_{first:02}",
            _bench_force(traces),
            f"Figure {first}: contact force of the {what}, simulated bench",
            f"{_BENCH}. Predicted for the instant of measurement: by the paper's algorithm without a delay "
            "(one sample, 1 ms, ahead), by the same with forces 300 ms late, and by this product over a "
            f"network with a round trip of {1e3 * numbers.round_trip_s:.0f} ms.",
        ),
        (
            f"figure_{second:02}",
            _bench_error(traces),
            f"Figure {second}: error of the prediction, {what}, simulated bench",
            f"{_BENCH}. Grey: the bound that the paper states, {1e3 * traces.bound_n:.0f} mN. Within it: "
            f"{_percent(numbers.without_delay.share_within)} of the time without a delay, "
            f"{_percent(numbers.delayed.share_within)} with 300 ms, {_percent(numbers.zoh.share_within)} by "
            f"holding the late force. The force itself reaches {1e3 * numbers.force_peak_n:.0f} mN.",
        ),
    ]


def _percent(value: float | None) -> str:
    return "none" if value is None else f"{100 * value:.0f} %"


def _bench_force(traces: BenchTraces) -> Figure:
    figure, axes = one_plot(3.4)
    rows = np.flatnonzero(traces.scored)
    shown = slice(rows[0], rows[-1] + 1)
    time_s, scale = traces.time_s[shown], 1e3
    limit_y(axes, scale * traces.force_n[shown], beside=scale * traces.paper_n[shown], trim=0.001)
    plot(axes, time_s, scale * traces.paper_n[shown], VERMILION, "paper's algorithm, 300 ms late")
    plot(axes, time_s, scale * traces.force_n[shown], BLACK, "measured", width=1.6)
    plot(axes, time_s, scale * traces.prompt_n[shown], SKY, "paper's algorithm, no delay", width=0.6)
    plot(axes, time_s, scale * traces.product_n[shown], BLUE, "product, 300 ms round trip", width=1.5)
    axes.set_xlim(time_s[0], time_s[-1])
    finish(axes, "time in s", "force in mN")
    return figure


def _bench_error(traces: BenchTraces) -> Figure:
    figure, axes = one_plot(3.2)
    rows = np.flatnonzero(traces.scored)
    shown = slice(rows[0], rows[-1] + 1)
    time_s = traces.time_s[shown]
    late, prompt, product = (
        1e3 * (predicted - traces.force_n)[shown]
        for predicted in (traces.paper_n, traces.prompt_n, traces.product_n)
    )
    bound_mn = 1e3 * traces.bound_n
    band_about_zero(axes, bound_mn, "stated in the paper")
    limit_y(axes, late, product, np.array([-bound_mn, bound_mn]), trim=0.0005)
    plot(axes, time_s, late, VERMILION, "paper's algorithm, 300 ms late")
    plot(axes, time_s, prompt, SKY, "paper's algorithm, no delay")
    plot(axes, time_s, product, BLUE, "product, 300 ms round trip", width=1.4)
    axes.set_xlim(time_s[0], time_s[-1])
    finish(axes, "time in s", "error in mN")
    return figure


def _amplitudes(numbers: Unidentifiable, traces: AmplitudeTraces) -> Figure:
    """(a) Predicted force amplitude over frequency."""
    figure, axes = one_plot(3.6)
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
        axes.annotate(f"{row.paper_n:.3g} N", (row.omega_rad_s, row.paper_n), (6, -12), **_LABEL)
        axes.plot(row.omega_rad_s, row.true_n, "o", color=BLACK, markersize=4)
    axes.axvline(1.0, color=BLACK, linewidth=0.9, linestyle="dotted")
    axes.annotate("learned here", (1.0, 30.0), (5, 0), **_LABEL)
    axes.set_yscale("log")
    axes.set_xlim(0, 12)
    axes.yaxis.set_major_formatter("{x:g}")
    finish(axes, "angular frequency of the motion in rad/s", "force amplitude in N, for 1 m")
    return figure


def _windup(traces: WindupTraces) -> Figure:
    """(b) Growth of the covariance, and the parameters under noise."""
    figure = new_figure(3.4)
    left, right = figure.subplots(1, 2)
    colours = (PURPLE, VERMILION, ORANGE, GREEN)
    for (lam, growth), colour in zip(traces.paper_growth.items(), colours, strict=False):
        time_s, powers = traces.time_s[: len(growth)], np.log10(growth)
        left.plot(time_s, powers, color=colour, label=f"λ {lam:g}")
        left.plot(time_s[-1], powers[-1], "x", color=colour, markersize=8)
    left.plot(traces.time_s, np.log10(traces.product_growth), color=BLUE, linewidth=2, label="product")
    finish(left, "time in s", "growth of trace P, powers of ten", columns=5, margin=_WIDE)
    n = len(traces.noisy_largest)
    right.axhline(0.0, color=GREY, linewidth=5, zorder=0, label="true k")
    right.plot(traces.time_s[:n], np.log10(traces.noisy_largest), color=VERMILION, label="paper, λ 0.96")
    right.plot(traces.time_s, np.log10(traces.product_largest), color=BLUE, linewidth=2, label="product")
    finish(right, "time in s", "largest parameter, powers of ten", columns=3, margin=_WIDE)
    return figure


def _memory(numbers: MemoryResult, shown: MemoryTraces) -> Figure:
    """(c) Error by sample rate, and the prediction at 100 Hz."""
    figure = new_figure(3.4)
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
    finish(left, "sample rate in Hz", "rms error in N", columns=3, margin=_WIDE)
    limit_y(right, 2.0 * shown.force_n)
    plot(right, shown.time_s, shown.paper_n, VERMILION, "paper's algorithm, 100 Hz")
    plot(right, shown.time_s, shown.force_n, BLACK, "true force", width=1.6)
    plot(right, shown.time_s, shown.product_n, BLUE, "product")
    right.set_xlim(0, shown.time_s[-1])
    finish(right, "time in s", "force in N", columns=3)
    return figure


def _unmodelled(traces: list[UnmodelledTraces]) -> Figure:
    """(d) The error that an unmodelled bias or friction leaves."""
    figure = new_figure(2.9)
    grid = figure.subplots(1, len(traces), sharey=True, squeeze=False)[0]
    for axes, one in zip(grid, traces, strict=True):
        paper_mn, product_mn = (1e3 * (made - one.force_n) for made in (one.paper_n, one.product_n))
        late = one.time_s > 6.0
        limit_y(axes, paper_mn[late], product_mn[late])
        plot(axes, one.time_s, paper_mn, VERMILION, "paper's algorithm", 1.5)
        plot(axes, one.time_s, product_mn, BLUE, "product", 1.5)
        axes.set_xlim(0, one.time_s[-1])
        finish(axes, f"time in s, {one.what} of {1e3 * SHOWN_N:g} mN", "error in mN", columns=2)
    return figure


def _baseline(rows: tuple[BaselineRow, ...]) -> Figure:
    """(e) Every run's error relative to the hold."""
    figure, axes = one_plot(1.2 + 0.27 * len(rows))
    labels = {"paper's algorithm": VERMILION, "paper's algorithm, tared": GREEN, "product": BLUE}
    _ratios(axes, rows, labels, ("paper", "tared", "product"))
    return figure


def _ratios(
    axes: Axes, rows: tuple[BaselineRow, ...], labels: dict[str, str], methods: tuple[str, ...]
) -> None:
    """One line per run, rms over that of the hold on a logarithmic axis."""
    places = np.arange(len(rows))[::-1]
    axes.axvline(1.0, color=ORANGE, linewidth=2.5, label="hold")
    markers = ("o", "s", "D")
    for (label, colour), method, marker in zip(labels.items(), methods, markers, strict=False):
        known = [(getattr(row, f"{method}_over_zoh"), place) for row, place in zip(rows, places, strict=True)]
        finite = [(value, place) for value, place in known if value is not None]
        axes.plot(*zip(*finite, strict=True), marker, color=colour, markersize=7, label=label)
        for value, place in known:
            if value is None:
                axes.annotate("diverged", (1.0, place), (8, -4), **{**_LABEL, "color": colour})
    axes.set_yticks(places, [f"{row.name} ({_source(row)})" for row in rows])
    axes.set_xscale("log")
    plain_numbers(axes.xaxis)
    finish(axes, "rms error / that of the hold", "", margin=_WIDE)


def _source(row: BaselineRow) -> str:
    return "simulated bench" if row.source == "simulated bench" else "measured"


def _pairing(rows: tuple[BaselineRow, ...], simulated: SimulatedTraces) -> Figure:
    """(f) Both pairings on x = sin t and on every run."""
    figure = new_figure(max(3.2, 1.2 + 0.27 * len(rows)))
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.25))
    late = simulated.time_s > 2 * np.pi
    time_s, truth = simulated.time_s[late], simulated.force_n[late]
    left.plot(
        time_s, 1e3 * (simulated.arrived_n[late] - truth), color=ORANGE, linewidth=7, label="zero-order hold"
    )
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
    finish(left, "time in s", "error in mN, x = sin t", columns=3, margin=_WIDE)
    _ratios(right, rows, {"newest motion": PURPLE, "by stamps": VERMILION}, ("newest", "paper"))
    return figure


def _thresholds(numbers: Thresholds) -> Figure:
    """Share of the time in which the error is not felt, by instrument, style and method."""
    figure = new_figure(3.3)
    instruments = list(dict.fromkeys(row.instrument for row in numbers.rows))
    grid = figure.subplots(1, len(instruments), sharey=True, squeeze=False)[0]
    for axes, instrument in zip(grid, instruments, strict=True):
        _shares(axes, numbers, instrument)
    return figure


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
    finish(axes, f"{instrument}, force scale {scale:g}", "share of the time in %", columns=3, margin=_WIDE)


def short_table(numbers: Reproduction, folder: Path) -> list[str]:
    """What was found, a line each."""
    flaws = numbers.flaws
    lines = [f"{line.subject:<42} {line.verdict}" for line in numbers.comparisons]
    found, fast = flaws.unidentifiable, flaws.memory.rows[0]
    ends = ", ".join(
        f"{row.forgetting_factor:g}: {quantity(row.overflow_s, 's')}" for row in flaws.windup.rows
    )
    bias = next(row for row in flaws.unmodelled.rows if row.what == "bias")
    lines += [
        f"(a) identifiable    m {found.paper[0]:.3g}, b {found.paper[1]:.3g}, k {found.paper[2]:.3g} for "
        f"{', '.join(f'{value:g}' for value in found.true)}; product: {'; '.join(found.product_says)}",
        f"(b) overflow        {ends}",
        f"(c) memory          {quantity(fast.paper_rms_n, 'N')} rms at {fast.rate_hz:g} Hz; "
        f"product {quantity(fast.product_rms_n, 'N')}",
        f"(d) bias            {quantity(bias.size_n, 'N')} leave {quantity(bias.paper_rms_n, 'N')}; "
        f"product {quantity(bias.product_rms_n, 'N')}",
        f"(f) pairing         {quantity(flaws.pairing.newest_rms_n, 'N')} rms, "
        f"zero-order hold {quantity(flaws.pairing.zoh_rms_n, 'N')}",
        f"{'(e) rms over that of the hold':<48} {'paper':>8} {'tared':>8} {'product':>8}",
    ]
    lines += [
        f"    {row.name + (', simulated bench' if row.source == 'simulated bench' else ''):<44} "
        f"{ratio(row.paper_over_zoh):>8} {ratio(row.tared_over_zoh):>8} {ratio(row.product_over_zoh):>8}"
        for row in flaws.baseline.rows
    ]
    if not flaws.baseline.recordings_given:
        lines.append("    no measured recordings given (--recordings DIR)")
    lines.append(
        f"{'Error not felt (29 mN or 7 %), share of time':<48} {'zoh':>8} {'paper':>8} {'product':>8}"
    )
    shares = {(row.instrument, row.style, row.method): row.strict_share for row in numbers.thresholds.rows}
    for instrument, style in dict.fromkeys((key[0], key[1]) for key in shares):
        values = [shares[instrument, style, method] for method in ("zoh", "paper", "product")]
        lines.append(f"    {f'{instrument}, {style}':<44} {' '.join(f'{share(v):>8}' for v in values)}")
    lines += [f"Files      reproduction.html, reproduction.json, figures in {folder}", DISCLAIMER]
    return lines
