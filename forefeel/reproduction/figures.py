"""The figures of the paper: 4 and 5 of its simulation, 7 to 10 on the simulated bench."""

import numpy as np
from matplotlib.figure import Figure

from forefeel.diagnosis.reproduction.bench import FIGURES, BenchTraces
from forefeel.diagnosis.reproduction.results import BenchFigure
from forefeel.diagnosis.reproduction.simulated import SimulatedTraces
from forefeel.report.svg import BLACK, BLUE, GREY, PURPLE, SKY, VERMILION, limit_y, plot
from forefeel.reproduction.drawing import Picture, finish, picture

_BENCH = "Simulated bench, not the paper's phantom"


def simulated_pictures(prompt: SimulatedTraces, delayed: SimulatedTraces) -> list[Picture]:
    """Figures 4 and 5."""
    return [
        picture(
            "figure_04",
            "Figure 4: simulation without delay",
            "x = sin t, m 0.01 kg, b 0.1 N s/m, k 1 N/m, lambda 0.96, 100 Hz; prediction one sample ahead. "
            "Both curves coincide, as the paper says; the parameters behind the prediction are wrong, see "
            "(a).",
            2.9,
            lambda figure: _prompt(figure, prompt),
        ),
        picture(
            "figure_05",
            "Figure 5: the same with 300 ms delay",
            "Paired by the slave's stamps the prediction leads the measured force as it arrives by the "
            "delay, and coincides with the force at the contact now. Paired with the newest motion, which "
            "is how the paper describes it, the prediction only repeats the delayed force, see (f).",
            2.9,
            lambda figure: _delayed(figure, delayed),
        ),
    ]


def _prompt(figure: Figure, traces: SimulatedTraces) -> None:
    axes = figure.subplots()
    axes.plot(traces.time_s, traces.force_n, color=GREY, linewidth=5, label="measured")
    axes.plot(
        traces.time_s,
        traces.predicted_n,
        color=VERMILION,
        linewidth=1.4,
        label="predicted (paper's algorithm)",
    )
    axes.set_xlim(0, traces.time_s[-1])
    finish(axes, "force in N", "time in s")


def _delayed(figure: Figure, traces: SimulatedTraces) -> None:
    axes = figure.subplots()
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
    finish(axes, "force in N", "time in s")


def bench_pictures(traces: BenchTraces, numbers: BenchFigure) -> list[Picture]:
    """Prediction and error of one instrument: figures 7 and 8, or 9 and 10."""
    first, second = FIGURES[traces.instrument]
    what = traces.instrument
    return [
        picture(
            f"figure_{first:02}",
            f"Figure {first}: contact force of the {what}, simulated bench",
            f"{_BENCH}. Predicted for the instant of measurement: by the paper's algorithm without a delay "
            "(one sample, 1 ms, ahead), by the same with forces 300 ms late, and by this product over a "
            f"network with a round trip of {1e3 * numbers.round_trip_s:.0f} ms.",
            3.4,
            lambda figure: _bench_force(figure, traces),
        ),
        picture(
            f"figure_{second:02}",
            f"Figure {second}: error of the prediction, {what}, simulated bench",
            f"{_BENCH}. Grey: the bound that the paper states, {1e3 * traces.bound_n:.0f} mN. Within it: "
            f"{_share(numbers.without_delay.share_within)} of the time without a delay, "
            f"{_share(numbers.delayed.share_within)} with 300 ms, {_share(numbers.hold.share_within)} by "
            f"holding the late force. The force itself reaches {1e3 * numbers.force_peak_n:.0f} mN.",
            3.2,
            lambda figure: _bench_error(figure, traces),
        ),
    ]


def _share(value: float | None) -> str:
    return "none" if value is None else f"{100 * value:.0f} %"


def _bench_force(figure: Figure, traces: BenchTraces) -> None:
    axes = figure.subplots()
    rows = np.flatnonzero(traces.scored)
    shown = slice(rows[0], rows[-1] + 1)
    time_s, scale = traces.time_s[shown], 1e3
    limit_y(axes, scale * traces.force_n[shown], beside=scale * traces.paper_n[shown], trim=0.001)
    plot(axes, time_s, scale * traces.paper_n[shown], VERMILION, "paper's algorithm, 300 ms late")
    plot(axes, time_s, scale * traces.force_n[shown], BLACK, "measured", width=1.6)
    plot(axes, time_s, scale * traces.prompt_n[shown], SKY, "paper's algorithm, no delay", width=0.6)
    plot(axes, time_s, scale * traces.product_n[shown], BLUE, "product, 300 ms round trip", width=1.5)
    axes.set_xlim(time_s[0], time_s[-1])
    finish(axes, "force in mN", "time in s")


def _bench_error(figure: Figure, traces: BenchTraces) -> None:
    axes = figure.subplots()
    rows = np.flatnonzero(traces.scored)
    shown = slice(rows[0], rows[-1] + 1)
    time_s = traces.time_s[shown]
    late, prompt, product = (
        1e3 * (predicted - traces.force_n)[shown]
        for predicted in (traces.paper_n, traces.prompt_n, traces.product_n)
    )
    bound_mn = 1e3 * traces.bound_n
    axes.axhspan(-bound_mn, bound_mn, color=GREY, alpha=0.35, linewidth=0, label="stated in the paper")
    limit_y(axes, late, product, np.array([-bound_mn, bound_mn]), trim=0.0005)
    plot(axes, time_s, late, VERMILION, "paper's algorithm, 300 ms late")
    plot(axes, time_s, prompt, SKY, "paper's algorithm, no delay")
    plot(axes, time_s, product, BLUE, "product, 300 ms round trip", width=1.4)
    axes.set_xlim(time_s[0], time_s[-1])
    finish(axes, "error in mN", "time in s")
