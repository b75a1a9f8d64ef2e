"""Heart beat or breath: a periodic force that comes without motion of the instrument."""

from math import pi, sin

from common.effects.base import ForceEffect, Parameter


class Pulsation(ForceEffect):
    """`f = A (sin p + r sin 2p)`, p = 2 pi frequency_hz t + phase_rad.

    A = amplitude_n, r = second_harmonic_ratio.
    t counts from the caller's own zero, so a phase found on one recording holds for that recording only.
    """

    name = "pulsation"
    site = "wall"
    parameters = (
        Parameter("amplitude_n", "N", 0.0, 0.0, 1e3),
        Parameter("frequency_hz", "Hz", 1.2, 0.05, 50.0, linear=False),
        Parameter("phase_rad", "rad", 0.0, -2.0 * pi, 2.0 * pi, linear=False),
        Parameter("second_harmonic_ratio", "", 0.0, -1.0, 1.0, linear=False),
    )
    reference = "two-term Fourier series of the arterial pulse, McDonald's Blood Flow in Arteries, 6th ed."

    def _configure(self) -> None:
        self._omega = 2.0 * pi * self.values["frequency_hz"]
        self._phase = self.values["phase_rad"]
        self._ratio = self.values["second_harmonic_ratio"]

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(sin p + r sin 2p,)."""
        p = self._omega * t + self._phase
        return (sin(p) + self._ratio * sin(2.0 * p),)
