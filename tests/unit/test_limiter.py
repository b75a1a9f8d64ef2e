import math

import pytest

from forefeel.common.limiter import LimitHit, MotionLimiter
from forefeel.common.settings import AxisLimits

DT_S = 1e-3
LIMITS = AxisLimits(
    workspace_m=(-0.01, 0.1),
    max_velocity_m_s=0.2,
    max_acceleration_m_s2=8.0,
    max_force_n=3.0,
    stiffest_wall_n_m=1.0,
)
STOP_M_S2 = 4.0


def limiter(at_m: float = 0.05) -> MotionLimiter:
    motion = MotionLimiter(LIMITS, STOP_M_S2)
    motion.place(at_m)
    return motion


def moving(velocity_m_s: float) -> MotionLimiter:
    motion = limiter()
    motion.velocity_m_s = velocity_m_s
    return motion


def rules(hits: list[LimitHit]) -> list[str]:
    return [hit.rule for hit in hits]


def test_a_step_is_reached_exactly_without_overshoot_and_at_the_limits() -> None:
    motion, reached = limiter(0.02), list[float]()
    fastest = 0.0
    for _ in range(500):
        motion.follow(0.06, 0.0, 0.0, DT_S)
        reached.append(motion.position_m)
        fastest = max(fastest, motion.velocity_m_s)
    assert motion.position_m == 0.06
    assert motion.velocity_m_s == 0.0
    assert max(reached) <= 0.06 + 1e-9
    assert fastest == pytest.approx(0.2)
    took_s = next(i for i, x in enumerate(reached, 1) if abs(x - 0.06) < 1e-5) * DT_S
    ramps_s = 0.5 * 0.2 / 8.0 + 0.5 * 0.2 / 4.0  # up at the limit, down at half of it
    assert took_s == pytest.approx(0.04 / 0.2 + ramps_s, abs=0.005)


@pytest.mark.parametrize("behind_m", [0.0, 1e-4, 5e-4, 2e-3])
def test_a_setpoint_that_fell_behind_catches_up_with_a_hand_that_trembles_near_the_limit(
    behind_m: float,
) -> None:
    motion, w = limiter(0.05 - behind_m), 2.0 * math.pi * 12.0
    amplitude_m = 0.9 * LIMITS.max_acceleration_m_s2 / w**2  # 1.3 mm
    for tick in range(1000):
        wt = w * tick * DT_S
        asked_m, velocity_m_s = 0.05 + amplitude_m * math.sin(wt), amplitude_m * w * math.cos(wt)
        motion.follow(asked_m, velocity_m_s, 0.0, DT_S)
        assert tick < 500 or motion.position_m == pytest.approx(asked_m, abs=1e-9)


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_the_ramp_on_engaging_limits_the_speed(share: float) -> None:
    motion = limiter(0.0)
    for _ in range(300):
        motion.follow(0.09, 0.0, 0.0, DT_S, share)
        assert motion.velocity_m_s <= 0.2 * share + 1e-12
    assert (motion.position_m > 0.0) == (share > 0)


@pytest.mark.parametrize("sign", [1, -1])
def test_above_the_force_limit_it_may_only_relieve(sign: int) -> None:
    motion = limiter(0.05)
    hits = motion.follow(0.05 + sign * 0.01, 0.0, sign * 3.1, DT_S)
    assert (motion.position_m, motion.velocity_m_s) == (0.05, 0.0)
    assert hits == [LimitHit("force", sign * 3.1, sign * 3.0, "N")]
    back_m = 0.05 - sign * 0.01
    for _ in range(200):
        relieving = sign * (motion.position_m - back_m) > 1e-6
        hits = motion.follow(back_m, 0.0, sign * 3.1, DT_S)
        assert "force" not in rules(hits) or not relieving
    assert motion.position_m == pytest.approx(back_m, abs=1e-6)


def test_a_wall_that_pushes_moves_the_stage_out_by_five_millimetres_at_most_and_only_out() -> None:
    motion = limiter(0.05)
    for _ in range(2000):
        hits = motion.follow(0.06, 0.0, 4.0, DT_S)
        assert motion.velocity_m_s <= 0.0
        assert rules(hits)[0] == "force"
    assert motion.position_m == pytest.approx(0.045, abs=1e-5)
    for _ in range(100):
        motion.follow(0.06, 0.0, -4.0, DT_S)  # a pull: the hand has the stage
        assert motion.velocity_m_s >= 0.0
    motion.place(0.05)
    motion.follow(0.05, 0.0, 4.0, DT_S, 1.0, 0.9)  # of a blind cell
    assert motion.position_m == 0.05


@pytest.mark.parametrize("sign", [1, -1])
def test_towards_contact_the_way_that_is_left_of_the_limit_bounds_the_speed(sign: int) -> None:
    """3 N within 1 mm, 8 m/s^2 and 8 ms: 77.8 mm/s in the open, 18.2 mm/s at 2.5 N, free on the way out."""
    motion = MotionLimiter(LIMITS.model_copy(update={"stiffest_wall_n_m": 3000.0}), STOP_M_S2)
    motion.place(0.05)

    def speed_m_s(direction: int, force_n: float, band_n: tuple[float, float] | None = None) -> float:
        motion.velocity_m_s = 0.15 * direction
        for _ in range(60):
            motion.position_m = 0.05
            motion.follow(0.05 + 0.05 * direction, 0.0, sign * force_n, DT_S, band_n=band_n)
        return motion.velocity_m_s * direction

    assert speed_m_s(sign, 0.0) == pytest.approx(0.0778, abs=1e-4)
    assert speed_m_s(sign, 2.5) == pytest.approx(0.0182, abs=1e-4)
    assert speed_m_s(-sign, 2.5) > 0.1
    expected_n = (2.4, 2.5) if sign > 0 else (-2.5, -2.4)
    assert speed_m_s(sign, 0.0, expected_n) == pytest.approx(0.0182, abs=1e-4)
    assert speed_m_s(sign, 2.5, (-0.1, 0.1)) == pytest.approx(0.0182, abs=1e-4)
    beyond_n = (2.0, 9.0) if sign > 0 else (-9.0, -2.0)
    assert speed_m_s(sign, 1.4, beyond_n) == pytest.approx(0.005)
    assert speed_m_s(sign, 1.6, beyond_n) == 0.0


def test_way_without_a_new_force_stays_unseen_in_bounded_memory() -> None:
    """The force is 0 N and frozen for 5 s: no more than the 3 mm are gone that 3 N leave of 1 N/mm."""
    limits = LIMITS.model_copy(update={"stiffest_wall_n_m": 1000.0})
    motion = MotionLimiter(limits, STOP_M_S2)
    for tick in range(5000):
        motion.age_s = tick * DT_S
        motion.follow(0.05, 0.0, 0.0, DT_S)
    assert 0.002 < motion.position_m <= 0.003
    assert len(motion._shown) < 1010
    motion.age_s = DT_S
    for _ in range(200):
        motion.follow(0.05, 0.0, 0.0, DT_S)
    assert motion.position_m > 0.01


@pytest.mark.parametrize("velocity_m_s", [0.2, -0.2, 0.05, -0.013])
def test_the_ramp_to_rest_takes_v_over_a_and_v_squared_over_two_a(velocity_m_s: float) -> None:
    motion = moving(velocity_m_s)
    ticks = 0
    while motion.velocity_m_s != 0.0:
        before_m_s = motion.velocity_m_s
        motion.stop(DT_S)
        ticks += 1
        assert abs(motion.velocity_m_s) < abs(before_m_s)
        assert abs(before_m_s - motion.velocity_m_s) <= STOP_M_S2 * DT_S + 1e-12
    assert ticks == pytest.approx(abs(velocity_m_s) / (STOP_M_S2 * DT_S), abs=1)
    assert abs(motion.position_m - 0.05) <= velocity_m_s**2 / (2 * STOP_M_S2) + 1e-12
    rest_m = motion.position_m
    motion.stop(DT_S)
    assert (motion.position_m, motion.velocity_m_s) == (rest_m, 0.0)
