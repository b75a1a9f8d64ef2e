"""The simulated stage: servo, limits, encoder and the drive's own watchdog."""

from math import copysign, exp, pi, sqrt

from forefeel.slave.plant.settings import StageSettings

EXTRAPOLATION_S = 0.002
"""A setpoint is carried on with its velocity for this long: two periods of the control loop."""


class PlantStage:
    """A critically damped servo, stepped at the world's rate.

    `a = w^2 (target - x) + 2 w (feed - v)`, w = 2 pi bandwidth, limited in acceleration, velocity and travel:
    exact from step to step while no limit acts, else v takes what the limits leave of its change, and x moves
    on with it. Near the ends of travel the velocity stays below what the acceleration limit can stop, so that
    the limits of position, velocity and acceleration hold together. Without setpoint (hold), or when the last
    is older than the watchdog, the drive decelerates at its acceleration limit and stays at rest.
    """

    def __init__(self, settings: StageSettings, dt: float) -> None:
        self._dt = dt
        self._w = 2.0 * pi * settings.bandwidth_hz
        self._decay = exp(-self._w * dt)
        self._low_m, self._high_m = settings.travel_lower_m, settings.travel_upper_m
        self._fastest_m_s = settings.velocity_limit_m_s
        self._most_m_s2 = settings.acceleration_limit_m_s2
        self._change_m_s = self._most_m_s2 * dt
        braking_m = self._fastest_m_s * (0.5 * self._fastest_m_s / self._most_m_s2 + 2.0 * dt)
        self._free_low_m, self._free_high_m = self._low_m + braking_m, self._high_m - braking_m
        self._watchdog_s = settings.device_watchdog_s
        self._encoder_step_m = settings.encoder_step_m
        self._setpoint: tuple[float, float, float] | None = None
        self.position_m = settings.start_m
        self.velocity_m_s = 0.0

    def command(self, position_m: float, velocity_m_s: float, t: float) -> float:
        """Sets the setpoint of time t; returns its position within the travel."""
        applied_m = self._within_travel(position_m)
        self._setpoint = (applied_m, max(-self._fastest_m_s, min(self._fastest_m_s, velocity_m_s)), t)
        return applied_m

    def hold(self) -> None:
        """Forgets the setpoint: the drive decelerates and stays."""
        self._setpoint = None

    def readback(self) -> tuple[float, float]:
        """(position in steps of the motor's encoder in m, velocity in m/s by the drive's observer)."""
        return round(self.position_m / self._encoder_step_m) * self._encoder_step_m, self.velocity_m_s

    def step(self, t: float) -> tuple[float, float, float]:
        """Advances the carriage by dt, as the drive demands at time t, within the limits of acceleration,
        velocity and travel; returns its (x, v, a).
        """
        dt, x, before = self._dt, self.position_m, self.velocity_m_s
        exact_m, v = self._demanded(t)
        if self._free_low_m < x < self._free_high_m:
            if abs(v - before) <= self._change_m_s and abs(v) <= self._fastest_m_s:
                x = exact_m
            else:
                v = self._limited(before, v)
                x += v * dt
        else:
            v = self._stoppable(self._limited(before, v))
            x = self._within_travel(x + v * dt)  # rounding only
        self.position_m, self.velocity_m_s = x, v
        return x, v, (v - before) / dt

    def _demanded(self, t: float) -> tuple[float, float]:
        """Position and velocity at which the servo alone would be after this step; the present position and 0
        without a setpoint, or once the last is older than the watchdog.

        With e = x - target and d = v - feed: `e(dt) = (e + c dt) exp(-w dt)`, `c = d + w e`.
        """
        setpoint = self._setpoint
        if setpoint is None:
            return self.position_m, 0.0
        target, feed, stamp = setpoint
        age, dt, w = t - stamp, self._dt, self._w
        if age > self._watchdog_s:
            return self.position_m, 0.0
        if age <= EXTRAPOLATION_S:
            target += feed * age
        else:
            target, feed = target + feed * EXTRAPOLATION_S, 0.0
        e, d = self.position_m - target + feed * dt, self.velocity_m_s - feed
        c = d + w * e
        return target + (e + c * dt) * self._decay, feed + (d - w * c * dt) * self._decay

    def _limited(self, v: float, demanded: float) -> float:
        """Velocity nearest to `demanded` that one step from v can reach within acceleration and velocity
        limits.
        """
        change, fastest = self._change_m_s, self._fastest_m_s
        if demanded > v + change:
            demanded = v + change
        elif demanded < v - change:
            demanded = v - change
        if demanded > fastest:
            return fastest
        return -fastest if demanded < -fastest else demanded

    def _stoppable(self, v: float) -> float:
        """v, or the largest velocity in its direction that braking in steps of dt stops within the travel.
        Braking by A dt per step covers at most v^2 / 2A + v dt / 2 + A dt^2 / 8, the first step included.
        """
        brake = self._change_m_s
        room = self._high_m - self.position_m if v > 0.0 else self.position_m - self._low_m
        room = max(0.0, room - 0.125 * brake * self._dt)
        largest = sqrt(0.25 * brake * brake + 2.0 * self._most_m_s2 * room) - 0.5 * brake
        return v if abs(v) <= largest else copysign(largest, v)

    def _within_travel(self, x: float) -> float:
        return max(self._low_m, min(self._high_m, x))
