"""(f) The newest motion paired with the delayed force, in the paper's own simulation."""

from math import sin, sqrt

from forefeel.diagnosis.reproduction.contact import OMEGA_RAD_S, THETA, force_amplitude_n, rms, sines
from forefeel.diagnosis.reproduction.online import learn_safe
from forefeel.diagnosis.reproduction.results import ErrorSummary, Pairing, SimulatedFigure
from forefeel.diagnosis.reproduction.simulated import DURATION_S, RATE_HZ, SCORED_FROM_S


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
        hold_rms_n=hold.rms_n,
        expected_n=expected_rms_n(figure.delay_s),
    )
