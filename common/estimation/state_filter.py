"""Causal state-variable filter: a signal and its first two derivatives, all seen through one low-pass.

Third-order Butterworth, w = 2 pi cutoff: `w^3 / (s^3 + 2 w s^2 + 2 w^2 s + w^3)`, unity gain at rest. Third
order, because the second derivative then still falls off at high frequency: the encoder's steps would
otherwise pass into a_f unfiltered.

Discretised by the trapezoidal rule (Tustin) with the dt of each sample. Every step is the solution of a chain
of trapezoidal integrators S, so filtered signals are functions of the same S, also when dt varies, and such
functions commute. Hence `f = m a + b v + k x` gives `f_f = m a_f + b v_f + k x_f` exactly when the force
passes the same filter: the filter does not bias theta. A sampled exact solution (matrix exponential) commutes
for constant dt only.

Reference: Young, Recursive Estimation and Time-Series Analysis (2011); Garnier and Wang, Identification of
Continuous-time Models from Sampled Data (2008), state-variable filters.
"""

from math import pi

GAP_S = 0.1
"""A longer pause between two samples is a gap, after which filters start anew."""


class StateFilter:
    """Low-passed value, first and second derivative of an irregularly sampled signal.

    It starts at rest at its first value. Delay at low frequency: 2 / (2 pi cutoff_hz), 16 ms at 20 Hz.
    """

    def __init__(self, cutoff_hz: float) -> None:
        self._w = 2.0 * pi * cutoff_hz
        self.reset()

    def reset(self) -> None:
        """Clears the state; the next sample starts it anew, at rest."""
        self._started = False
        self._x = self._v = self._a = self._j = 0.0

    def step(self, value: float, dt: float) -> tuple[float, float, float]:
        """Returns (filtered value, its derivative, its second derivative) dt seconds after the last sample.

        The first sample returns (value, 0, 0). `value` must be finite: a NaN would stay in the state. `dt`:
        above 0 s; not used for the first sample.
        """
        if not self._started:
            self._started = True
            self._x = value
            return value, 0.0, 0.0
        # x, v, a by trapezoids from the unknown third derivative j of this instant: x1 = x + h^3 j, and so
        # on; then the filter's equation j = w^3 (value - x1) - 2 w^2 v1 - 2 w a1 is solved for j.
        h = 0.5 * dt
        w = self._w
        a = self._a + h * self._j
        v = self._v + h * (self._a + a)
        x = self._x + h * (self._v + v)
        q = w * h
        j = w * (w * (w * (value - x) - 2.0 * v) - 2.0 * a) / (1.0 + q * (2.0 + q * (2.0 + q)))
        self._j = j
        self._a = a = a + h * j
        self._v = v = v + h * h * j
        self._x = x = x + h * h * h * j
        return x, v, a
