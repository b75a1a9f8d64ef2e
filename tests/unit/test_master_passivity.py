"""The observer against the integral of force times velocity, the controller against its own energy."""

from math import pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.master.passivity import PassivityController, PassivityObserver

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
