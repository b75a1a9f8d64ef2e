"""Motion limits: workspace, velocity, acceleration, force; and the ramp to rest. Pure; every intervention is
returned.

The force limit holds because the setpoint slows down towards it. With k the stiffness of the stiffest wall
(`stiffest_wall_n_m`) and F the force against the motion, (F_lim - F) / k is left of the way.
The setpoint goes no faster than it can brake on that way: v T + v^2 / 2a = (F_lim - F) / k, where the force
answers the setpoint T later. So at F_lim only the way out is open.
"""

from math import copysign, sqrt
from typing import NamedTuple

from forefeel.common.settings import AxisLimits

_EXACT = 1e-9  # a change below a nanometre or nm/s is rounding, no intervention
_REACTION_S = 0.008
"""T. At walls as stiff as the bound the limit is then exceeded by 0.4 % (`python -m benchmarks.force_limit`),
with 5 ms by 1 %, and by 8 % where the stage has 15 Hz in place of 25."""
_PROBING_M_S = 0.005
_PROBING_SHARE = 0.5
"""While the measured force is below this share of the limit, a prediction does not slow the setpoint below
5 mm/s: one that is wrong could not learn otherwise."""

MOTION_RULES = ("workspace", "velocity", "acceleration", "contact_speed", "force", "travel")
"""Rules that change a motion. Every other rule refuses a command, or an engagement."""


class LimitHit(NamedTuple):
    """One intervention: by which rule, what was asked, what was applied."""

    rule: str
    requested: float
    applied: float
    unit: str


def _clip(value: float, bound: float) -> float:
    if value < bound:
        return value if value > -bound else -bound
    return bound


def _stoppable_m_s(room_m: float, deceleration_m_s2: float, lag_s: float) -> float:
    """The largest speed v that comes to rest within the room: v lag + v^2 / 2a = room.

    `lag_s` dt / 2: in steps of this dt. dt: whatever steps come after this one.
    """
    delayed = deceleration_m_s2 * lag_s
    return sqrt(delayed * delayed + 2.0 * deceleration_m_s2 * room_m) - delayed if room_m > 0.0 else 0.0


class MotionLimiter:
    """Moves a setpoint towards what is asked, inside the limits; lands exactly on what is inside them.

    Attributes:
        position_m, velocity_m_s: the setpoint now.
    """

    def __init__(self, limits: AxisLimits, stop_deceleration_m_s2: float) -> None:
        self._low_m, self._high_m = limits.workspace_m
        self._velocity_m_s = limits.max_velocity_m_s
        self._acceleration_m_s2 = limits.max_acceleration_m_s2
        self._force_n = limits.max_force_n
        self._wall_n_m = limits.wall_n_m
        self._stop_m_s2 = stop_deceleration_m_s2
        self._wall_m_s2 = min(limits.max_acceleration_m_s2, stop_deceleration_m_s2)
        self.position_m = 0.0
        self.velocity_m_s = 0.0

    def place(self, position_m: float) -> None:
        """Puts the setpoint on the stage at rest, without a motion."""
        self.position_m, self.velocity_m_s = position_m, 0.0

    def follow(
        self,
        position_m: float,
        velocity_m_s: float,
        force_n: float,
        dt_s: float,
        velocity_share: float = 1.0,
        force_share: float = 1.0,
        band_n: tuple[float, float] | None = None,
    ) -> list[LimitHit]:
        """One step of dt towards a position that moves with a velocity.

        `velocity_share`: the ramp on engaging, 0 to 1. `force_share`: of the force limit, where it acts.
        `band_n`: where the force is expected for this position; it only ever slows the setpoint.
        """
        hits: list[LimitHit] = []
        target_m = min(max(position_m, self._low_m), self._high_m)
        if target_m != position_m:
            hits.append(LimitHit("workspace", position_m, target_m, "m"))
            velocity_m_s = 0.0
        wanted = (target_m - self.position_m) / dt_s
        feed_forward = _clip(velocity_m_s, self._velocity_m_s)
        # the speed, relative to the target, from which it can still brake before overshooting
        brake = _stoppable_m_s(abs(wanted - feed_forward) * dt_s, self._acceleration_m_s2, 0.5 * dt_s)
        velocity = feed_forward + _clip(wanted - feed_forward, brake)
        allowed = self._before_walls(_clip(velocity, self._velocity_m_s * velocity_share), dt_s)
        capped = self._towards_contact(allowed, force_n, force_share * self._force_n, band_n, hits)
        if capped == allowed and abs(capped - velocity) > _EXACT:
            hits.append(LimitHit("velocity", velocity, capped, "m/s"))
        change = self._acceleration_m_s2 * dt_s
        applied = self.velocity_m_s + _clip(capped - self.velocity_m_s, change)
        if abs(applied - capped) > _EXACT:
            asked = (capped - self.velocity_m_s) / dt_s
            hits.append(LimitHit("acceleration", asked, copysign(self._acceleration_m_s2, asked), "m/s2"))
        self._advance(applied, dt_s)
        return hits

    def stop(self, dt_s: float, force_n: float = 0.0, force_share: float = 1.0) -> None:
        """One step of dt of the ramp to rest; steeper where the force limit demands it."""
        velocity = self.velocity_m_s - _clip(self.velocity_m_s, self._stop_m_s2 * dt_s)
        capped = self._towards_contact(velocity, force_n, force_share * self._force_n, None, [])
        change = max(self._stop_m_s2, self._acceleration_m_s2) * dt_s
        self._advance(self.velocity_m_s + _clip(capped - self.velocity_m_s, change), dt_s)

    def _before_walls(self, velocity_m_s: float, dt_s: float) -> float:
        """Near the ends of the workspace: slow enough that following and stopping both brake before them."""
        room_m = self._high_m - self.position_m if velocity_m_s > 0.0 else self.position_m - self._low_m
        return _clip(velocity_m_s, _stoppable_m_s(room_m, self._wall_m_s2, dt_s))

    def _advance(self, velocity_m_s: float, dt_s: float) -> None:
        before_m = self.position_m
        moved_m = before_m + velocity_m_s * dt_s
        if self._low_m <= moved_m <= self._high_m:
            self.position_m, self.velocity_m_s = moved_m, velocity_m_s
            return
        self.position_m = min(max(moved_m, min(self._low_m, before_m)), max(self._high_m, before_m))
        self.velocity_m_s = velocity_m_s if moved_m == self.position_m else 0.0

    def _towards_contact(
        self,
        velocity_m_s: float,
        force_n: float,
        limit_n: float,
        band_n: tuple[float, float] | None,
        hits: list[LimitHit],
    ) -> float:
        """The velocity that what is left of the force limit in its direction allows."""
        if velocity_m_s == 0.0:
            return velocity_m_s
        sign = copysign(1.0, velocity_m_s)
        against_n = sign * force_n
        fastest_m_s = self._allowed_m_s(limit_n - against_n)
        expected_n = against_n if band_n is None else max(sign * band_n[0], sign * band_n[1])
        if expected_n > against_n:
            expected_m_s = self._allowed_m_s(limit_n - expected_n)
            if abs(force_n) < _PROBING_SHARE * limit_n:
                expected_m_s = max(expected_m_s, _PROBING_M_S)
            fastest_m_s = min(fastest_m_s, expected_m_s)
        if abs(velocity_m_s) <= fastest_m_s + _EXACT:
            return velocity_m_s
        if against_n > limit_n:
            hits.append(LimitHit("force", force_n, sign * limit_n, "N"))
        else:
            hits.append(LimitHit("contact_speed", velocity_m_s, sign * fastest_m_s, "m/s"))
        return sign * fastest_m_s

    def _allowed_m_s(self, left_n: float) -> float:
        return _stoppable_m_s(left_n / self._wall_n_m, self._acceleration_m_s2, _REACTION_S)
