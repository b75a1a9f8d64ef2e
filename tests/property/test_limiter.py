from copy import deepcopy
from itertools import accumulate
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.limiter import MotionLimiter
from forefeel.common.settings import AxisLimits

DT_S = 1e-3
TINY = 1e-9
POSITION = st.floats(-0.3, 0.4)
SPEED = st.floats(-2.0, 2.0)
FORCE = st.floats(-5.0, 5.0)


@st.composite
def all_limits(draw: st.DrawFn) -> AxisLimits:
    low_m = draw(st.floats(-0.05, 0.05))
    return AxisLimits(
        workspace_m=(low_m, low_m + draw(st.floats(0.001, 0.2))),
        max_velocity_m_s=draw(st.floats(0.005, 2.0)),
        max_acceleration_m_s2=draw(st.floats(0.1, 100.0)),
        max_force_n=draw(st.floats(0.1, 4.0)),
        stiffest_wall_n_m=draw(st.floats(1.0, 1e4)),
    )


KIND, SHARE = st.sampled_from(["follow", "stop"]), st.floats(0.0, 1.0)
TICKS = st.integers(1, 40)  # without a new command
STEP_S = st.sampled_from([1e-6, 0.3e-3, 1e-3, 1e-3, 1e-3, 4e-3, 10e-3])
COMMANDS = st.lists(st.tuples(KIND, POSITION, SPEED, FORCE, SHARE, TICKS, STEP_S), min_size=1, max_size=30)
Commands = list[tuple[str, float, float, float, float, int, float]]


@given(all_limits(), st.floats(0.1, 100.0), COMMANDS)
def test_no_stream_of_commands_takes_the_setpoint_beyond_a_limit(
    limits: AxisLimits, stop_m_s2: float, commands: Commands
) -> None:
    motion = MotionLimiter(limits, stop_m_s2)
    low_m, high_m = limits.workspace_m
    motion.place(0.5 * (low_m + high_m))
    for kind, position_m, velocity_m_s, force_n, share, ticks, dt_s in commands:
        for tick in range(ticks):
            before_m, before_m_s = motion.position_m, motion.velocity_m_s
            if kind == "follow":
                motion.follow(position_m + velocity_m_s * tick * dt_s, velocity_m_s, force_n, dt_s, share)
                most_m_s2 = limits.max_acceleration_m_s2
            else:
                motion.stop(dt_s, force_n)
                most_m_s2 = max(stop_m_s2, limits.max_acceleration_m_s2)
                assert abs(motion.velocity_m_s) <= abs(before_m_s)
            assert low_m <= motion.position_m <= high_m
            assert abs(motion.velocity_m_s) <= limits.max_velocity_m_s + TINY
            assert abs(motion.velocity_m_s - before_m_s) <= most_m_s2 * dt_s + TINY
            assert abs(motion.position_m - before_m - motion.velocity_m_s * dt_s) <= TINY * dt_s + 1e-15


@given(all_limits(), st.floats(-0.05, 0.25), COMMANDS)
def test_from_outside_of_the_workspace_it_never_goes_further_out(
    limits: AxisLimits, start_m: float, commands: Commands
) -> None:
    motion = MotionLimiter(limits, 4.0)
    motion.place(start_m)
    low_m, high_m = limits.workspace_m
    outside_m = max(low_m - start_m, start_m - high_m, 0.0)
    for _, position_m, velocity_m_s, force_n, share, ticks, dt_s in commands:
        for _ in range(ticks):
            motion.follow(position_m, velocity_m_s, force_n, dt_s, share)
            now_m = max(low_m - motion.position_m, motion.position_m - high_m, 0.0)
            assert now_m <= outside_m + 1e-12
            outside_m = now_m


@given(st.lists(st.tuples(st.floats(-1.0, 1.0), st.integers(1, 30)), min_size=1, max_size=30))
def test_what_stays_inside_the_limits_is_met_exactly_and_never_touched(
    pieces: list[tuple[float, int]],
) -> None:
    """Commands whose second difference is an acceleration below the limit, far from the walls."""
    limits = AxisLimits(
        workspace_m=(-5.0, 5.0), max_velocity_m_s=0.5, max_acceleration_m_s2=8.0, stiffest_wall_n_m=1.0
    )
    motion = MotionLimiter(limits, 4.0)
    accelerations = [7.5 * a for a, ticks in pieces for _ in range(ticks)]
    speeds = [max(-0.49, min(0.49, v)) for v in accumulate(a * DT_S for a in accelerations)]
    position_m = 0.0
    for before_m_s, speed_m_s in zip([0.0, *speeds], speeds, strict=False):
        position_m += 0.5 * (before_m_s + speed_m_s) * DT_S
        hits = motion.follow(position_m, speed_m_s, 0.0, DT_S)
        if abs(speed_m_s - before_m_s) > 7.6 * DT_S:  # clipped: a jump of the acceleration
            break
        assert hits == []
        assert abs(motion.position_m - position_m) <= 1e-12


WITHOUT: dict[str, dict[str, Any]] = {
    "workspace": {"workspace_m": (-9.0, 9.0)},
    "velocity": {"max_velocity_m_s": 1000.0},
    "force": {"max_force_n": 9000.0, "stiffest_wall_n_m": 1e-3},
}
SAID_BY = {
    "workspace": {"workspace", "velocity", "force"},  # force: of a motion out of a wall that pushes
    "velocity": {"velocity", "force"},
    "force": {"force", "contact_speed"},
}


def _limited_by(limits: AxisLimits) -> dict[str, Any]:
    of_limits = vars(MotionLimiter(limits, 4.0))
    return {name: of_limits[name] for name in ("_low_m", "_high_m", "_velocity_m_s", "_force_n", "_wall_n_m")}


@given(all_limits(), COMMANDS)
def test_a_limit_without_which_the_motion_were_another_is_reported(
    limits: AxisLimits, commands: Commands
) -> None:
    """The same step from the same state, with one limit taken away, is the same step or was reported."""
    motion = MotionLimiter(limits, 4.0)
    motion.place(sum(limits.workspace_m) / 2)
    for _, position_m, velocity_m_s, force_n, _, ticks, dt_s in commands:
        speed_m_s = max(-limits.max_velocity_m_s, min(limits.max_velocity_m_s, velocity_m_s))
        for _ in range(ticks):
            others = {}
            for rule, changes in WITHOUT.items():
                other = deepcopy(motion)
                vars(other).update(_limited_by(limits.model_copy(update=changes)))
                other.follow(position_m, speed_m_s, force_n, dt_s)
                others[rule] = other
            hits = motion.follow(position_m, speed_m_s, force_n, dt_s)
            said = {hit.rule for hit in hits}
            for rule, other in others.items():
                if abs(other.velocity_m_s - motion.velocity_m_s) > 1e-6:
                    assert said & SAID_BY[rule], rule
            assert len(said) == len(hits)
            assert all(hit.requested != hit.applied for hit in hits)


@given(all_limits(), st.floats(0.0, 1.0), st.floats(1.0001, 5.0), st.sampled_from([1, -1]), COMMANDS)
def test_above_the_force_limit_the_speed_into_the_contact_only_falls(
    limits: AxisLimits, start: float, excess: float, sign: int, commands: Commands
) -> None:
    motion = MotionLimiter(limits, 4.0)
    low_m, high_m = limits.workspace_m
    motion.place(low_m + start * (high_m - low_m))
    for _, position_m, velocity_m_s, _, share, ticks, dt_s in commands:
        motion.follow(position_m, velocity_m_s, 0.0, dt_s, share)
        for _ in range(ticks):
            before_m_s = sign * motion.velocity_m_s
            motion.follow(position_m, velocity_m_s, sign * excess * limits.max_force_n, dt_s, share)
            assert (
                sign * motion.velocity_m_s
                <= max(0.0, before_m_s - limits.max_acceleration_m_s2 * dt_s) + TINY
            )
