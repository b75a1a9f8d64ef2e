"""The simulated bench: the whole product in virtual time over the network that the paper assumes; and figures
7 to 10 on it, catheter and guidewire, predicted and measured.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from forefeel.common.config import deep_merge
from forefeel.common.errors import RunError
from forefeel.common.recording.mcap_reader import Run as RecordedRun
from forefeel.common.recording.mcap_reader import read_run
from forefeel.common.topics import FORCE, HAPTICS
from forefeel.loopback.plan import AXIS, LoopbackOptions, Plan, make_plan
from forefeel.loopback.virtual import VirtualLoopback
from forefeel.report.score import first_answers
from forefeel.studies.paper.contact import Array, rms
from forefeel.studies.paper.online import learn_paper
from forefeel.studies.paper.replay import SCORED_FROM_S, ReplayedRun, RunPredictions, motion_rows, thinned
from forefeel.studies.paper.results import BenchFigure, BoundedError, error_size

FIGURES = {"catheter": (7, 8), "guidewire": (9, 10)}
STATED_BOUND_N = {"catheter": 0.015, "guidewire": 0.013}
RATES_HZ = 1000.0, 100.0, 10.0  # Hz; the paper gives no rate, so its algorithm is run at three

IMPAIRMENT = "paper"
"""150 ms one way: a round trip of 300 ms."""

STYLES: dict[str, dict[str, float]] = {
    "slow and careful": {
        "insert_s": 3.0,
        "withdraw_s": 2.4,
        "dwell_s": 0.8,
        "depth_m": 0.025,
        "tremor_m": 0.0001,
    },
    "normal": {"insert_s": 1.8, "withdraw_s": 1.4, "dwell_s": 0.6, "depth_m": 0.030, "tremor_m": 0.0002},
    "fast": {"insert_s": 0.9, "withdraw_s": 0.7, "dwell_s": 0.3, "depth_m": 0.035, "tremor_m": 0.0005},
}
"""Settings of the simulated operator, see `forefeel.master.settings.OperatorSettings`."""


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


def bench_run(instrument: str, style: str, duration_s: float, seed: int) -> ReplayedRun:
    """One operator with one instrument; what the load cell measured and what the product predicted for it.

    Raises:
        RunError: the slave never followed.
    """
    plan = _plan(instrument, style, duration_s, seed)
    loop = VirtualLoopback(plan, seed)
    loop.run(lambda _done_s: None)
    with TemporaryDirectory(prefix="forefeel-") as folder:
        path = Path(folder) / f"{instrument}.mcap"
        loop.write(path)
        recorded = read_run(path)
    product_n = _product_n(recorded)
    if not np.isfinite(product_n).any():
        raise RunError(f"simulated bench, {instrument}, {style}: nothing was predicted in {duration_s:g} s")
    delay_s = recorded.column(AXIS, HAPTICS, "delay_s").astype(np.float64)
    rendering = plan.master_settings().axes[0].rendering
    name = f"{instrument}, {style}"
    return ReplayedRun(
        name=name,
        recording=replace(recorded.to_recording(AXIS), name=name, source=f"simulated bench: {name}"),
        product_n=product_n,
        bench=True,
        instrument=instrument,
        style=style,
        force_scale=rendering.force_scale,
        round_trip_s=float(np.nanmedian(delay_s)),
    )


def _plan(instrument: str, style: str, duration_s: float, seed: int) -> Plan:
    plan = make_plan(
        LoopbackOptions(seed=seed, impairment=IMPAIRMENT, preset=instrument, duration_s=duration_s)
    )
    axis = deep_merge(plan.master["axes"][0], {"handle": STYLES[style]})
    return replace(plan, master={**plan.master, "axes": [axis]})


def _product_n(run: RecordedRun) -> Array:
    """For each sample of the recording, what was predicted in the tick whose command it answers first."""
    valid = run.column(AXIS, FORCE, "valid").astype(bool)
    stamp_ns = run.column(AXIS, FORCE, "stamp_ns")
    answers = run.column(AXIS, FORCE, "answers_sequence").astype(np.float64)
    rows = np.flatnonzero(valid & np.isfinite(answers))
    index = first_answers(
        (run.column(AXIS, HAPTICS, "session_id"), run.column(AXIS, HAPTICS, "sequence")),
        (run.column(AXIS, FORCE, "session_id")[rows], answers[rows]),
        stamp_ns[rows],
    )
    known = index >= 0
    stamps_ns = np.unique(stamp_ns[valid])  # as the recording has them
    product_n = np.full(len(stamps_ns), np.nan)
    predicted_n = run.column(AXIS, HAPTICS, "predicted_n").astype(np.float64)
    product_n[np.searchsorted(stamps_ns, stamp_ns[rows][index[known]])] = predicted_n[known]
    return product_n


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
        zoh=bounded(made.zoh_n),
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
