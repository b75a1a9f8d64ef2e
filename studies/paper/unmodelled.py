"""(d) A model without bias and friction: what these do to the prediction."""

from dataclasses import dataclass
from math import pi, sqrt
from typing import Literal

import numpy as np

from forefeel.studies.paper.contact import THETA, Array, rms, sines
from forefeel.studies.paper.online import PAPER_LAMBDA, learn_paper, learn_safe
from forefeel.studies.paper.results import Unmodelled, UnmodelledRow

RATE_HZ = 10.0
"""Where the paper's forgetting factor works best, see (c)."""

DURATION_S = 16.0 * pi
SCORED_FROM_S = 4.0 * pi
"""Whole periods: over these the closed forms hold. In a longer run a bias drives the wind-up of (b), too."""

# N, sizes of the bias and of the friction, 1 to 10 % of the force's amplitude; chosen as examples
SIZES_N = 0.010, 0.030, 0.100
SHOWN_N = 0.100  # N, the one of `SIZES_N` that is drawn

What = Literal["bias", "friction"]


@dataclass(frozen=True, slots=True)
class UnmodelledTraces:
    """With one unmodelled force, shape (n,)."""

    what: What
    time_s: Array
    force_n: Array
    paper_n: Array
    product_n: Array


def expected_rms_n(what: What, size_n: float) -> float:
    """What m, b, k can not take up over whole periods of sin t: all of a bias; of Coulomb friction all but
    its first harmonic (4 / pi) Fc cos t, which looks like damping: Fc sqrt(1 - 8 / pi^2).
    """
    return size_n if what == "bias" else size_n * sqrt(1.0 - 8.0 / pi**2)


def unmodelled(delay_s: float) -> tuple[Unmodelled, list[UnmodelledTraces]]:
    """The paper's simulation at 10 Hz with a bias, and with Coulomb friction, without noise."""
    kinds: tuple[What, What] = ("bias", "friction")
    made = {(what, size_n): _with(what, size_n, delay_s) for what in kinds for size_n in SIZES_N}
    numbers = Unmodelled(
        rate_hz=RATE_HZ,
        delay_s=delay_s,
        forgetting_factor=PAPER_LAMBDA,
        rows=tuple(row for row, _ in made.values()),
    )
    return numbers, [traces for (_, size_n), (_, traces) in made.items() if size_n == SHOWN_N]


def _with(what: What, size_n: float, delay_s: float) -> tuple[UnmodelledRow, UnmodelledTraces]:
    motion = sines(RATE_HZ, DURATION_S)
    time_s, rows = motion.time_s, motion.rows()
    one = np.ones_like(time_s)
    sense = np.sign(motion.velocity_m_s)
    force_n = rows @ THETA + size_n * (one if what == "bias" else sense)
    late = time_s >= SCORED_FROM_S
    paper = learn_paper(time_s, rows, force_n, delay_s).predicted_n
    ordinary = learn_paper(time_s, rows, force_n, delay_s, lam=1.0).predicted_n
    wide = np.column_stack([rows, one, sense])
    product = learn_safe(time_s, wide, force_n, delay_s)[0].predicted_n
    paper_rms_n, ordinary_rms_n, product_rms_n = (
        _known(rms((predicted - force_n)[late])) for predicted in (paper, ordinary, product)
    )
    row = UnmodelledRow(
        what=what,
        size_n=size_n,
        paper_rms_n=paper_rms_n,
        ordinary_rms_n=ordinary_rms_n,
        expected_n=expected_rms_n(what, size_n),
        product_rms_n=product_rms_n,
    )
    return row, UnmodelledTraces(what, time_s, force_n, paper, product)


def _known(value: float | None) -> float:
    assert value is not None
    return value
