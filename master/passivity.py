"""Passivity in the time domain: the rendered force gives the hand no energy that it has not put in. Pure.

The force f resists insertion. An actuator that is d ticks late applies f(k - 1 - d) between the ticks k - 1
and k, while the hand moves by dx(k); where f(k - 1 - d) dx(k) is negative, the hand is given energy. It is
accounted as by Hannaford and Ryu (Time-domain passivity control of haptic interfaces, IEEE Trans. Robotics
and Automation 18(1), 2002, equation (4)), whose actuator is not late. Their controller takes back what was
given; here a force that is not paid for is bounded before it gives, and so are those still on their way.
"""

from collections import deque
from math import ceil, sqrt

_SPRING_N_M = 800.0
_LEAST_J = -0.9e-3
_TICK_S = 1e-3
_DAMPING_SHARE, _DAMPED_M_S = 0.06, 0.005
"""Below the just noticeable difference, 7 % (Pang, Tan, Durlach 1991). At walls of 200, 1000, 3000 N/m the
felt error is .04, .05, .06 of that of the late force, without damping .01, .15, .18: the last force of a way
out is then not covered."""
_NEGLIGIBLE_W = 1e-9
_SMOOTHING = 0.1
"""Per tick: a time constant of 10 ms, beyond a step of the encoder and below a tremor of 12 Hz."""
_MOST_M_S2 = 20.0
"""4 N on 0.15 kg of loose fingers make 27 m/s^2, less their damping."""


def late_ticks(actuator_delay_s: float) -> int:
    """Ticks after which an actuator of that delay has applied a force."""
    return ceil(actuator_delay_s / _TICK_S - 1e-9)


class PassivityObserver:
    """E(n) = sum f(k - 1 - d) dx(k): the energy that the hand has put into the handle since the start.

    E < 0: the rendered force has given the hand more than it ever took. `energy_j`: E.
    """

    def __init__(self, actuator_delay_s: float = 0.0) -> None:
        self.energy_j = 0.0
        ticks = late_ticks(actuator_delay_s) + 1
        self._forces_n = deque([0.0] * ticks, maxlen=ticks)

    def observe(self, moved_m: float, force_n: float) -> float:
        """Adds what a motion of the hand put in and returns E. `force_n`: rendered since the last call."""
        self._forces_n.append(force_n)
        self.energy_j += self._forces_n[0] * moved_m
        return self.energy_j


class PassivityLimit:
    """Bounds the force so that E stays above -1 mJ with an actuator that is late by anything from nothing to
    d + 1 ticks, d of `actuator_delay_s`; also by a lateness that changes meanwhile.

    Credit: C(n) = min(C(n-1) + min over j < N of f(k - 1 - j) dx, F^2 / 2 k) with N = d + 2: of the N newest
    forces the one that takes least or gives most counts, and friction saves up no more than a spring of k =
    800 N/m gives back after F = max_force_n (4 N: 10 mJ). With v the velocity of the hand, T = 1 ms, D = d T,
    K = max_stiffness_n_m (4000 N/m) and S = max_slew_n_s (80 N/s):

    - Backing: |f| <= sqrt(2 K C+) + N K |v| T, as much as a spring of K that has taken C, and what the credit
      lags behind. A force that comes late thus holds the hand like a spring from where it is; bounded by the
      sign of the motion alone it would switch on and off with every tremor.
    - Brake, where the force assists or is about to: |f| u D + f^2 u / S <= C+ with u = -v sgn f + w (D + |f|
      / 2 S) > 0, w the acceleration with the force. Falling by S / 2 from there, after the time D in which
      those on their way are applied, it gives C: credit and force end together. Without w a hand that turns
      fast overtakes it. Both bounds let the force fall by S at most.
    - Guard, which overrides that. While the hand accelerates by no more than a = 20 m/s^2, the force f of i
      ticks ago can give |f| T (j a T - v sgn f)+ in the tick that comes j-th, as long as i <= N - j. With the
      largest of them in each, L = sum over j = 1 .. N is what all forces on their way can give; f is as large
      as leaves 2 L <= C + 0.9 mJ (2: it ends in steps, not in one). A tick later no more than the term j = 1
      is gone from the right side, and with f = 0 at most the others are L anew: so f = 0 is always allowed,
      and E >= C >= -0.9 mJ.

    A force that is late gives energy in each turn of a tremor, up to K v^2 D, and the last force of a way out
    is then not covered. So as long as C is below W, the energy that the asked force has taken since it last
    gave all of it back, a force against the motion grows by 6 % min(1, |v| / 5 mm/s).
    """

    def __init__(
        self,
        max_force_n: float,
        max_slew_n_s: float,
        max_stiffness_n_m: float,
        actuator_delay_s: float = 0.0,
    ) -> None:
        self._most_n = max_force_n
        self._most_j = max_force_n * max_force_n / (2.0 * _SPRING_N_M)
        self._slew_n_s = max_slew_n_s
        self._stiffness_n_m = max_stiffness_n_m
        self._credit_j = self._stored_j = 0.0
        self._pending = late_ticks(actuator_delay_s) + 2
        self._forces_n = deque([0.0] * self._pending, maxlen=self._pending)
        self._velocity_m_s = 0.0

    def observe(self, moved_m: float, force_n: float) -> None:
        """Updates C after the hand moved under `force_n`, rendered since the last call, or an earlier one."""
        self._forces_n.append(force_n)
        least_n = min(self._forces_n) if moved_m >= 0.0 else max(self._forces_n)
        self._credit_j = min(self._credit_j + least_n * moved_m, self._most_j)

    def damped_n(self, wanted_n: float, moved_m: float) -> float:
        """Force in N: `wanted_n`, raised by up to 6 % against the motion while the credit C is below W (see
        the class), at most to the largest force. Updates W and the smoothed velocity, so once per tick.
        """
        self._stored_j = min(max(0.0, self._stored_j + wanted_n * moved_m), self._most_j)
        self._velocity_m_s += _SMOOTHING * (moved_m / _TICK_S - self._velocity_m_s)
        if self._credit_j >= self._stored_j or wanted_n * self._velocity_m_s <= 0.0:
            return wanted_n
        share = _DAMPING_SHARE * min(1.0, abs(self._velocity_m_s) / _DAMPED_M_S)
        return max(-self._most_n, min(self._most_n, (1.0 + share) * wanted_n))

    def limited_n(self, asked_n: float, present_n: float, velocity_m_s: float, dt_s: float) -> float:
        """Force in N for the next tick: `asked_n` bounded in size by what the energy credit covers (backing,
        brake and guard of the class), its sign kept; changes no state. `present_n`: of the last `dt_s`;
        `velocity_m_s`: of the hand.
        """
        credit_j, late_s = max(self._credit_j, 0.0), (self._pending - 2) * _TICK_S
        into = 1.0 if asked_n >= 0.0 else -1.0
        into_m_s, half_n_s = into * velocity_m_s, 0.5 * self._slew_n_s
        backed_n = sqrt(2.0 * self._stiffness_n_m * credit_j)
        backed_n += self._pending * self._stiffness_n_m * max(0.0, into_m_s) * _TICK_S
        speeding_m_s2 = max(0.0, into * (self._velocity_m_s - velocity_m_s)) * _SMOOTHING / _TICK_S
        ending_m_s = speeding_m_s2 * (late_s + 0.5 * abs(present_n) / self._slew_n_s) - into_m_s
        if ending_m_s > 0.0:
            braked_s = sqrt(late_s * late_s + 2.0 * credit_j / (half_n_s * ending_m_s)) - late_s
            backed_n = min(backed_n, half_n_s * braked_s)
        most_n = min(abs(asked_n), max(backed_n, abs(present_n) - self._slew_n_s * dt_s))
        most_n = self._guarded_n(most_n, into_m_s, velocity_m_s)
        return most_n if asked_n >= 0.0 else -most_n

    def _guarded_n(self, most_n: float, into_m_s: float, velocity_m_s: float) -> float:
        """Largest size in N up to `most_n` with 2 L <= C + 0.9 mJ, where L is the energy that all forces on
        their way can give the hand; at least 0. `into_m_s`: velocity against that force.
        """
        forces_n, credit_w = list(self._forces_n), (self._credit_j - _LEAST_J) / _TICK_S
        gains = []  # of each tick j: m that a force gives to, and the energy / T that those on their way give
        for tick in range(1, self._pending + 1):
            faster_m_s, sent_w = tick * _MOST_M_S2 * _TICK_S, 0.0
            for force_n in forces_n[tick:]:
                sent_w = max(sent_w, abs(force_n) * faster_m_s - force_n * velocity_m_s)
            gains.append((max(0.0, faster_m_s - into_m_s), sent_w))
        # L is convex and piecewise linear in the force: Newton's steps from above stay above, and are few
        while most_n > 0.0:
            given_w = slope_m_s = 0.0
            for speed_m_s, sent_w in gains:
                gives = most_n * speed_m_s > sent_w
                given_w += most_n * speed_m_s if gives else sent_w
                slope_m_s += 2.0 * speed_m_s if gives else 0.0
            excess_w = 2.0 * given_w - credit_w
            if excess_w <= _NEGLIGIBLE_W:
                return most_n
            most_n = most_n - excess_w / slope_m_s if slope_m_s else 0.0
        return 0.0
