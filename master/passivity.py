"""Passivity in the time domain: the rendered force gives the hand no energy that it has not put in. Pure.

The force f resists insertion. Between the ticks k - 1 and k the hand puts f(k - 1) (x(k) - x(k - 1)) into the
handle; where that is negative, it is given energy. Accounted as by Hannaford and Ryu (Time-domain passivity
control of haptic interfaces, IEEE Trans. Robotics and Automation 18(1), 2002, equation (4)). Their controller
takes back what was given; here a force that is not paid for is bounded before it gives.
"""

from math import sqrt

_SPRING_N_M = 800.0
_LEAST_J = -0.9e-3
_TICK_S = 1e-3
_DAMPING_SHARE, _DAMPED_M_S = 0.06, 0.005
"""Below the just noticeable difference, 7 % (Pang, Tan, Durlach 1991). At walls of 200, 1000, 3000 N/m the
felt error is .04, .05, .06 of that of the late force, without damping .01, .15, .18: the last force of a way
out is then not covered."""
_SMOOTHING = 0.1
"""Per tick: a time constant of 10 ms, beyond a step of the encoder and below a tremor of 12 Hz."""
_LEAST_SPEED_M_S = 0.04
"""What 20 m/s2 make in two ticks: 4 N on 0.15 kg of loose fingers, less their damping."""


class PassivityObserver:
    """E(n) = sum f(k-1) (x(k) - x(k-1)): the energy that the hand has put into the handle since the start.

    E < 0: the rendered force has given the hand more than it ever took.

    Attributes:
        energy_j: E.
    """

    def __init__(self) -> None:
        self.energy_j = 0.0

    def observe(self, moved_m: float, force_n: float) -> float:
        """E after the hand has moved under `force_n`, applied since the last call."""
        self.energy_j += force_n * moved_m
        return self.energy_j


class PassivityLimit:
    """Bounds the force so that E stays above -1 mJ, also with an actuator that is up to a tick late.

    Credit: C(n) = min(C(n-1) + min(f(k) dx, f(k-1) dx), F^2 / 2 k): of the two newest forces the one that
    takes less or gives more counts, and friction saves up no more than a spring of k = 800 N/m gives back
    after F = max_force_n (4 N: 10 mJ). With v the velocity of the hand, T = 1 ms, K = max_stiffness_n_m
    (4000 N/m) and S = max_slew_n_s (80 N/s):

    - Backing: |f| <= sqrt(2 K C+) + 2 K |v| T, as much as a spring of K that has taken C, and what the credit
      lags behind. A force that comes late thus holds the hand like a spring from where it is; bounded by the
      sign of the motion alone it would switch on and off with every tremor.
    - Brake, where the force assists (f v < 0): |f| <= sqrt(2 C+ min(K, S / 2 |v|)). Falling by S / 2 from
      there it gives f^2 |v| / S = C: credit and force end together. Both bounds let it fall by S at most.
    - Guard, which overrides that: |f| <= (C + 0.9 mJ)+ / (8 T max(|v|, 40 mm/s)). While the hand accelerates
      by no more than 20 m/s2, that speed grows by half at most in a tick and doubles at most in two. So the
      newest force gives at most 3/16 of C + 0.9 mJ, the one before it 1/4 of what it was a tick ago: at least
      half of it is left after each tick, and E >= C >= -0.9 mJ.

    A force that is a tick late gives energy in each turn of a tremor, up to K v^2 T, and the last force of a
    way out is then not covered. So as long as C is below W, the energy that the asked force has taken since
    it last gave all of it back, a force against the motion grows by 6 % min(1, |v| / 5 mm/s).

    In virtual time against walls of 200 to 3000 N/m across 300 and 600 ms, two seeds, the lowest E is
    -0.3 mJ, with an actuator 1, 3, 5 ms late -0.6, -2.1, -3.3 mJ (`python -m benchmarks.felt_force`).
    """

    def __init__(self, max_force_n: float, max_slew_n_s: float, max_stiffness_n_m: float) -> None:
        self._most_n = max_force_n
        self._most_j = max_force_n * max_force_n / (2.0 * _SPRING_N_M)
        self._slew_n_s = max_slew_n_s
        self._stiffness_n_m = max_stiffness_n_m
        self._credit_j = self._stored_j = 0.0
        self._before_n = 0.0
        self._velocity_m_s = 0.0

    def observe(self, moved_m: float, force_n: float) -> None:
        """The hand has moved under `force_n`, applied since the last call."""
        taken_j = min(force_n * moved_m, self._before_n * moved_m)
        self._credit_j = min(self._credit_j + taken_j, self._most_j)
        self._before_n = force_n

    def damped_n(self, wanted_n: float, moved_m: float) -> float:
        """The force that also pays for what its delay by a tick gives back."""
        self._stored_j = min(max(0.0, self._stored_j + wanted_n * moved_m), self._most_j)
        self._velocity_m_s += _SMOOTHING * (moved_m / _TICK_S - self._velocity_m_s)
        if self._credit_j >= self._stored_j or wanted_n * self._velocity_m_s <= 0.0:
            return wanted_n
        share = _DAMPING_SHARE * min(1.0, abs(self._velocity_m_s) / _DAMPED_M_S)
        return max(-self._most_n, min(self._most_n, (1.0 + share) * wanted_n))

    def limited_n(self, asked_n: float, present_n: float, velocity_m_s: float, dt_s: float) -> float:
        """The force in N for the next tick, with the sign of `asked_n` and no larger.

        `present_n`: the one since the last tick, dt_s ago.
        """
        speed_m_s, stiffness_n_m, ahead_n = abs(velocity_m_s), self._stiffness_n_m, 0.0
        if asked_n * velocity_m_s < 0.0:
            stiffness_n_m = min(stiffness_n_m, 0.5 * self._slew_n_s / speed_m_s)
        else:
            ahead_n = 2.0 * stiffness_n_m * speed_m_s * _TICK_S
        backed_n = sqrt(2.0 * stiffness_n_m * max(self._credit_j, 0.0)) + ahead_n
        most_n = min(abs(asked_n), max(backed_n, abs(present_n) - self._slew_n_s * dt_s))
        guard_m = 8.0 * _TICK_S * max(speed_m_s, _LEAST_SPEED_M_S)
        most_n = min(most_n, max(self._credit_j - _LEAST_J, 0.0) / guard_m)
        return most_n if asked_n >= 0.0 else -most_n
