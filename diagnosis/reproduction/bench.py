"""Figures 7 to 10: catheter and guidewire, predicted and measured, on the simulated bench."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from forefeel.diagnosis.reproduction.contact import Array, rms
from forefeel.diagnosis.reproduction.online import learn_paper
from forefeel.diagnosis.reproduction.replay import SCORED_FROM_S, RunPredictions, motion_rows, thinned
from forefeel.diagnosis.reproduction.results import BenchFigure, BoundedError, error_size

FIGURES = {"catheter": (7, 8), "guidewire": (9, 10)}
STATED_BOUND_N = {"catheter": 0.015, "guidewire": 0.013}
RATES_HZ = 1000.0, 100.0, 10.0  # Hz; the paper gives no rate, so its algorithm is run at three


@dataclass(frozen=True, slots=True)
class BenchTraces:
    """What two figures of the bench draw, shape (n,); `prompt_n`: the paper's prediction without a delay."""

    instrument: str
    bound_n: float
    time_s: Array
    force_n: Array
    prompt_n: Array
    paper_n: Array
    product_n: Array
    scored: NDArray[np.bool_]


def bench_figure(made: RunPredictions, delay_s: float) -> tuple[BenchFigure, BenchTraces]:
    """The numbers of one instrument's two figures and their traces."""
    run, rows = made.run, made.scored
    recording, bound_n = run.recording, STATED_BOUND_N[run.instrument]
    prompt_n = learn_paper(recording.time_s, motion_rows(recording), run.force_n, 0.0).predicted_n

    def bounded(predicted_n: Array) -> BoundedError:
        error = np.abs(predicted_n - run.force_n)[rows]
        return BoundedError(
            error=error_size(predicted_n[rows], run.force_n[rows]),
            share_within=float(np.mean(error <= bound_n)) if len(error) else None,
        )

    product_n = made.method("product")
    numbers = BenchFigure(
        figures=FIGURES[run.instrument],
        instrument=run.instrument,
        stated_bound_n=bound_n,
        delay_s=delay_s,
        round_trip_s=run.round_trip_s or delay_s,
        scored_s=made.scored_s,
        force_rms_n=rms(run.force_n[rows]),
        force_peak_n=float(np.max(np.abs(run.force_n[rows]), initial=0.0)),
        without_delay=bounded(prompt_n),
        delayed=bounded(made.paper_n),
        hold=bounded(made.hold_n),
        product=bounded(product_n),
        delayed_rms_by_rate_hz={f"{rate_hz:g}": _rms_at(made, rate_hz, delay_s) for rate_hz in RATES_HZ},
    )
    time_s = recording.time_s - recording.time_s[0]
    return numbers, BenchTraces(
        run.instrument, bound_n, time_s, run.force_n, prompt_n, made.paper_n, product_n, rows
    )


def _rms_at(made: RunPredictions, rate_hz: float, delay_s: float) -> float | None:
    """rms of the paper's delayed prediction when it is given that many samples a second."""
    few = thinned(made.run.recording, rate_hz)
    assert few.force_n is not None
    predicted_n = learn_paper(few.time_s, motion_rows(few), few.force_n, delay_s).predicted_n
    start_s = float(made.run.recording.time_s[made.scored][0]) if made.scored.any() else np.inf
    late = few.time_s >= max(start_s, few.time_s[0] + SCORED_FROM_S + delay_s)
    return rms((predicted_n - few.force_n)[late])
