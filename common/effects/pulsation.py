"""Heart beat or breath: a periodic force that comes without motion of the instrument."""

from forefeel.common.effects.harmonics import PeriodicForce, harmonic_parameters


class Pulsation(PeriodicForce):
    """`f = A (sin p + r2 sin(2p + q2) + r3 sin(3p + q3))`, p = 2 pi frequency_hz t + phase_rad.

    A = amplitude_n, r2 = second_harmonic_ratio, q2 = second_harmonic_phase_rad, r3 and q3 likewise.
    t counts from the caller's own zero, so a phase found on one recording holds for that recording only.
    """

    name = "pulsation"
    site = "wall"
    parameters = harmonic_parameters(1.2, 0.05, 50.0)
    reference = "Fourier series of the arterial pulse, McDonald's Blood Flow in Arteries, 6th ed."
    fingerprint = "a line in the spectrum and its harmonics that stay while the operator holds still"
