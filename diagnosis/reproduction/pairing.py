"""(f) The newest motion paired with the delayed force, in the paper's own simulation."""

from math import sin, sqrt

from diagnosis.reproduction.contact import OMEGA_RAD_S, THETA, force_amplitude_n
from diagnosis.reproduction.results import ErrorSize, Pairing, SimulatedFigure


def expected_rms_n(delay_s: float) -> float:
    """rms of f(t - D) - f(t) for f = A sin(w t + c): sqrt(2) A |sin(w D / 2)|."""
    return sqrt(2.0) * force_amplitude_n(THETA, OMEGA_RAD_S) * abs(sin(0.5 * OMEGA_RAD_S * delay_s))


def pairing(figure: SimulatedFigure, hold: ErrorSize) -> Pairing:
    """The two pairings on x = sin t, beside the hold there."""
    return Pairing(
        delay_s=figure.delay_s,
        stamps_rms_n=figure.error.rms_n,
        newest_rms_n=figure.newest_error.rms_n,
        hold_rms_n=hold.rms_n,
        expected_n=expected_rms_n(figure.delay_s),
    )
