"""Motion limits: workspace, velocity, acceleration, force; and the ramp to rest. Pure; every intervention is
returned.

The force limit holds because the setpoint slows down towards it. With k the stiffness of the stiffest wall
(`stiffest_wall_n_m`) and F the force against the motion, (F_lim - F) / k is left of the way.
The setpoint goes no faster than it can brake on that way: v T + v^2 / 2a = (F_lim - F) / k, where the force
answers the setpoint T later (`Reaction`). So at F_lim only the way out is open. F is old: what the setpoint
has moved since in any direction, U, may have met the stiffest wall, and v (run_on + dt) + v^2 / 2a is at most
(F_lim - F) / k - U as well. So a late force makes the way to the limit slow, and does not let it overshoot.
"""

from collections import deque
from math import copysign, exp, sqrt
from typing import NamedTuple

from forefeel.common.settings import AxisLimits

_EXACT = 1e-9  # a change below a nanometre or nm/s is rounding, no intervention
_PROBING_M_S = 0.005
_PROBING_SHARE = 0.5
"""While the measured force is below this share of the limit, a prediction does not slow the setpoint below
5 mm/s: one that is wrong could not learn otherwise."""

OVER_SHARE = 0.05
"""Share of the force limit: a zero may be off by it, and a force counts as above the limit beyond it."""
_YIELD_M = 0.005
"""More than a wall moves with heart and breath, less than pulls a wire out of a branch; decisions/0030."""
LATEST_S = 1.0
"""Beyond it a force counts as none: half of it leaves 3 N at 3 N/mm only LEAST_M_S."""

MOTION_RULES = ("workspace", "velocity", "acceleration", "contact_speed", "force", "travel")
"""Rules that change a motion. Every other rule refuses a command, or an engagement."""


class Reaction(NamedTuple):
    """T, by its parts in s: from a setpoint to the reading that shows what it did.

    `reading_s`: age of the newest reading when the next one is due, and a tick. `filter_s`: what no stamp
    shows, as a first-order lag. `stage_s`: of the stage behind the setpoint. `run_on_s`: way that the stage
    still goes once the setpoint rests, over the speed.
    """

    reading_s: float
    filter_s: float
    stage_s: float
    run_on_s: float


PROMPT = Reaction(0.002, 0.001, 0.003, 0.002)
"""Reaction of the simulated stage of 25 Hz with a cell of 200 Hz at 1 kHz: 8 ms."""


LEAST_M_S = 0.002
"""An axis whose force limit leaves less does not arm: 100 mm would take a minute."""


def open_speed_m_s(limits: AxisLimits, reaction: Reaction) -> float:
    """The largest speed that the force limit leaves while nothing is touched."""
    room_m = limits.max_force_n / limits.wall_n_m
    return _stoppable_m_s(room_m, limits.max_acceleration_m_s2, sum(reaction))


def claim(limits: AxisLimits, reaction: Reaction) -> str:
    """Line on the speed up to which the force limit holds, stiffest wall, delays of cell and stage."""
    reading_s, filter_s, stage_s, run_on_s = reaction
    return (
        f"limit {limits.max_force_n:g} N holds up to {1e3 * open_speed_m_s(limits, reaction):.3g} mm/s "
        f"against walls up to {limits.wall_n_m:g} N/m: cell {1e3 * (reading_s + filter_s):.2g} ms, "
        f"stage {1e3 * (stage_s + run_on_s):.2g} ms"
    )


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
    """Largest speed v from which a setpoint comes to rest within `room_m`: v lag + v^2 / 2a = room; 0 without
    room. `lag_s` is dt where the next steps may differ from this one, dt / 2 where all are of this dt.
    """
    delayed = deceleration_m_s2 * lag_s
    return sqrt(delayed * delayed + 2.0 * deceleration_m_s2 * room_m) - delayed if room_m > 0.0 else 0.0


class MotionLimiter:
    """Moves a setpoint towards what is asked, inside the limits; lands exactly on what is inside them.

    Attributes:
        reaction: how late the force answers; whoever measures it sets it.
        age_s: of the next force; None: as old as the reaction says.
        position_m, velocity_m_s: the setpoint now.
        force_limited: the force limit slowed its last step.
    """

    def __init__(self, limits: AxisLimits, stop_deceleration_m_s2: float) -> None:
        self._low_m, self._high_m = limits.workspace_m
        self._velocity_m_s = limits.max_velocity_m_s
        self._acceleration_m_s2 = limits.max_acceleration_m_s2
        self._force_n = limits.max_force_n
        self._wall_n_m = limits.wall_n_m
        self._stop_m_s2 = stop_deceleration_m_s2
        self._wall_m_s2 = min(limits.max_acceleration_m_s2, stop_deceleration_m_s2)
        self.reaction = PROMPT
        self.age_s: float | None = None
        self._time_s = self._path_m = self._filtered_m = 0.0
        self._shown = deque([(0.0, 0.0)])  # time, and the path that had passed the filter by then
        self._deepest_m = 0.0
        self.position_m = 0.0
        self.velocity_m_s = 0.0
        self.force_limited = False

    def place(self, position_m: float) -> None:
        """Puts the setpoint on the stage at rest, without a motion."""
        self.position_m, self.velocity_m_s, self.force_limited = position_m, 0.0, False
        self._deepest_m = position_m

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
        """Moves the setpoint by one step of dt towards `position_m`, which itself moves with `velocity_m_s`;
        returns the limits that intervened (empty: none) and sets `force_limited`. `velocity_share`: the ramp
        on engaging, 0 to 1. `force_share`: of the force limit; unless 1, no yielding to a force. `band_n`:
        range of the force expected for this position; it only ever slows the setpoint.
        """
        hits: list[LimitHit] = []
        self._pass_time(dt_s)
        target_m = min(max(position_m, self._low_m), self._high_m)
        if target_m != position_m:
            hits.append(LimitHit("workspace", position_m, target_m, "m"))
            velocity_m_s = 0.0
        wanted = (target_m - self.position_m) / dt_s
        feed_forward = _clip(velocity_m_s, self._velocity_m_s)
        # The speed, relative to the target, from which it can still brake before overshooting. Behind a hand
        # that trembles at the limit of acceleration a setpoint that brakes with all of it swings for ever.
        brakes_m_s2, behind_m = 0.5 * self._acceleration_m_s2, abs(wanted - feed_forward) * dt_s
        brake = _stoppable_m_s(behind_m, brakes_m_s2, 0.5 * dt_s)
        velocity = feed_forward + _clip(wanted - feed_forward, brake)
        allowed = self._within_workspace(_clip(velocity, self._velocity_m_s * velocity_share), dt_s)
        capped = self._towards_contact(allowed, force_n, force_share * self._force_n, band_n, hits)
        if force_share == 1.0:  # a blind cell guides no motion
            capped = self._yielding(capped, force_n, self._velocity_m_s * velocity_share, hits)
        if capped == allowed and abs(capped - velocity) > _EXACT:
            hits.append(LimitHit("velocity", velocity, capped, "m/s"))
        change = self._acceleration_m_s2 * dt_s
        applied = self.velocity_m_s + _clip(capped - self.velocity_m_s, change)
        if abs(applied - capped) > _EXACT:
            asked = (capped - self.velocity_m_s) / dt_s
            hits.append(LimitHit("acceleration", asked, copysign(self._acceleration_m_s2, asked), "m/s²"))
        self._move(applied, dt_s)
        return hits

    def stop(self, dt_s: float, force_n: float = 0.0, force_share: float = 1.0) -> None:
        """Moves by one step of dt of the ramp to rest; steeper where the force limit demands it."""
        self._pass_time(dt_s)
        velocity = self.velocity_m_s - _clip(self.velocity_m_s, self._stop_m_s2 * dt_s)
        capped = self._towards_contact(velocity, force_n, force_share * self._force_n, None, [])
        change = max(self._stop_m_s2, self._acceleration_m_s2) * dt_s
        self._move(self.velocity_m_s + _clip(capped - self.velocity_m_s, change), dt_s)

    def _within_workspace(self, velocity_m_s: float, dt_s: float) -> float:
        """Clips the velocity so that following and stopping can both brake before the workspace ends."""
        room_m = self._high_m - self.position_m if velocity_m_s > 0.0 else self.position_m - self._low_m
        return _clip(velocity_m_s, _stoppable_m_s(room_m, self._wall_m_s2, dt_s))

    def _pass_time(self, dt_s: float) -> None:
        """Advances the time by dt; leaves in `_shown[0]` the total way in m of the setpoint up to the instant
        that the newest force shows, by `age_s` and the delays of `reaction`.
        """
        reaction, self._dt_s = self.reaction, dt_s
        self._delay_s = sum(reaction)
        self._time_s += dt_s
        passed = 1.0 - exp(-dt_s / reaction.filter_s) if reaction.filter_s > 0.0 else 1.0
        self._filtered_m += passed * (self._path_m - self._filtered_m)
        self._shown.append((self._time_s, self._filtered_m))
        age_s = reaction.reading_s - dt_s if self.age_s is None else self.age_s
        since_s = self._time_s - reaction.stage_s - age_s + _EXACT
        while len(self._shown) > 1 and self._shown[1][0] <= since_s:
            self._shown.popleft()
        while len(self._shown) > 1 and self._shown[1][0] < self._time_s - LATEST_S:
            del self._shown[1]  # not the first: while no force comes the way since the last stays unseen

    def _move(self, velocity_m_s: float, dt_s: float) -> None:
        """Moves the setpoint for dt at `velocity_m_s`, up to the ends of the workspace, where its velocity is
        0; from beyond them it moves only back. Adds the whole way to the path, also what an end cut off.
        """
        before_m = self.position_m
        self._path_m += abs(velocity_m_s) * dt_s
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
        """Velocity, slowed to 0 at most, that the rest of the force limit allows in its direction; unchanged
        where that is enough. Sets `force_limited`, and adds to `hits` where it slows. `band_n`: expected
        force, low and high; while the measured one is below half the limit, it does not slow below 5 mm/s.
        """
        self.force_limited = False
        if velocity_m_s == 0.0:
            return velocity_m_s
        sign = copysign(1.0, velocity_m_s)
        against_n = sign * force_n
        room_m = (limit_n - against_n) / self._wall_n_m
        unseen_m, at_once_s = self._path_m - self._shown[0][1], self.reaction.run_on_s + self._dt_s
        fastest_m_s = min(
            _stoppable_m_s(room_m, self._acceleration_m_s2, self._delay_s),
            _stoppable_m_s(room_m - unseen_m, self._acceleration_m_s2, at_once_s),
        )
        expected_n = against_n if band_n is None else max(sign * band_n[0], sign * band_n[1])
        if expected_n > against_n:
            expected_m_s = self._allowed_m_s(limit_n - expected_n)
            if abs(force_n) < _PROBING_SHARE * limit_n:
                expected_m_s = max(expected_m_s, _PROBING_M_S)
            fastest_m_s = min(fastest_m_s, expected_m_s)
        if abs(velocity_m_s) <= fastest_m_s + _EXACT:
            return velocity_m_s
        self.force_limited = True
        if against_n > limit_n:
            hits.append(LimitHit("force", force_n, sign * limit_n, "N"))
        else:
            hits.append(LimitHit("contact_speed", velocity_m_s, sign * fastest_m_s, "m/s"))
        return sign * fastest_m_s

    def _yielding(self, velocity_m_s: float, force_n: float, most_m_s: float, hits: list[LimitHit]) -> float:
        """Velocity backwards, out of a wall whose force is over 5 % beyond the limit; it sets `force_limited`
        and adds a "force" hit. Else, or where the velocity is negative already, returns it unchanged. Yields
        at most at `most_m_s`, and `_YIELD_M` back from the furthest point since the last way back: a force
        that stays is of no wall that moves.
        """
        excess_n = force_n - (1.0 + OVER_SHARE) * self._force_n
        if excess_n <= 0.0 or velocity_m_s < 0.0:
            self._deepest_m = self.position_m if velocity_m_s < 0.0 else max(self._deepest_m, self.position_m)
            return velocity_m_s
        self.force_limited = True
        hits += [] if hits and hits[-1].rule == "force" else [LimitHit("force", force_n, self._force_n, "N")]
        left_m = self.position_m - self._deepest_m + _YIELD_M
        out_m_s = _stoppable_m_s(left_m, self._acceleration_m_s2, self._dt_s)
        return self._within_workspace(-min(self._allowed_m_s(excess_n), out_m_s, most_m_s), self._dt_s)

    def _allowed_m_s(self, left_n: float) -> float:
        return _stoppable_m_s(left_n / self._wall_n_m, self._acceleration_m_s2, self._delay_s)
