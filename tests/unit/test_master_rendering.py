"""The rendered force, and the energy that it gives."""

from itertools import pairwise
from math import inf, isfinite, nan, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.limiter import LimitHit
from forefeel.master.rendering import ForceRenderer
from forefeel.master.settings import RenderingSettings

MS = 1_000_000
SETTINGS = RenderingSettings(force_scale=2.0, max_force_n=4.0, max_slew_n_s=40.0, fade_s=0.2)


class Hand:
    """A renderer at 1 kHz."""

    def __init__(self, settings: RenderingSettings = SETTINGS, actuator_delay_s: float = 0.0) -> None:
        self.renderer = ForceRenderer(settings)
        self.renderer.late_by(actuator_delay_s)
        self.now_ns = 0
        self.position_m = self.energy_j = 0.0
        self.hits: tuple[LimitHit, ...] = ()

    def feel(
        self,
        contact_n: float | None,
        live: bool = True,
        ticks: int = 1,
        tick_ns: int = MS,
        speed_m_s: float = 0.0,
    ) -> float:
        force_n = self.renderer.force_n
        for _ in range(ticks):
            self.now_ns += tick_ns
            self.position_m += speed_m_s * tick_ns * 1e-9
            rendered = self.renderer.render(self.now_ns, contact_n, live, self.position_m)
            force_n, self.energy_j, self.hits = rendered.force_n, rendered.energy_j, rendered.hits
        return force_n


@pytest.mark.parametrize("contact_n", [2.5, -2.5, 1e12])
def test_no_more_than_the_limit_is_felt_and_that_is_said(contact_n: float) -> None:
    hand = Hand()
    speed_m_s = 0.01 if contact_n > 0 else -0.01  # into the contact
    assert hand.feel(contact_n, ticks=1000, speed_m_s=speed_m_s) == (4.0 if contact_n > 0 else -4.0)
    (hit,) = hand.hits
    assert (hit.rule, hit.requested, hit.unit) == ("rendered_force", 2.0 * contact_n, "N")
    assert abs(hit.applied) == 4.0


def test_a_spring_is_felt_within_what_one_notices() -> None:
    """200 N/m, 10 mm in and out to 1.5 mm: the way in pays for what a delay gives back."""
    hand = Hand(RenderingSettings())
    hand.feel(0.0, ticks=300)
    for speed_m_s, ticks in ((0.05, 200), (-0.05, 170)):
        for _ in range(ticks):
            stretch_n = 200.0 * (hand.position_m + speed_m_s * 1e-3)
            felt_n = hand.feel(stretch_n, speed_m_s=speed_m_s)
            assert stretch_n - 1e-9 <= felt_n <= 1.06 * stretch_n + 0.08 + 1e-9


def test_a_force_that_passivity_holds_back_is_not_smoothed_too() -> None:
    hand = Hand(RenderingSettings())
    hand.feel(3.0, ticks=300, speed_m_s=-0.02)
    (hit,) = hand.hits
    assert (hit.rule, hit.requested, hit.applied) == ("rendered_energy", 3.0, 0.0)


CONTACT = st.none() | st.floats(-10.0, 10.0) | st.sampled_from([nan, inf, -inf, 1e308, -1e308])
STEP = st.tuples(
    CONTACT,
    st.booleans(),
    st.integers(1, 60),
    st.sampled_from([MS, MS, MS, 1, 3 * MS, 50 * MS]),
    st.sampled_from([0.003, -0.003, 0.0]),
)
Steps = list[tuple[float | None, bool, int, int, float]]


@st.composite
def all_settings(draw: st.DrawFn) -> RenderingSettings:
    max_force_n = draw(st.floats(0.1, 50.0))
    max_slew_n_s = draw(st.floats(20.0, 1000.0))
    shortest_s = max_force_n / max_slew_n_s
    return RenderingSettings(
        force_scale=draw(st.floats(0.01, 100.0)),
        max_force_n=max_force_n,
        max_slew_n_s=max_slew_n_s,
        fade_s=draw(st.floats(shortest_s, 5.0)),
    )


def test_a_wall_is_no_stiffer_than_the_bound() -> None:
    """A contact of 100 N/mm, felt through a bound of 0.8 N/mm."""
    hand = Hand(RenderingSettings(max_stiffness_n_m=800.0, max_slew_n_s=10_000.0))
    hand.feel(0.0, ticks=300)
    start_m = hand.position_m
    while hand.position_m < start_m + 0.002:
        force_n = hand.feel(1e5 * (hand.position_m - start_m), speed_m_s=0.05)
        assert force_n <= 800.0 * (hand.position_m - start_m + 1.5 * 0.05e-3)
    assert force_n == pytest.approx(1.6, rel=0.05)


def test_a_late_force_holds_a_trembling_hand_without_a_buzz() -> None:
    """3 N come while the hand trembles on its place by 0.2 mm at 9 Hz: 99 % of the steps are about K v T."""
    adversary, w = Adversary(RenderingSettings()), 18.0 * pi
    adversary.speed_m_s = 0.2e-3 * w
    forces_n = []
    for n in range(3000):
        adversary.move(-0.2e-3 * w * w * sin(w * n * DT_S), 3.0)
        forces_n.append(adversary.hand.renderer.force_n)
    assert max(forces_n) > 0.5
    steps_n = sorted(abs(after - before) for before, after in pairwise(forces_n))
    assert steps_n[int(0.99 * len(steps_n))] <= 1.5 * 4000.0 * 0.2e-3 * w * DT_S
    assert adversary.lowest_j >= -0.1e-3


DT_S = 1e-3


def test_friction_saves_up_no_more_than_a_spring_gives_back() -> None:
    """2 N over 100 mm are 200 mJ; then 2 N push on: F^2 / 2 K = 10 mJ are given."""
    hand = Hand(RenderingSettings(max_slew_n_s=80.0))
    hand.feel(2.0, ticks=2000, speed_m_s=0.05)
    saved_j = hand.energy_j
    hand.feel(2.0, ticks=2000, speed_m_s=-0.05)
    assert saved_j - hand.energy_j == pytest.approx(10e-3, rel=0.1)


def test_the_energy_is_that_of_the_force_as_applied() -> None:
    hand = Hand(RenderingSettings())
    for _ in range(500):
        assert hand.feel(1.0, speed_m_s=0.02) >= 0.0
        hand.renderer.applied(0.25)  # an actuator that saturates
    assert hand.energy_j == pytest.approx(0.25 * 499 * 0.02 * DT_S)


class Adversary:
    """Moves the hand and accounts what it puts in, by actuators of each lateness up to a tick beyond that
    which the driver states, and by one of any lateness up to it in each tick.
    """

    def __init__(self, settings: RenderingSettings, stated_ticks: int = 0) -> None:
        self.hand = Hand(settings, stated_ticks * DT_S)
        self.speed_m_s = self.lowest_j = 0.0
        self._forces_n = [0.0] * (stated_ticks + 2)
        self.put_in_j = [0.0] * (stated_ticks + 3)

    def move(self, acceleration_m_s2: float, contact_n: float | None, live: bool = True) -> None:
        self.speed_m_s = max(-0.5, min(0.5, self.speed_m_s + acceleration_m_s2 * DT_S))
        moved_m = self.speed_m_s * DT_S
        taken_j = [force_n * moved_m for force_n in self._forces_n]
        self.put_in_j = [sum(e) for e in zip(self.put_in_j, [*taken_j, min(taken_j)], strict=True)]
        self.lowest_j = min(self.lowest_j, *self.put_in_j)
        self._forces_n = [self.hand.feel(contact_n, live, speed_m_s=self.speed_m_s), *self._forces_n[:-1]]


@given(
    all_settings(),
    st.integers(0, 5),
    st.floats(0.0, 0.01),
    st.integers(1, 300),
    st.lists(
        st.tuples(
            st.sampled_from([-20.0, 20.0]) | st.floats(-20.0, 20.0),  # m/s^2
            st.sampled_from([-50.0, 50.0]) | CONTACT,
            st.booleans(),
            st.integers(1, 60),
        ),
        min_size=1,
        max_size=12,
    ),
)
def test_no_target_and_no_motion_up_to_20_m_s2_gives_the_hand_energy(
    settings: RenderingSettings,
    stated_ticks: int,
    pressing_m_s: float,
    pressing_ticks: int,
    motions: list[tuple[float, float | None, bool, int]],
) -> None:
    """A slow press in which the force grows while little is put in, then anything."""
    adversary = Adversary(settings, stated_ticks)
    adversary.speed_m_s = pressing_m_s
    for _ in range(pressing_ticks):
        adversary.move(0.0, 50.0)
    for acceleration_m_s2, contact_n, live, ticks in motions:
        for _ in range(ticks):
            adversary.move(acceleration_m_s2, contact_n, live)
    assert adversary.lowest_j >= -1e-3
    assert adversary.hand.energy_j == pytest.approx(adversary.put_in_j[stated_ticks], abs=1e-9)


@given(all_settings(), st.lists(STEP, max_size=20), st.sampled_from([1.0, nan, None]))
def test_the_force_is_finite_and_limited_only_jumps_towards_zero_and_is_gone_when_the_fade_is_over(
    settings: RenderingSettings, steps: Steps, then: float | None
) -> None:
    hand = Hand(settings)
    for contact_n, live, ticks, tick_ns, speed_m_s in steps:
        for _ in range(ticks):
            before_n = hand.renderer.force_n
            force_n = hand.feel(contact_n, live, 1, tick_ns, speed_m_s)
            assert isfinite(force_n)
            assert abs(force_n) <= settings.max_force_n
            slewed_n = settings.max_slew_n_s * min(tick_ns * 1e-9, 0.010) * (1 + 1e-9) + 1e-12
            if abs(force_n - before_n) > slewed_n:
                assert abs(force_n) < abs(before_n)
                assert hand.hits[-1].rule == "rendered_energy"
    ticks = round(settings.fade_s * 1000) + 2
    assert abs(hand.feel(then, live=False, ticks=ticks)) <= 1e-9
    assert hand.feel(then, live=False, ticks=50) == 0.0
