"""A force that fades while the instrument is held still."""

from forefeel.common.effects.base import ForceEffect, Parameter
from forefeel.common.effects.first_order import FirstOrderLag, lagged
from forefeel.common.effects.offline import Array


class StressRelaxation(ForceEffect):
    """One Maxwell branch `df/dt = k v - f / tau`, k = stiffness_n_m, tau = time_constant_s.

    Its elongation q = f / k obeys `tau dq/dt = tau v - q`, solved exactly for a velocity constant over dt.
    A model may hold several branches.
    """

    name = "stress_relaxation"
    site = "wall"
    parameters = (
        Parameter("stiffness_n_m", "N/m", 1.0, 0.0, 1e9),
        Parameter("time_constant_s", "s", 1.0, 1e-4, 1e4, linear=False),
    )
    reference = "Fung, Biomechanics: Mechanical Properties of Living Tissues, 2nd ed., chapter 2"
    fingerprint = (
        "an exponential fading during each hold, of opposite sign after a withdrawal; "
        "the loop is widest at one speed"
    )

    def _configure(self) -> None:
        self._tau = self.values["time_constant_s"]

    def reset(self) -> None:
        """The branch is relaxed."""
        self._elongation = FirstOrderLag(self._tau)

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(elongation of the branch's spring in m,)."""
        return (self._elongation.advance(self._tau * v, dt),)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        return lagged(self._tau * v, dt, self._tau)[:, None]
