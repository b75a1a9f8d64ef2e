"""What causes do to spectra: late stamps, a slow load cell, modes; and harmonics over time."""

import numpy as np

from forefeel.common.error_size import Floats
from forefeel.diagnosis.diagnose.candidates import CANDIDATES, Model, Shape
from forefeel.diagnosis.diagnose.signals import Spectrum


def frame(model: Model, kinds: tuple[str, ...]) -> tuple[tuple[str, Shape], ...]:
    """What in a model changes the columns of all others; sorted, so that it can be a key."""
    return tuple(sorted((n, shape) for n, shape in model.items() if CANDIDATES[n].kind in kinds))


def harmonics(t: Floats, frequency_hz: float, count: int = 3) -> Floats:
    """sin and cos of the frequency and its multiples."""
    phase = 2.0 * np.pi * frequency_hz * t[:, None] * np.arange(1, count + 1)
    return np.hstack([np.sin(phase), np.cos(phase)])


def alignment(omega: Floats, model: Model) -> Spectrum | None:
    """What late stamps, a slow load cell, a weak fixture do to a spectrum; None when the model has none."""
    if not frame(model, ("alignment",)):
        return None
    factor = np.ones(len(omega), dtype=np.complex128)
    if "time_delay" in model:
        factor *= np.exp(-1j * omega * model["time_delay"][0])
    if "sensor_lag" in model:
        factor /= 1.0 + 1j * omega * model["sensor_lag"][0]
    if "unmodelled_resonance:fixture" in model:
        frequency_hz, zeta = model["unmodelled_resonance:fixture"]
        w = 2.0 * np.pi * frequency_hz
        factor *= w * w / (w * w - omega**2 + 2j * zeta * w * omega)
    return factor


def mode_spectra(omega: Floats, driven: Spectrum, shape: Shape, free: bool) -> list[Spectrum]:
    """A hanging mass, `y'' + 2 zeta w y' + w^2 y = a`: what it pulls with, `w^2 y + 2 zeta w y'`.

    Free: spring and damper to the moving part apart, `w^2 y` and `w y'`.
    """
    w, zeta = 2.0 * np.pi * shape[0], shape[1]
    y = driven / (w * w - omega**2 + 2j * zeta * w * omega)
    spring, damper = w * w * y, 1j * w * omega * y
    return [spring, damper] if free else [spring + 2.0 * zeta * damper]
