"""Minimum-jerk reaches and physiological tremor (Flash and Hogan 1985; Riviere et al. 1998: 6-12 Hz)."""

from dataclasses import dataclass
from math import cos, pi, sin
from random import Random


@dataclass(frozen=True, slots=True)
class MinimumJerk:
    """A reach from rest to rest: x = x0 + (x1 - x0)(10 s^3 - 15 s^4 + 6 s^5), s = t / T."""

    start_m: float
    end_m: float
    duration_s: float

    def at(self, t_s: float) -> tuple[float, float]:
        """(position m, velocity m/s) at time t since the start; at rest before and after."""
        s = min(max(t_s / self.duration_s, 0.0), 1.0)
        length_m = self.end_m - self.start_m
        position_m = self.start_m + length_m * s**3 * (10.0 + s * (6.0 * s - 15.0))
        return position_m, length_m / self.duration_s * 30.0 * s * s * (1.0 - s) ** 2


class Tremor:
    """Three sines between 6 and 12 Hz with seeded frequencies and phases; `amplitude_m` is the sum of their
    amplitudes.
    """

    def __init__(self, amplitude_m: float, rng: Random) -> None:
        self._sines = [
            (amplitude_m / 3.0, 2.0 * pi * rng.uniform(6.0, 12.0), rng.uniform(0.0, 2.0 * pi))
            for _ in range(3)
        ]

    def at(self, t_s: float) -> tuple[float, float]:
        """(displacement m, velocity m/s) at time t."""
        position_m = velocity_m_s = 0.0
        for amplitude_m, omega, phase in self._sines:
            position_m += amplitude_m * sin(omega * t_s + phase)
            velocity_m_s += amplitude_m * omega * cos(omega * t_s + phase)
        return position_m, velocity_m_s


class Arm:
    """A hand and forearm at a reference point: M x'' = K (x_ref - x) + B (v_ref - v) - f, which the rendered
    force f really moves.

    Integrated by the semi-implicit Euler method in steps of at most 0.5 ms (the poles lie near 30 rad/s).
    """

    def __init__(self, mass_kg: float, damping_n_s_m: float, stiffness_n_m: float) -> None:
        self._m, self._b, self._k = mass_kg, damping_n_s_m, stiffness_n_m
        self.position_m = 0.0
        self.velocity_m_s = 0.0

    def place(self, position_m: float) -> None:
        """Puts the hand somewhere, at rest."""
        self.position_m, self.velocity_m_s = position_m, 0.0

    def advance(self, reference_m: float, reference_m_s: float, force_n: float, dt_s: float) -> None:
        """Moves on by dt under a reference and a force of the handle that resists insertion."""
        steps = max(1, int(dt_s / 0.5e-3 + 0.999))
        h = dt_s / steps
        for _ in range(steps):
            spring = self._k * (reference_m - self.position_m) + self._b * (reference_m_s - self.velocity_m_s)
            self.velocity_m_s += h * (spring - force_n) / self._m
            self.position_m += h * self.velocity_m_s
