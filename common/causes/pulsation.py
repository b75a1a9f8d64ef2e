"""Heart beat or breath: a periodic force that comes without motion of the instrument."""

from math import hypot

import numpy as np

from forefeel.common.causes.candidate import Entry, Found, Periodic, Shape, Values, entry
from forefeel.common.causes.harmonics import PeriodicForce, harmonic_parameters
from forefeel.common.causes.offline import Array


def _sines_and_cosines(t: Array, shape: Shape) -> Array:
    """sin of a frequency and its two harmonics, then cos, shape (n, 6)."""
    phase = 2.0 * np.pi * shape[0] * t[:, None] * np.arange(1, 4)
    return np.hstack([np.sin(phase), np.cos(phase)])


def _strongest(found: Found) -> Values:
    c = found.coefficients
    sizes = [hypot(sine, cosine) for sine, cosine in zip(c[:3], c[3:], strict=True)]
    return {"frequency_hz": found.shape[0], "amplitude_n": max(sizes)}


def _wave(found: Found) -> list[Entry]:
    """With phases by the stamp."""
    (frequency_hz,), c = found.shape, found.coefficients
    wave = c[:3] + 1j * c[3:]  # sin + i cos: amplitude times exp(i phase) of a sine
    wave = wave * np.exp(-2j * np.pi * frequency_hz * found.start_s * np.arange(1, 4))
    pairs = np.column_stack([wave.real, wave.imag]).ravel().tolist()
    return [entry(Pulsation, Pulsation(frequency_hz=frequency_hz).from_span(pairs))]


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
    words = "a periodic force of its own, such as heart beat or breath"
    equation = ("{amplitude_n} sin(2 pi {frequency_hz} t) and harmonics",)
    candidates = (
        Periodic(
            signs=(0,) * 6, columns=_sines_and_cosines, naming=_strongest, making=_wave, picture="period"
        ),
    )
