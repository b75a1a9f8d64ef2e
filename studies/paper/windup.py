"""(b) Forgetting without information: the covariance grows until the numbers overflow."""

from dataclasses import dataclass
from math import log
from sys import float_info

import numpy as np

from forefeel.common.estimation.paper import PaperRls
from forefeel.studies.paper.contact import THETA, Array, noise_n, sines
from forefeel.studies.paper.online import PAPER_DELTA, PAPER_LAMBDA, safe_rls
from forefeel.studies.paper.results import Windup, WindupRow

RATE_HZ = 1000.0  # Hz, rate of the control loop; the paper gives none
# forgetting factors from the 0.95 to 0.99 that the paper recommends; 0.99 overflows only after 69 s
LAMBDAS = 0.95, 0.96, 0.97, 0.98
# N, standard deviation of the noise, 0.1 % of the force's amplitude; chosen, not measured: with more a
# parameter is lost sooner
NOISE_N = 0.001
# SI units of a parameter, beyond which it is lost: 1e5 times the largest true one; chosen, not measured:
# larger is passed later
LIMIT = 1e5
SEEDS = 3  # noises for each forgetting factor; chosen, not measured: their median is reported
_KEPT_EVERY = 20  # samples between two that are drawn: 20 ms at 1 kHz


@dataclass(frozen=True, slots=True)
class WindupTraces:
    """Trace of P over time, in units of its start: of the paper's algorithm by lambda, and of the product's;
    and the largest parameter under noise.
    """

    time_s: Array
    paper_growth: dict[float, Array]
    product_growth: Array
    noisy_largest: Array
    product_largest: Array


@dataclass(frozen=True, slots=True)
class _Pass:
    overflow_s: float | None
    exceeds_s: float | None
    largest: float
    growth: Array
    parameter: Array


def expected_overflow_s(lam: float, rate_hz: float = RATE_HZ, delta: float = PAPER_DELTA) -> float:
    """When lambda^-k / delta passes the largest double: k = ln(1.8e308 delta) / -ln(lambda) samples."""
    return (log(float_info.max) + log(delta)) / -log(lam) / rate_hz


def windup() -> tuple[Windup, WindupTraces]:
    """x = sin t at 1 kHz with each forgetting factor, without and with noise; and the product on the same."""
    longest_s = 1.02 * expected_overflow_s(max(LAMBDAS))
    clean = {lam: _paper(lam, longest_s) for lam in LAMBDAS}
    noisy = {lam: [_paper(lam, longest_s, seed) for seed in range(SEEDS)] for lam in LAMBDAS}
    product, product_noisy = _product(longest_s, None), _product(longest_s, 0)
    numbers = Windup(
        rate_hz=RATE_HZ,
        noise_n=NOISE_N,
        limit=LIMIT,
        seeds=SEEDS,
        rows=tuple(
            WindupRow(
                forgetting_factor=lam,
                overflow_s=clean[lam].overflow_s,
                expected_s=expected_overflow_s(lam),
                unsymmetrised_s=_paper(lam, longest_s, symmetrise=False).overflow_s,
                noisy_exceeds_s=_median([one.exceeds_s for one in noisy[lam]]),
                noisy_largest=max(one.largest for one in noisy[lam]),
            )
            for lam in LAMBDAS
        ),
        product_duration_s=longest_s,
        product_largest=product.largest,
        product_largest_noisy=product_noisy.largest,
        product_trace_growth=float(product_noisy.growth.max()),
    )
    shown = noisy[PAPER_LAMBDA][0]
    return numbers, WindupTraces(
        time_s=np.arange(len(product.growth)) * _KEPT_EVERY / RATE_HZ,
        paper_growth={lam: clean[lam].growth for lam in LAMBDAS},
        product_growth=product_noisy.growth,
        noisy_largest=shown.parameter,
        product_largest=product_noisy.parameter,
    )


def _paper(lam: float, duration_s: float, seed: int | None = None, symmetrise: bool = True) -> _Pass:
    motion = sines(RATE_HZ, duration_s)
    rows = motion.rows()
    rls = PaperRls(3, lam, delta=PAPER_DELTA, symmetrise=symmetrise)
    growth, parameter = [], []
    overflow_s = exceeds_s = None
    largest = 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        for i, y in enumerate(_forces(rows, seed).tolist()):
            rls.update(rows[i], y)
            size = float(np.abs(rls.theta).max())
            if not np.isfinite(size):
                overflow_s = i / RATE_HZ
                break
            largest = max(largest, size)
            if exceeds_s is None and size > LIMIT:
                exceeds_s = i / RATE_HZ
            if i % _KEPT_EVERY == 0:
                growth.append(float(np.trace(rls.covariance)) * PAPER_DELTA / 3.0)
                parameter.append(size)
    return _Pass(overflow_s, exceeds_s, largest, np.array(growth), np.array(parameter))


def _product(duration_s: float, seed: int | None) -> _Pass:
    rows = sines(RATE_HZ, duration_s).rows()
    rls = safe_rls(rows)
    start = sum(rls.prior_diagonal)
    growth, parameter = [], []
    for i, y in enumerate(_forces(rows, seed).tolist()):
        rls.update(rows[i].tolist(), y, 1.0 / RATE_HZ)
        if i % _KEPT_EVERY == 0:
            growth.append(sum(rls.covariance[j][j] for j in range(3)) / start)
            parameter.append(max(abs(value) for value in rls.parameters))
    return _Pass(None, None, max(parameter), np.array(growth), np.array(parameter))


def _forces(rows: Array, seed: int | None) -> Array:
    force_n = rows @ THETA
    return force_n if seed is None else force_n + noise_n(len(force_n), NOISE_N, seed)


def _median(times_s: list[float | None]) -> float | None:
    """Median of when it happened; None when in most cases it did not."""
    known = sorted(np.inf if value is None else value for value in times_s)
    middle = known[len(known) // 2]
    return middle if np.isfinite(middle) else None
