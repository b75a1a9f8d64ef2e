"""A periodic force with a fundamental and two harmonics: shared by pulsation and mains hum.

`f = A (sin p + r2 sin(2p + q2) + r3 sin(3p + q3))`, p = 2 pi frequency_hz t + phase_rad.
"""

from collections.abc import Sequence
from math import atan2, cos, hypot, pi, sin

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.offline import Array


def harmonic_parameters(frequency_hz: float, lower_hz: float, upper_hz: float) -> tuple[Parameter, ...]:
    """The parameters of a periodic force whose fundamental lies between these bounds."""
    return (
        Parameter("amplitude_n", "N", 0.0, 0.0, 1e3),
        Parameter("frequency_hz", "Hz", frequency_hz, lower_hz, upper_hz, linear=False),
        Parameter("phase_rad", "rad", 0.0, -2.0 * pi, 2.0 * pi, linear=False),
        *(
            parameter
            for nth in ("second", "third")
            for parameter in (
                Parameter(f"{nth}_harmonic_ratio", "", 0.0, -100.0, 100.0, linear=False),
                Parameter(f"{nth}_harmonic_phase_rad", "rad", 0.0, -2.0 * pi, 2.0 * pi, linear=False),
            )
        ),
    )


class PeriodicForce(ForceEffect):
    """The force of the module's formula; t counts from the caller's own zero."""

    def _configure(self) -> None:
        values = self.values
        self._omega, self._phase = 2.0 * pi * values["frequency_hz"], values["phase_rad"]
        self._ratio2, self._ratio3 = values["second_harmonic_ratio"], values["third_harmonic_ratio"]
        self._phase2, self._phase3 = (
            values["second_harmonic_phase_rad"],
            values["third_harmonic_phase_rad"],
        )

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(sin p + r2 sin(2p + q2) + r3 sin(3p + q3),)."""
        p = self._omega * t + self._phase
        wave = sin(p)
        if self._ratio2:
            wave += self._ratio2 * sin(2.0 * p + self._phase2)
        if self._ratio3:
            wave += self._ratio3 * sin(3.0 * p + self._phase3)
        return (wave,)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        sines = _sines(self._omega * t + self._phase)
        wave = sines[0]
        higher = (self._ratio2, self._phase2), (self._ratio3, self._phase3)
        for (ratio, phase), sine, cosine in zip(higher, sines[2::2], sines[3::2], strict=True):
            if ratio:
                wave = wave + ratio * cos(phase) * sine + ratio * sin(phase) * cosine
        return wave[:, None]

    def span(self, t: Array, x: Array, v: Array, a: Array, dt: Array | None = None) -> Array:
        """Sine and cosine of each harmonic at phase 0, shape (n, 6)."""
        return np.stack(_sines(self._omega * t)).T

    def from_span(self, coefficients: Sequence[float]) -> dict[str, float]:
        """Amplitude, ratios and phases from sines and cosines; the fundamental must not vanish for ratios."""
        sine, cosine, *higher = map(float, coefficients)
        amplitude_n, phase = hypot(sine, cosine), atan2(cosine, sine)
        found = {**self.values, "amplitude_n": amplitude_n, "phase_rad": phase}
        for order, nth in ((2, "second"), (3, "third")):
            sine, cosine, *higher = higher
            ratio = hypot(sine, cosine) / amplitude_n if amplitude_n > 0.0 else 0.0
            turned = atan2(cosine, sine) - order * phase
            found[f"{nth}_harmonic_ratio"] = ratio
            found[f"{nth}_harmonic_phase_rad"] = atan2(sin(turned), cos(turned))
        return found

    @classmethod
    def shape_names(cls) -> tuple[str, ...]:
        """The frequency: phases and ratios are linear in the span."""
        return ("frequency_hz",)


def _sines(p: Array) -> tuple[Array, ...]:
    """sin p, cos p, sin 2p, cos 2p, sin 3p, cos 3p."""
    s, c = np.sin(p), np.cos(p)
    twice, square = 2.0 * s * c, 2.0 * c * c - 1.0
    return s, c, twice, square, s * (2.0 * square + 1.0), c * (2.0 * square - 1.0)
