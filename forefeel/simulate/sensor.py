"""The conversion of the load cell and the encoder: what a recording has that physics has not."""

from dataclasses import dataclass
from math import pi

import numpy as np

from forefeel.common.causes.numerics import lagged
from forefeel.common.recording.recording import Array

_COUNTS = 2**15 - 1
"""Of a load cell of 16 bits, in each direction."""


@dataclass(frozen=True, slots=True)
class SensorOptions:
    """How force and position are read.

    Attributes:
        noise_n: standard deviation of the force. noise_corner_hz: corner of its AR(1) spectrum; None: white.
        full_scale_n: range of the load cell; None: endless and without steps.
        encoder_step_m: 0: none.
    """

    noise_n: float = 0.002
    noise_corner_hz: float | None = None
    full_scale_n: float | None = None
    encoder_step_m: float = 1e-6


def noise(options: SensorOptions, time_s: Array, random: np.random.Generator) -> Array:
    """Gaussian noise in N at the stamps, shape (n,); with a corner an AR(1) process, stationary throughout.

    AR(1) at any stamps: a first-order lag of independent numbers, of the variance that each interval needs.
    """
    white = random.normal(0.0, options.noise_n, len(time_s))
    if options.noise_corner_hz is None:
        return white
    time_constant_s = 1.0 / (2.0 * pi * options.noise_corner_hz)
    dt = np.diff(time_s)
    decay = np.exp(-dt / time_constant_s)
    fresh = white[1:] * np.sqrt((1.0 + decay) / (1.0 - decay))
    return np.append(white[:1], lagged(fresh, dt, time_constant_s, float(white[0])))


def counted(options: SensorOptions, force_n: Array) -> Array:
    """The force in whole counts of the load cell, flat beyond its range."""
    if options.full_scale_n is None:
        return force_n
    step_n = options.full_scale_n / _COUNTS
    return np.clip(np.rint(force_n / step_n), -_COUNTS, _COUNTS) * step_n


def encoded(options: SensorOptions, position_m: Array) -> Array:
    """The position in whole steps of the encoder."""
    if options.encoder_step_m == 0.0:
        return position_m
    return np.rint(position_m / options.encoder_step_m) * options.encoder_step_m
