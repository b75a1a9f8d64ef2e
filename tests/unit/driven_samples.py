"""Bodies that a force drives, by an integrator of their own: no motion is imposed, the position follows."""

from dataclasses import dataclass

import numpy as np

from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording

_FINE_HZ = 8000.0


@dataclass(frozen=True)
class Body:
    """Mass in kg, damping in N s/m, stiffness in N/m, dry friction in N."""

    mass_kg: float
    damping_n_s_m: float
    stiffness_n_m: float
    friction_n: float = 0.0


def moved(body: Body, force_n: Floats, step_s: float) -> Floats:
    """Position after each step under forces held over it: semi-implicit Euler, friction as an impulse that
    at most stops the body (Karnopp, J. Dyn. Sys. Meas. Control 107(1), 1985)."""
    x = v = 0.0
    out = np.empty(len(force_n))
    most = body.friction_n * step_s / body.mass_kg
    keep = 1.0 / (1.0 + step_s * body.damping_n_s_m / body.mass_kg)
    gain, spring = step_s / body.mass_kg, step_s * body.stiffness_n_m / body.mass_kg
    for i, f in enumerate(force_n.tolist()):
        v = (v + gain * f - spring * x) * keep
        v = v - most if v > most else v + most if v < -most else 0.0
        x += step_s * v
        out[i] = x
    return out


def broad_force(rng: np.random.Generator, seconds: float, top_hz: float, rms_n: float) -> Floats:
    """Lines up to `top_hz`, flat, random phases, on the fine grid."""
    count = int(seconds * _FINE_HZ)
    spectrum = np.zeros(count // 2 + 1, dtype=np.complex128)
    lines = int(top_hz * seconds)
    spectrum[1:lines] = np.exp(2j * np.pi * rng.random(lines - 1))
    force = np.fft.irfft(spectrum, count)
    return np.asarray(force * rms_n / np.std(force))


def driven(
    body: Body, force_n: Floats, rate_hz: float, seed: int, noise_n: float = 2e-3, noise_m: float = 1e-6
) -> Recording:
    """What is recorded of it: white noise on force and position, which do not act on the body."""
    rng = np.random.default_rng(seed)
    every = round(_FINE_HZ / rate_hz)
    x = moved(body, force_n, 1.0 / _FINE_HZ)[every - 1 :: every]
    f = force_n[every - 1 :: every]
    t = np.arange(len(x)) * every / _FINE_HZ
    noisy = f + noise_n * rng.standard_normal(len(f))
    return Recording("driven", t, x + noise_m * rng.standard_normal(len(x)), noisy, "test")


def held_in_place(body: Body, disturbance_n: Floats, rate_hz: float) -> Recording:
    """A spring and damper by control follow a slow reference against a disturbance that is not measured."""
    count = len(disturbance_n)
    slow = 2.0 * np.pi * np.arange(count) / _FINE_HZ
    reference = 4e-3 * np.sin(0.31 * slow) + 2e-3 * np.sin(0.83 * slow + 1.0)
    gain, rate = 60.0, 2.0
    whole = Body(body.mass_kg, body.damping_n_s_m + rate, body.stiffness_n_m + gain)
    x = moved(whole, gain * reference + disturbance_n, 1.0 / _FINE_HZ)
    force = gain * (reference - x) - rate * np.gradient(x) * _FINE_HZ
    every = round(_FINE_HZ / rate_hz)
    rng = np.random.default_rng(9)
    seen, f = x[::every], force[::every]
    t = np.arange(len(seen)) * every / _FINE_HZ
    noisy = seen + 1e-6 * rng.standard_normal(len(seen))
    return Recording("held", t, noisy, f + 2e-3 * rng.standard_normal(len(f)), "test")
