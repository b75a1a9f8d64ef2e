"""Short recordings for the tests of what a diagnosis shows, made without the physics that it looks for."""

from pathlib import Path

import numpy as np

from forefeel.common.recording.recording import Recording
from tests.unit.evaluation_samples import Floats, csv_text

RATE_HZ = 100.0
FRICTION_N, DELAY_S = 0.08, 0.05


def motion(seconds: float) -> tuple[Floats, Floats]:
    """Stamps, and strokes of several amplitudes and speeds."""
    t = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    x = 6e-3 * np.sin(2 * np.pi * 0.31 * t) + 2e-3 * np.sin(2 * np.pi * 0.97 * t + 1.0)
    return t, np.asarray(x + 4e-4 * np.sin(2 * np.pi * 3.7 * t + 2.0))


def made(seconds: float = 8.0, friction_n: float = 0.0, bias_n: float = 0.0, name: str = "made") -> Recording:
    """Mass, damper, spring, and what is asked for, with 4 mN of noise."""
    return _recording(*motion(seconds), friction_n, bias_n, name)


def one_sine(frequency_hz: float, amplitude_m: float) -> Recording:
    """As `made`, with friction; the motion is a sine of 10 s at 250 Hz."""
    t = np.arange(2500) / 250.0
    return _recording(t, amplitude_m * np.sin(2 * np.pi * frequency_hz * t), 0.06, 0.0, "sine")


def _recording(t: Floats, x: Floats, friction_n: float, bias_n: float, name: str) -> Recording:
    v = np.gradient(x, t)
    noise = np.random.default_rng(3).normal(0.0, 4e-3, len(t))
    force = 0.02 * np.gradient(v, t) + 0.8 * v + 40.0 * x + friction_n * np.tanh(v / 2e-4) + bias_n
    return Recording(name, t, x, np.asarray(force + noise), source=f"{name}.csv")


def put(path: Path, recording: Recording) -> Path:
    """The recording as a CSV file."""
    path.write_text(csv_text(recording), encoding="utf-8")
    return path
