"""(c) A forgetting factor is a memory in samples."""

from dataclasses import dataclass
from math import log

import numpy as np
from numpy.typing import NDArray

from forefeel.studies.paper.contact import MASS_KG, THETA, Array, noise_n, rms, sines
from forefeel.studies.paper.online import PAPER_LAMBDA, SAFE_MEMORY_S, learn_paper, learn_safe
from forefeel.studies.paper.results import MemoryResult, MemoryRow

RATES_HZ = 1000.0, 100.0, 10.0  # Hz; the paper gives no rate, and a forgetting factor is a memory in samples
# N, standard deviation, 0.5 % of the force's amplitude; chosen, not measured: errors grow with it
NOISE_N = 0.005
# s of each run, over two periods of x = sin t; chosen, not measured: longer averages over more noise
DURATION_S = 15.0
# s after the start, and the delay, from which errors count; chosen, not measured: all start cold
SCORED_FROM_S = 3.0
SEEDS = 5  # noises for each rate; chosen, not measured: more show the spread better and take longer


@dataclass(frozen=True, slots=True)
class MemoryTraces:
    """At one rate, shape (n,): the true force, and what is predicted for it across the delay."""

    rate_hz: float
    time_s: Array
    force_n: Array
    paper_n: Array
    product_n: Array


def memory_s(rate_hz: float, lam: float = PAPER_LAMBDA) -> float:
    """Time in which the weight of a sample falls to 1 / e: -1 / (rate ln lambda)."""
    return -1.0 / (rate_hz * log(lam))


def memory(delay_s: float) -> tuple[MemoryResult, list[MemoryTraces]]:
    """The paper's simulation with noise and a delay, at three sample rates."""
    made = [_at(rate_hz, delay_s) for rate_hz in RATES_HZ]
    numbers = MemoryResult(
        noise_n=NOISE_N,
        delay_s=delay_s,
        duration_s=DURATION_S,
        forgetting_factor=PAPER_LAMBDA,
        seeds=SEEDS,
        product_memory_s=SAFE_MEMORY_S,
        rows=tuple(row for row, _ in made),
    )
    return numbers, [traces for _, traces in made]


def _at(rate_hz: float, delay_s: float) -> tuple[MemoryRow, MemoryTraces]:
    motion = sines(rate_hz, DURATION_S)
    time_s, rows = motion.time_s, motion.rows()
    force_n = rows @ THETA
    late = time_s >= SCORED_FROM_S + delay_s
    paper, known, product = [], [], []
    for seed in range(SEEDS):
        measured = force_n + noise_n(len(force_n), NOISE_N, seed)
        paper.append(learn_paper(time_s, rows, measured, delay_s).predicted_n)
        product.append(learn_safe(time_s, rows, measured, delay_s)[0].predicted_n)
        inertia = MASS_KG * rows[:, 0]
        two = learn_paper(time_s, rows[:, 1:], measured - inertia, delay_s).predicted_n
        known.append(two + inertia)
    sizes = [[_size(one, force_n, late) for one in runs] for runs in (paper, known, product)]
    row = MemoryRow(
        rate_hz=rate_hz,
        memory_s=memory_s(rate_hz),
        paper_rms_n=float(np.median(sizes[0])),
        paper_lowest_n=min(sizes[0]),
        paper_highest_n=max(sizes[0]),
        known_mass_rms_n=float(np.median(sizes[1])),
        product_rms_n=float(np.median(sizes[2])),
    )
    return row, MemoryTraces(rate_hz, time_s, force_n, paper[0], product[0])


def _size(predicted_n: Array, force_n: Array, rows: NDArray[np.bool_]) -> float:
    value = rms((predicted_n - force_n)[rows])
    return np.inf if value is None else value
