"""All of it in order: numbers for reproduction.json, traces for the figures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from forefeel.studies.paper.bench import FIGURES, BenchTraces, bench_figure
from forefeel.studies.paper.comparison import comparisons
from forefeel.studies.paper.identifiability import AmplitudeTraces, unidentifiable
from forefeel.studies.paper.memory import MemoryTraces, memory
from forefeel.studies.paper.replay import ReplayedRun, RunPredictions, baseline_row, replay
from forefeel.studies.paper.results import (
    Baseline,
    ErrorSummary,
    Flaws,
    Reproduction,
    ThresholdRow,
    Thresholds,
    error_size,
)
from forefeel.studies.paper.simulated import SCORED_FROM_S, SimulatedTraces, pairing, simulated_figure
from forefeel.studies.paper.thresholds import ABSOLUTE_N, RELATIVE, threshold_rows
from forefeel.studies.paper.unmodelled import UnmodelledTraces, unmodelled
from forefeel.studies.paper.windup import WindupTraces, windup

DELAY_S = 0.3  # s, delay of all of the reproduction: a round trip of twice the 150 ms of the preset `paper`
NORMAL = "normal"
"""The operator style of figures 7 to 10."""

_NOTES = (
    "The paper gives neither its sample rates nor the length of its runs. Its simulation is run here at 100 "
    "Hz unless said otherwise, its bench at the 1 kHz of the control loop; other rates stand beside.",
    "The bench is a simulated bench: this product's own simulated vessel, stage and load cell, driven by a "
    "simulated operator in virtual time over a network of 150 ± 10 ms one way. Its numbers can not be those "
    "of the paper's phantom.",
    "The paper's algorithm is equations (8) to (12) with lambda 0.96 and P(0) = I / 1e-6, P made symmetric "
    "after each update, which helps it. On runs its velocity and acceleration come from a causal filter.",
    "Every prediction is made from forces stamped at least the delay earlier; without a delay it is one "
    "sample ahead. Runs are scored from 3 s and the delay after their start, the force as it was measured: "
    "raw, its offset included.",
    "On the simulated bench the product has the delay that its messages really had (see round_trip_s), hold "
    "and the paper's algorithm exactly 300 ms.",
    "A recorded force that, as recorded, would give energy is turned: here positive resists the motion. On "
    "recordings the product holds the late force until its identification is valid.",
)


@dataclass(frozen=True, slots=True)
class Traces:
    """What the figures draw."""

    simulated: tuple[SimulatedTraces, ...]
    bench: tuple[BenchTraces, ...]
    amplitudes: AmplitudeTraces
    windup: WindupTraces
    memory: list[MemoryTraces]
    unmodelled: list[UnmodelledTraces]
    replays: list[RunPredictions]


def assemble(
    runs: Sequence[ReplayedRun],
    skipped: Mapping[str, str] | None,
    styles: Mapping[str, Mapping[str, float]],
    seed: int,
    progress: Callable[[str], None],
) -> tuple[Reproduction, Traces]:
    """The whole reproduction.

    Args:
        runs: of the simulated bench, each instrument in each style, and recordings.
        skipped: recordings that could not be used, with the reason; None when no recordings were given.
        styles: the operator's settings by style.
        seed: of the bench.
        progress: is told what begins.
    """
    progress("figures 4 and 5")
    made = tuple(simulated_figure(figure, delay_s) for figure, delay_s in ((4, 0.0), (5, DELAY_S)))
    simulated, simulated_traces = tuple(one for one, _ in made), tuple(traces for _, traces in made)
    progress("a: which parameters are identifiable")
    identifiable, amplitudes = unidentifiable()
    progress("b: overflow at 1 kHz")
    winds, windup_traces = windup()
    progress("c: memory in samples")
    memories, memory_traces = memory(DELAY_S)
    progress("d: bias and friction")
    missing, unmodelled_traces = unmodelled(DELAY_S)
    progress("e, f: hold, pairing and figures 7 to 10")
    replays = [replay(run, DELAY_S) for run in runs]
    benches = [_of(replays, instrument) for instrument in FIGURES]
    figures = [bench_figure(one, DELAY_S) for one in benches]
    bench = tuple(one for one, _ in figures)
    numbers = Reproduction(
        delay_s=DELAY_S,
        seed=seed,
        comparisons=comparisons(simulated, bench, identifiable, winds),
        simulated=simulated,
        bench=bench,
        flaws=Flaws(
            unidentifiable=identifiable,
            windup=winds,
            memory=memories,
            unmodelled=missing,
            baseline=_baseline(replays, skipped),
            pairing=pairing(simulated[1], _hold(simulated_traces[1])),
        ),
        thresholds=_thresholds(replays, styles),
        notes=_NOTES,
    )
    return numbers, Traces(
        simulated_traces,
        tuple(traces for _, traces in figures),
        amplitudes,
        windup_traces,
        memory_traces,
        unmodelled_traces,
        replays,
    )


def _of(replays: list[RunPredictions], instrument: str) -> RunPredictions:
    return next(one for one in replays if one.run.instrument == instrument and one.run.style == NORMAL)


def _hold(traces: SimulatedTraces) -> ErrorSummary:
    late = traces.time_s >= SCORED_FROM_S
    return error_size(traces.arrived_n[late], traces.force_n[late])


def _baseline(replays: list[RunPredictions], skipped: Mapping[str, str] | None) -> Baseline:
    rows = tuple(baseline_row(one) for one in replays)
    return Baseline(
        delay_s=DELAY_S, rows=rows, recordings_given=skipped is not None, skipped=dict(skipped or {})
    )


def _thresholds(replays: list[RunPredictions], styles: Mapping[str, Mapping[str, float]]) -> Thresholds:
    rows: list[ThresholdRow] = []
    for one in replays:
        if one.run.bench:
            rows += threshold_rows(one)
    return Thresholds(
        relative=RELATIVE,
        absolute_n=ABSOLUTE_N,
        styles={name: dict(values) for name, values in styles.items()},
        rows=tuple(rows),
    )
