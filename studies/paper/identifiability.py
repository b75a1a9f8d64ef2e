"""(a) With x = sin t mass and stiffness can not be told apart."""

from dataclasses import dataclass

import numpy as np

from forefeel.common.estimation.identifiability import analyse, information
from forefeel.common.estimation.rls import RecursiveLeastSquares
from forefeel.studies.paper.contact import (
    OMEGA_RAD_S,
    PAPER_MOTION,
    THETA,
    Array,
    Sine,
    force_amplitude_n,
    sines,
)
from forefeel.studies.paper.online import learn_paper, learn_safe
from forefeel.studies.paper.results import AmplitudeRow, Unidentifiable, error_size

RATE_HZ = 100.0  # Hz, as in figures 4 and 5; the paper gives no rate
# s of learning, three periods of x = sin t; chosen, not measured: the memory at 100 Hz is 0.25 s
DURATION_S = 20.0
SETTLED_S = 5.0  # s after which errors count; chosen, not measured: earlier ones are those of the cold start
# rad/s, frequencies that were not learned and are asked for; chosen as examples
OMEGAS_RAD_S = 2.0, 5.0, 10.0
# m and rad/s of the sine that makes m and k identifiable; chosen as an example
SECOND_SINE: Sine = (0.3, 4.0)
_NAMES = "m", "b", "k"


@dataclass(frozen=True, slots=True)
class AmplitudeTraces:
    """Force amplitude over the angular frequency of a motion of 1 m, shape (n,)."""

    omega_rad_s: Array
    true_n: Array
    paper_n: Array
    product_n: Array
    product_two_frequencies_n: Array


def unidentifiable() -> tuple[Unidentifiable, AmplitudeTraces]:
    """Learns m, b, k from x = sin t, then asks for other frequencies; then again with a second sine."""
    paper, product, says = _learn(PAPER_MOTION)
    paper_two, product_two, says_two = _learn((*PAPER_MOTION, SECOND_SINE))
    motion = sines(RATE_HZ, DURATION_S)
    late = motion.time_s >= SETTLED_S
    force_n = motion.rows() @ THETA
    numbers = Unidentifiable(
        rate_hz=RATE_HZ,
        duration_s=DURATION_S,
        true=tuple(THETA.tolist()),
        paper=tuple(paper.tolist()),
        paper_error=error_size((motion.rows() @ paper)[late], force_n[late]),
        true_combination_n_m=combination(THETA),
        paper_combination_n_m=combination(paper),
        amplitudes=tuple(
            AmplitudeRow(
                omega_rad_s=w,
                true_n=force_amplitude_n(THETA, w),
                paper_n=force_amplitude_n(paper, w),
                product_n=force_amplitude_n(product, w),
                product_two_frequencies_n=force_amplitude_n(product_two, w),
            )
            for w in OMEGAS_RAD_S
        ),
        product=tuple(product.tolist()),
        product_says=says,
        second_omega_rad_s=SECOND_SINE[1],
        paper_two_frequencies=tuple(paper_two.tolist()),
        product_two_frequencies=tuple(product_two.tolist()),
        product_says_two_frequencies=says_two,
    )
    grid = np.linspace(0.2, 12.0, 237)
    curves = [np.array([force_amplitude_n(t, w) for w in grid]) for t in (THETA, paper, product, product_two)]
    return numbers, AmplitudeTraces(grid, *curves)


def combination(theta: Array) -> float:
    """k - m w^2 at the frequency of the paper's simulation: all that it lets one know of m and k."""
    return float(theta[2] - theta[0] * OMEGA_RAD_S**2)


def statements(rls: RecursiveLeastSquares, names: tuple[str, ...] = _NAMES) -> tuple[str, ...]:
    """What the product says is not determined; empty when all is."""
    gathered = information(rls.covariance, rls.prior_diagonal, rls.scales)
    return analyse(gathered, names, rls.scales).statements


def _learn(parts: tuple[Sine, ...]) -> tuple[Array, Array, tuple[str, ...]]:
    """(the paper's theta, the product's, what the product says) after learning without noise or delay."""
    motion = sines(RATE_HZ, DURATION_S, parts)
    rows = motion.rows()
    paper = learn_paper(motion.time_s, rows, rows @ THETA, 0.0)
    safe, rls = learn_safe(motion.time_s, rows, rows @ THETA, 0.0)
    return paper.theta[-1], safe.theta[-1], statements(rls)
