"""Time-domain passivity: what the rendered force does to the hand must not give it energy. Pure.

References: Hannaford and Ryu, Time-domain passivity control of haptic interfaces, IEEE Trans. Robotics and
Automation 18(1), 2002, equations (4) (observer) and (10) (series controller).
"""


class PassivityObserver:
    """E(n) = sum f(k-1) (x(k) - x(k-1)): the energy that the hand has put into the handle since the start.

    The force f resists insertion, so pushing against it counts as positive. E < 0: the rendered force has
    given the hand more than it ever took.

    Attributes:
        energy_j: E. lowest_j: the lowest E so far, at most 0.
    """

    def __init__(self) -> None:
        self.energy_j = 0.0
        self.lowest_j = 0.0
        self._position_m: float | None = None

    def observe(self, position_m: float, force_n: float) -> float:
        """E after the hand has moved to `position_m` under `force_n`, rendered since the last call."""
        if self._position_m is not None:
            self.energy_j += force_n * (position_m - self._position_m)
            self.lowest_j = min(self.lowest_j, self.energy_j)
        self._position_m = position_m
        return self.energy_j


class PassivityController:
    """Damping alpha = -E / (v^2 dt) that takes back within a step what the observer has seen given.

    Bounded by `max_damping_n_s_m`, for near rest alpha grows without limit; what is not taken back in one
    step is taken back in the next ones.
    """

    def __init__(self, max_damping_n_s_m: float) -> None:
        self._max_damping_n_s_m = max_damping_n_s_m

    def force_n(self, energy_j: float, velocity_m_s: float, dt_s: float) -> float:
        """The force in N to add to the rendered one; it resists the motion."""
        power = velocity_m_s * velocity_m_s * dt_s
        if energy_j >= 0.0 or power <= 0.0:
            return 0.0
        return min(-energy_j / power, self._max_damping_n_s_m) * velocity_m_s
