"""The rendered force, and the energy that it gives."""

from math import inf, isfinite, nan, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.limiter import LimitHit
from forefeel.master.passivity import PassivityController, PassivityObserver
from forefeel.master.rendering import ForceRenderer
from forefeel.master.settings import RenderingSettings

MS = 1_000_000
SETTINGS = RenderingSettings(
    force_scale=2.0, max_force_n=4.0, max_slew_n_s=40.0, max_jump_n_s=40.0, fade_s=0.2
)


class Hand:
    """A renderer at 1 kHz."""

    def __init__(self, settings: RenderingSettings = SETTINGS) -> None:
        self.renderer = ForceRenderer(settings)
        self.now_ns = 0
        self.position_m = self.energy_j = 0.0
        self.hits: tuple[LimitHit, ...] = ()

    @property
    def limited(self) -> bool:
        return bool(self.hits)

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
    assert hand.feel(contact_n, ticks=1000) == (4.0 if contact_n > 0 else -4.0)
    (hit,) = hand.hits
    assert (hit.rule, hit.requested, hit.unit) == ("rendered_force", 2.0 * contact_n, "N")
    assert abs(hit.applied) == 4.0


def test_without_a_motion_the_force_changes_no_faster_than_a_model_may_jump() -> None:
    """What the hand gets when the model learns: max_jump_n_s, not max_slew_n_s."""
    hand = Hand(RenderingSettings(force_scale=1.0, max_jump_n_s=5.0))
    hand.feel(1.0, ticks=500)
    before_n = hand.renderer.force_n
    assert hand.feel(2.0) - before_n == pytest.approx(0.005)
    assert hand.limited


def test_a_wall_is_no_stiffer_than_the_bound() -> None:
    """A contact of 100 N/mm, felt through a bound of 0.8 N/mm and a jump of next to nothing."""
    hand = Hand(RenderingSettings(max_jump_n_s=1e-6, max_stiffness_n_m=800.0, max_slew_n_s=10_000.0))
    hand.feel(0.0, ticks=300)
    start_m = hand.position_m
    while hand.position_m < start_m + 0.002:
        force_n = hand.feel(1e5 * (hand.position_m - start_m), speed_m_s=0.05)
        assert force_n <= 800.0 * (hand.position_m - start_m) + 1e-6
    assert force_n == pytest.approx(1.6, rel=0.05)


def test_what_is_passive_is_not_damped() -> None:
    """A spring of 200 N/m is felt as it is, 10 mm in and out to 1.2 mm.

    Further out even a spring is active: a force held for T gives K v T x more than it took, Colgate and
    Schenkel's leak, which here makes E negative below sqrt(2 X v T) = 1 mm.
    """
    hand = Hand(RenderingSettings())
    hand.feel(0.0, ticks=300)
    for speed_m_s, ticks in ((0.05, 200), (-0.05, 175)):
        for _ in range(ticks):
            stretch_n = 200.0 * (hand.position_m + speed_m_s * 1e-3)
            assert hand.feel(stretch_n, speed_m_s=speed_m_s) == pytest.approx(stretch_n, abs=1e-9)


CONTACT = st.none() | st.floats(-10.0, 10.0) | st.sampled_from([nan, inf, -inf, 1e308, -1e308])
STEP = st.tuples(
    CONTACT, st.booleans(), st.integers(1, 60), st.sampled_from([MS, MS, MS, 1, 3 * MS, 50 * MS])
)


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


@given(all_settings(), st.lists(STEP, min_size=1, max_size=20))
def test_never_a_jump_never_too_much_never_a_number_that_is_none(
    settings: RenderingSettings, steps: list[tuple[float | None, bool, int, int]]
) -> None:
    hand = Hand(settings)
    for contact_n, live, ticks, tick_ns in steps:
        for _ in range(ticks):
            before_n = hand.renderer.force_n
            force_n = hand.feel(contact_n, live, tick_ns=tick_ns)
            assert isfinite(force_n)
            assert abs(force_n) <= settings.max_force_n
            moved_s = min(tick_ns * 1e-9, 0.010)
            assert abs(force_n - before_n) <= settings.max_slew_n_s * moved_s * (1 + 1e-9) + 1e-12


@given(all_settings(), st.lists(STEP, max_size=12), st.sampled_from([1.0, nan, None]))
def test_from_wherever_it_is_the_force_is_gone_when_the_fade_is_over(
    settings: RenderingSettings, steps: list[tuple[float | None, bool, int, int]], then: float | None
) -> None:
    hand = Hand(settings)
    for contact_n, live, ticks, tick_ns in steps:
        hand.feel(contact_n, live, ticks, tick_ns)
    ticks = round(settings.fade_s * 1000) + 2
    assert abs(hand.feel(then, live=False, ticks=ticks)) <= 1e-9
    assert hand.feel(then, live=False, ticks=50) == 0.0


DT_S = 1e-3


def _oscillate(force: float, phase_rad: float, controller: PassivityController | None) -> PassivityObserver:
    """Four seconds of x = 5 mm sin(w t) under f = force sin(w t + phase), active for a negative phase."""
    observer, w = PassivityObserver(), 2.0 * pi
    before_m, applied_n = 0.0, 0.0
    for n in range(4000):
        t = n * DT_S
        x = 0.005 * sin(w * t)
        energy_j = observer.observe(x, applied_n)
        applied_n = force * sin(w * t + phase_rad)
        if controller is not None:
            applied_n += controller.force_n(energy_j, (x - before_m) / DT_S, DT_S)
        before_m = x
    return observer


@pytest.mark.parametrize("phase_rad", [0.5 * pi, -0.5 * pi, 0.3])
def test_the_energy_is_the_integral_of_force_times_velocity(phase_rad: float) -> None:
    """Over whole periods: pi A F sin(phase) for each."""
    energy_j = _oscillate(1.0, phase_rad, None).energy_j
    assert energy_j == pytest.approx(4 * pi * 0.005 * sin(phase_rad), abs=2e-4)


def test_an_active_force_gives_energy_and_the_controller_takes_it_back() -> None:
    free, controlled = _oscillate(1.0, -1.0, None), _oscillate(1.0, -1.0, PassivityController(1000.0))
    assert free.lowest_j < -0.04
    assert controlled.lowest_j > -0.002
    assert controlled.energy_j > -0.002


@given(st.floats(-1.0, 0.0), st.floats(-1.0, 1.0), st.floats(0.0, 100.0))
def test_the_damping_resists_is_bounded_and_never_takes_more_than_was_given(
    energy_j: float, velocity_m_s: float, max_damping_n_s_m: float
) -> None:
    force_n = PassivityController(max_damping_n_s_m).force_n(energy_j, velocity_m_s, DT_S)
    assert force_n * velocity_m_s >= 0.0
    assert abs(force_n) <= max_damping_n_s_m * abs(velocity_m_s)
    assert force_n * velocity_m_s * DT_S <= -energy_j * (1 + 1e-9) + 1e-300


@given(st.floats(0.0, 1.0), st.floats(-1.0, 1.0))
def test_a_passive_force_is_left_alone(energy_j: float, velocity_m_s: float) -> None:
    assert PassivityController(10.0).force_n(energy_j, velocity_m_s, DT_S) == 0.0
