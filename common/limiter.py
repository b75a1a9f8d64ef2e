"""Motion limits: workspace, velocity, acceleration, force; and the ramp to rest. Pure; every intervention is
returned.
"""

from math import copysign, sqrt
from typing import NamedTuple

from forefeel.common.settings import AxisLimits

_EXACT = 1e-9  # a change below a nanometre or nm/s is rounding, no intervention


MOTION_RULES = ("workspace", "velocity", "acceleration", "force", "travel")
"""Rules that change a motion. Every other rule refuses a command, or an engagement."""


class LimitHit(NamedTuple):
    """One intervention: by which rule, what was asked, what was applied."""

    rule: str
    requested: float
    applied: float
    unit: str


def _clip(value: float, bound: float) -> float:
    return max(-bound, min(bound, value))


def _stoppable_m_s(room_m: float, deceleration_m_s2: float, lag_s: float) -> float:
    """The largest speed v that comes to rest within the room: v lag + v^2 / 2a = room.

    `lag_s` dt / 2: in steps of this dt. dt: whatever steps come after this one.
    """
    delayed = deceleration_m_s2 * lag_s
    return sqrt(delayed * delayed + 2.0 * deceleration_m_s2 * max(0.0, room_m)) - delayed


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
    ) -> list[LimitHit]:
        """One step of dt towards a position that moves with a velocity.

        `velocity_share`: the ramp on engaging, 0 to 1. `force_share`: of the force limit, where it acts.
        """
        hits: list[LimitHit] = []
        target_m = self._inside_workspace(position_m, hits)
        if target_m != position_m:
            velocity_m_s = 0.0
        limit_n = force_share * self._force_n
        if abs(force_n) > limit_n:
            target_m, velocity_m_s = self._relieved(target_m, velocity_m_s, force_n, limit_n, hits)
        wanted = (target_m - self.position_m) / dt_s
        feed_forward = _clip(velocity_m_s, self._velocity_m_s)
        # the speed, relative to the target, from which it can still brake before overshooting
        brake = _stoppable_m_s(abs(wanted - feed_forward) * dt_s, self._acceleration_m_s2, 0.5 * dt_s)
        velocity = feed_forward + _clip(wanted - feed_forward, brake)
        capped = self._before_walls(_clip(velocity, self._velocity_m_s * velocity_share), dt_s)
        change = self._acceleration_m_s2 * dt_s
        applied = self.velocity_m_s + _clip(capped - self.velocity_m_s, change)
        if abs(capped - velocity) > _EXACT:
            hits.append(LimitHit("velocity", velocity, capped, "m/s"))
        if abs(applied - capped) > _EXACT:
            asked = (capped - self.velocity_m_s) / dt_s
            hits.append(LimitHit("acceleration", asked, copysign(self._acceleration_m_s2, asked), "m/s2"))
        self._advance(applied, dt_s)
        return hits

    def stop(self, dt_s: float) -> None:
        """One step of dt of the ramp to rest."""
        change = self._stop_m_s2 * dt_s
        velocity = self.velocity_m_s - _clip(self.velocity_m_s, change)
        self._advance(velocity, dt_s)

    def _before_walls(self, velocity_m_s: float, dt_s: float) -> float:
        """Near the ends of the workspace: slow enough that following and stopping both brake before them."""
        room_m = self._high_m - self.position_m if velocity_m_s > 0.0 else self.position_m - self._low_m
        return _clip(velocity_m_s, _stoppable_m_s(room_m, self._wall_m_s2, dt_s))

    def _advance(self, velocity_m_s: float, dt_s: float) -> None:
        moved = self.position_m + velocity_m_s * dt_s
        self.position_m = min(
            max(moved, min(self._low_m, self.position_m)), max(self._high_m, self.position_m)
        )
        self.velocity_m_s = velocity_m_s if moved == self.position_m else 0.0

    def _inside_workspace(self, position_m: float, hits: list[LimitHit]) -> float:
        target_m = min(max(position_m, self._low_m), self._high_m)
        if target_m != position_m:
            hits.append(LimitHit("workspace", position_m, target_m, "m"))
        return target_m

    def _relieved(
        self, target_m: float, velocity_m_s: float, force_n: float, limit_n: float, hits: list[LimitHit]
    ) -> tuple[float, float]:
        """Above the force limit the setpoint may only move so that the contact is relieved."""
        relieved = min(target_m, self.position_m) if force_n > 0 else max(target_m, self.position_m)
        if relieved == target_m and velocity_m_s * force_n <= 0.0:
            return target_m, velocity_m_s
        hits.append(LimitHit("force", force_n, copysign(limit_n, force_n), "N"))
        return relieved, 0.0
