"""A bench that makes the motion it is asked for: mass, damper, spring, dry friction, 4 mN of noise."""

import numpy as np

from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.excitation import Limits

LIMITS = Limits(0.0, 0.02, 0.05, 1.0)


def stroke() -> Floats:
    """Path in m at 1 kHz of a poor question: 4 s in one direction at one speed."""
    return np.linspace(1e-3, 17e-3, 4000)


def recorded(
    path: Floats, friction_n: float = 0.08, stiffness_n_m: float = 40.0, bias_n: float = 0.0, seed: int = 1
) -> Recording:
    """Recording at 100 Hz of a path in m at 1 kHz."""
    t = np.arange(len(path)) / 1e3
    v = np.gradient(path, t)
    force = 0.02 * np.gradient(v, t) + 0.8 * v + stiffness_n_m * path + bias_n
    force += friction_n * np.tanh(v / 2e-4)
    noise = np.random.default_rng(seed).normal(0.0, 4e-3, len(t[::10]))
    return Recording("asked", t[::10], path[::10], force[::10] + noise, "asked.csv")
