"""A second mode: a flexible instrument, clamp or fixture that swings on its own."""

from math import pi, sqrt

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.candidate import (
    Alignment,
    Entry,
    Extent,
    Fitted,
    Mode,
    Shape,
    Spectrum,
    entry,
    log_grid,
)
from forefeel.common.causes.motion import Kinematics, Oscillator, Value
from forefeel.common.causes.numerics import Array

_SHAPES = ("frequency_hz", "damping_ratio")

HIGHEST_MODE = 0.85
"""Part of the cutoff: the falling side of a peak above it is not seen."""

MOST_DAMPED = 0.3
"""A mode with more damping has no peak."""


def _modes(extent: Extent) -> list[Shape]:
    low, high = max(0.7, 4.0 / extent.duration_s), HIGHEST_MODE * extent.cutoff_hz
    return [(f, z) for (f,) in log_grid(low, high, 16) for z in (0.04, 0.15)]


def _free(omega: Array, driven: Spectrum, shape: Shape) -> list[Spectrum]:
    """Spectra of `w^2 y` and `w y'`, spring and damper of a hanging mass `y'' + 2 zeta w y' + w^2 y = a`."""
    w, zeta = 2.0 * pi * shape[0], shape[1]
    y = driven / (w * w - omega**2 + 2j * zeta * w * omega)
    return [w * w * y, 1j * w * omega * y]


def _hanging(omega: Array, driven: Spectrum, shape: Shape) -> list[Spectrum]:
    """Spectrum of the pull of the hanging mass, `w^2 y + 2 zeta w y'`."""
    spring, damper = _free(omega, driven, shape)
    return [spring + 2.0 * shape[1] * damper]


def _weak(omega: Array, shape: Shape) -> Spectrum:
    """Factor of all forces behind a fixture that gives way: `w^2 / (w^2 - omega^2 + 2j zeta w omega)`."""
    w, zeta = 2.0 * pi * shape[0], shape[1]
    return np.asarray(w * w / (w * w - omega**2 + 2j * zeta * w * omega))


def _absorber(fitted: Fitted) -> list[Entry]:
    """Returns one model.yaml entry: the resonance of force c[0] `w^2 y` + c[1] `w y'`, c the coefficients.
    Without c[1] its damper follows from the damping ratio. Values are clipped to the parameters' bounds.
    """
    (frequency_hz, damping_ratio), c = fitted.shape, fitted.coefficients
    w, damper = 2.0 * pi * frequency_hz, c[1] if len(c) > 1 else 2.0 * damping_ratio * c[0]
    values = {
        "stiffness_n_m": c[0] * w * w, "damping_n_s_m": damper * w, "frequency_hz": frequency_hz,
        "damping_ratio": damping_ratio,
    }  # fmt: skip
    return [entry(UnmodelledResonance, values)]


class UnmodelledResonance(ForceEffect):
    """Force of a mass that hangs on the moving part by a spring and a damper.

    `f = stiffness_n_m z + damping_n_s_m z'`, where its lag z behind the motion obeys
    `z'' + 2 d w z' + w^2 z = a`, w = 2 pi frequency_hz, d = damping_ratio, solved exactly for an acceleration
    constant over dt. The hanging mass is stiffness_n_m / w^2, and its own damper is 2 d stiffness_n_m / w;
    `damping_n_s_m` is free, so that together with m, b and k every mode of second order that follows the
    motion can be written so.
    """

    name = "unmodelled_resonance"
    site = "shaft"
    parameters = (
        Parameter("stiffness_n_m", "N/m", 0.0, -1e9, 1e9),
        Parameter("damping_n_s_m", "N s/m", 0.0, -1e6, 1e6),
        Parameter("frequency_hz", "Hz", 20.0, 0.1, 2e3, linear=False),
        Parameter("damping_ratio", "", 0.05, 1e-4, 0.99, linear=False),
    )
    picture = "spectrum"
    bends = True
    reference = "den Hartog, Mechanical Vibrations, chapter 3: the vibration absorber"
    fingerprint = "ringing at one frequency that decays after each change of the motion"
    words = "something flexible that swings: a second mode"
    remedy = "tap the fixture: stiffen the part that rings at this frequency"
    candidates = (
        Mode(shapes=_SHAPES, signs=(1,), spectra=_hanging, grid=_modes, making=_absorber, least_ratio=1.25),
        Mode(
            form="free", shapes=_SHAPES, signs=(0, 0), spectra=_free, grid=_modes, making=_absorber,
            least_ratio=1.25,
        ),
        Alignment(
            form="fixture", shapes=_SHAPES, factor=_weak, grid=_modes, making=_absorber, least_ratio=1.25,
            picture="phase",
        ),
    )  # fmt: skip

    oscillator = Oscillator()

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        """(z in m, z' in m/s)."""
        w, ratio = 2.0 * pi * self.values["frequency_hz"], self.values["damping_ratio"]
        swing, e = w * sqrt(1.0 - ratio * ratio), m.exp(-w * ratio * m.dt)
        ec, es = e * m.cos(swing * m.dt), e * m.sin(swing * m.dt) / swing
        return tuple(m.through(self.oscillator, m.a, ec, es, w * ratio, w * w))
