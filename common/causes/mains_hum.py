"""Pick-up of the mains in the load cell's cable."""

from forefeel.common.causes.harmonics import PeriodicForce, harmonic_parameters


class MainsHum(PeriodicForce):
    """`f = A (sin p + r2 sin(2p + q2) + r3 sin(3p + q3))`, p = 2 pi frequency_hz t + phase_rad.

    A = amplitude_n, r2 = second_harmonic_ratio, q2 = second_harmonic_phase_rad, r3 and q3 likewise.
    Also at no load. t counts from the caller's own zero.
    """

    name = "mains_hum"
    site = "sensor"
    parameters = harmonic_parameters(50.0, 45.0, 65.0)
    reference = "Ott, Electromagnetic Compatibility Engineering, 2009; mains of 50 or 60 Hz"
    fingerprint = "a narrow line at 50 or 60 Hz and its harmonics, the same at rest and at no load"
    words = "hum of the mains"
