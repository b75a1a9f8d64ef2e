"""The paper's algorithm and the hold on a recording, as a master `delay_s` away could have run them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation.state_filter import StateFilter
from forefeel.common.recording.recording import Recording
from forefeel.studies.paper.contact import Array, rms
from forefeel.studies.paper.online import held, learn_paper
from forefeel.studies.paper.results import BaselineRow, ErrorSummary, error_size, ratio

# Hz, cutoff of the filter that gives the derivatives; chosen, not measured: lower lags more, higher is
# noisier
CUTOFF_HZ = 20.0
SCORED_FROM_S = 3.0
"""Scoring begins this long, and the delay, after the first sample."""


@dataclass(frozen=True, slots=True, eq=False)
class ReplayedRun:
    """A recording with what the product predicted for each of its samples, NaN for none, shape (n,).

    `bench`: of the simulated bench; then `style` is the operator's, `force_scale` what the hand is shown, and
    `round_trip_s` the median that the run had.
    """

    name: str
    recording: Recording
    product_n: Array | None = None
    bench: bool = False
    instrument: str = ""
    style: str = ""
    force_scale: float = 1.0
    round_trip_s: float | None = None

    @property
    def force_n(self) -> Array:
        """The measured force."""
        assert self.recording.force_n is not None
        return self.recording.force_n


@dataclass(frozen=True, slots=True)
class RunPredictions:
    """Predictions for every sample of a run, shape (n,); `scored`: where they are compared."""

    run: ReplayedRun
    zoh_n: Array
    paper_n: Array
    newest_n: Array
    tared_n: Array
    scored: NDArray[np.bool_]

    def method(self, name: str) -> Array:
        """The predictions of `hold`, `paper`, `newest`, `tared` or `product`."""
        known = {"zoh": self.zoh_n, "paper": self.paper_n, "newest": self.newest_n, "tared": self.tared_n}
        nothing = np.full(len(self.zoh_n), np.nan)
        product = self.run.product_n if self.run.product_n is not None else nothing
        return known.get(name, product)

    def error(self, name: str) -> ErrorSummary:
        """The error of a method on what is scored."""
        return error_size(self.method(name)[self.scored], self.run.force_n[self.scored])

    @property
    def scored_s(self) -> float:
        """How much time is scored."""
        return float(np.count_nonzero(self.scored)) / self.run.recording.rate_hz


def replay(run: ReplayedRun, delay_s: float) -> RunPredictions:
    """Hold and the paper's algorithm in both pairings, and tared; cold start.

    Scored from 3 s and the delay on, and only the samples for which the product has a prediction.
    """
    recording = run.recording
    rows = motion_rows(recording)
    time_s, force_n = recording.time_s, run.force_n
    scored = time_s >= time_s[0] + SCORED_FROM_S + delay_s
    if run.product_n is not None:
        scored = scored & np.isfinite(run.product_n)
    return RunPredictions(
        run,
        held(time_s, force_n, delay_s),
        learn_paper(time_s, rows, force_n, delay_s).predicted_n,
        learn_paper(time_s, rows, force_n, delay_s, pairing="newest").predicted_n,
        learn_paper(time_s, rows, force_n - force_n[0], delay_s).predicted_n + force_n[0],
        scored,
    )


def motion_rows(recording: Recording) -> Array:
    """phi = [x'', x', x] of equation (1) at each sample, shape (n, 3).

    Position as it was read; derivatives by the product's causal filter at 20 Hz, or a quarter of the sample
    rate where that is less. It starts anew behind a gap.
    """
    state = StateFilter(min(CUTOFF_HZ, recording.rate_hz / 4.0))
    rows = np.empty((len(recording), 3))
    for piece in recording.segments():
        state.reset()
        steps = np.diff(recording.time_s[piece], prepend=recording.time_s[piece.start]).tolist()
        for i, dt in enumerate(steps, start=piece.start):
            x = float(recording.position_m[i])
            _, v, a = state.step(x, dt)
            rows[i] = a, v, x
    return rows


def thinned(recording: Recording, rate_hz: float) -> Recording:
    """Every n-th sample, so that about `rate_hz` remain."""
    step = max(1, round(recording.rate_hz / rate_hz))
    return Recording(
        recording.name,
        recording.time_s[::step],
        recording.position_m[::step],
        None if recording.force_n is None else recording.force_n[::step],
        recording.source,
    )


def baseline_row(made: RunPredictions) -> BaselineRow:
    """One run's errors side by side."""
    names = "zoh", "paper", "newest", "tared", "product"
    hold, paper, newest, tared, product = (made.error(name) for name in names)
    return BaselineRow(
        name=made.run.name,
        source="simulated bench" if made.run.bench else "recording",
        scored=int(np.count_nonzero(made.scored)),
        scored_s=made.scored_s,
        force_rms_n=rms(made.run.force_n[made.scored]),
        zoh=hold,
        paper=paper,
        newest=newest,
        tared=tared,
        product=product,
        paper_over_zoh=ratio(paper, hold),
        newest_over_zoh=ratio(newest, hold),
        tared_over_zoh=ratio(tared, hold),
        product_over_zoh=ratio(product, hold),
    )
