"""The paper's simulated contact: equation (1) with its numbers, on sums of sines with exact derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MASS_KG, DAMPING_N_S_M, STIFFNESS_N_M = 0.01, 0.1, 1.0
"""The paper's simulation, section on figures 4 and 5."""

THETA: Array = np.array([MASS_KG, DAMPING_N_S_M, STIFFNESS_N_M])
OMEGA_RAD_S = 1.0  # rad/s, of x = sin t
AMPLITUDE_M = 1.0
"""x = sin t: the paper gives no unit; taken as m and s."""

Sine = tuple[float, float]
"""(amplitude in m, angular frequency in rad/s)"""

PAPER_MOTION: tuple[Sine, ...] = ((AMPLITUDE_M, OMEGA_RAD_S),)


@dataclass(frozen=True, slots=True)
class SampledMotion:
    """A motion at n stamps: s, m, m/s, m/s^2; shape (n,)."""

    time_s: Array
    position_m: Array
    velocity_m_s: Array
    acceleration_m_s2: Array

    def rows(self) -> Array:
        """phi = [x'', x', x] of equation (1) at each stamp, shape (n, 3)."""
        return np.column_stack([self.acceleration_m_s2, self.velocity_m_s, self.position_m])


def sines(rate_hz: float, duration_s: float, parts: Sequence[Sine] = PAPER_MOTION) -> SampledMotion:
    """x = sum of A sin(w t), sampled from t = 0."""
    time_s = np.arange(round(duration_s * rate_hz)) / rate_hz
    x, v, a = (np.zeros_like(time_s) for _ in range(3))
    for amplitude_m, w in parts:
        x += amplitude_m * np.sin(w * time_s)
        v += amplitude_m * w * np.cos(w * time_s)
        a -= amplitude_m * w * w * np.sin(w * time_s)
    return SampledMotion(time_s, x, v, a)


def noise_n(size: int, deviation_n: float, seed: int) -> Array:
    """White Gaussian noise of the force, shape (size,)."""
    return deviation_n * np.random.default_rng(seed).normal(size=size)


def force_amplitude_n(theta: Sequence[float] | Array, omega_rad_s: float) -> float:
    """Amplitude of m x'' + b x' + k x for x = sin(w t): |k - m w^2 + j b w|."""
    m, b, k = theta[0], theta[1], theta[2]
    return float(abs(complex(k - m * omega_rad_s**2, b * omega_rad_s)))


def rms(values: Array) -> float | None:
    """Root mean square; None for no value, or where it is not finite."""
    if not len(values):
        return None
    largest = float(np.max(np.abs(values)))
    if not np.isfinite(largest):
        return None
    if largest == 0.0:
        return 0.0
    return largest * float(np.sqrt(np.mean((values / largest) ** 2)))  # a diverged one does not overflow
