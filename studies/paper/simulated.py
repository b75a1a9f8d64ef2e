"""The paper's simulation without and with a delay, figures 4 and 5; and (f), the newest motion paired with
the delayed force.
"""

from collections import deque
from dataclasses import dataclass
from math import sin, sqrt

import numpy as np

from forefeel.common.estimation.paper import PaperRls, SisoRegressor
from forefeel.studies.paper.contact import OMEGA_RAD_S, THETA, Array, force_amplitude_n, rms, sines
from forefeel.studies.paper.online import (
    PAPER_DELTA,
    PAPER_LAMBDA,
    held,
    learn_paper,
    learn_safe,
    newest_index,
)
from forefeel.studies.paper.results import ErrorSummary, Pairing, SimulatedFigure, error_size

RATE_HZ = 100.0  # Hz; the paper gives no rate
DURATION_S = 6.0 * np.pi
"""Three periods. The paper gives neither a rate nor a length."""

SCORED_FROM_S = 2.0 * np.pi
_SISO_ORDER = 2  # past forces and positions in equation (3), the order of the differential equation (1)


@dataclass(frozen=True, slots=True)
class SimulatedTraces:
    """What figure 4 or 5 draws, shape (n,); `arrived_n`: the measured force that the master has."""

    time_s: Array
    force_n: Array
    arrived_n: Array
    predicted_n: Array
    newest_n: Array


def simulated_figure(figure: int, delay_s: float) -> tuple[SimulatedFigure, SimulatedTraces]:
    """The paper's algorithm on x = sin t, m = 0.01, b = 0.1, k = 1, lambda = 0.96."""
    motion = sines(RATE_HZ, DURATION_S)
    time_s, rows = motion.time_s, motion.rows()
    force_n = rows @ THETA
    arrived_n = held(time_s, force_n, delay_s) if delay_s > 0.0 else force_n
    stamps = learn_paper(time_s, rows, force_n, delay_s)
    newest = learn_paper(time_s, rows, force_n, delay_s, pairing="newest")
    siso_n = siso_prediction(time_s, motion.position_m, force_n, delay_s)
    late = time_s >= SCORED_FROM_S
    m, b, k = stamps.theta[-1].tolist()
    numbers = SimulatedFigure(
        figure=figure,
        delay_s=delay_s,
        rate_hz=RATE_HZ,
        forgetting_factor=PAPER_LAMBDA,
        scored_from_s=SCORED_FROM_S,
        mass_kg=m,
        damping_n_s_m=b,
        stiffness_n_m=k,
        error=error_size(stamps.predicted_n[late], force_n[late]),
        lead_s=lead_s(time_s[late], stamps.predicted_n[late], arrived_n[late]),
        newest_error=error_size(newest.predicted_n[late], force_n[late]),
        newest_lead_s=lead_s(time_s[late], newest.predicted_n[late], arrived_n[late]),
        siso_error=error_size(siso_n[late], force_n[late]),
    )
    return numbers, SimulatedTraces(time_s, force_n, arrived_n, stamps.predicted_n, newest.predicted_n)


def lead_s(time_s: Array, first: Array, second: Array) -> float:
    """By how many seconds `first` is ahead of `second`, both sinusoids of 1 rad/s."""
    basis = np.column_stack([np.cos(OMEGA_RAD_S * time_s), np.sin(OMEGA_RAD_S * time_s)])
    (c1, s1), (c2, s2) = (np.linalg.lstsq(basis, values, rcond=None)[0] for values in (first, second))
    return float(np.angle(complex(c1, -s1) / complex(c2, -s2))) / OMEGA_RAD_S


def siso_prediction(
    time_s: Array,
    input_m: Array,
    force_n: Array,
    delay_s: float,
    na: int = _SISO_ORDER,
    nb: int = _SISO_ORDER,
) -> Array:
    """Equations (3) to (7): y(k) from past y and u, learned as the forces arrive, predicted up to now by
    putting the predictions in the place of the forces that are still on their way; shape (n,).
    """
    regressor = SisoRegressor(na, nb)
    rls = PaperRls(na + nb, PAPER_LAMBDA, delta=PAPER_DELTA, symmetrise=True)
    predicted = np.full(len(time_s), np.nan)
    next_force, u, y = 0, input_m.tolist(), force_n.tolist()
    for i, available in enumerate(newest_index(time_s, delay_s).tolist()):
        for j in range(next_force, available + 1):
            rls.update(regressor.phi(), y[j])
            regressor.push(y[j], u[j])
        next_force = max(next_force, available + 1)
        if available >= 0:
            predicted[i] = _carry_on(rls.theta.tolist(), y[: available + 1], u[:i], (na, nb))
    return predicted


def _carry_on(theta: list[float], y: list[float], u: list[float], orders: tuple[int, int]) -> float:
    """y(i), i = len(u), from y up to where it is known and u up to i - 1; zero before the first sample."""
    na, nb = orders
    outputs = deque(([0.0] * na + y)[-na:][::-1], maxlen=na)
    value, padded = 0.0, [0.0] * nb + u
    for k in range(len(y), len(u) + 1):
        inputs = padded[k : k + nb][::-1]
        value = sum(-a * o for a, o in zip(theta[:na], outputs, strict=True))
        value += sum(b * v for b, v in zip(theta[na:], inputs, strict=True))
        outputs.appendleft(value)
    return value


def expected_rms_n(delay_s: float) -> float:
    """rms of f(t - D) - f(t) for f = A sin(w t + c): sqrt(2) A |sin(w D / 2)|."""
    return sqrt(2.0) * force_amplitude_n(THETA, OMEGA_RAD_S) * abs(sin(0.5 * OMEGA_RAD_S * delay_s))


def pairing(figure: SimulatedFigure, hold: ErrorSummary) -> Pairing:
    """The two pairings on x = sin t, beside the hold and the product there."""
    motion = sines(RATE_HZ, DURATION_S)
    force_n = motion.rows() @ THETA
    product_n = learn_safe(motion.time_s, motion.rows(), force_n, figure.delay_s)[0].predicted_n
    late = motion.time_s >= SCORED_FROM_S
    return Pairing(
        delay_s=figure.delay_s,
        stamps_rms_n=figure.error.rms_n,
        newest_rms_n=figure.newest_error.rms_n,
        product_rms_n=rms((product_n - force_n)[late]),
        zoh_rms_n=hold.rms_n,
        expected_n=expected_rms_n(figure.delay_s),
    )
