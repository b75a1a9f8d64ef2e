"""Motion, contact and sensor effects against closed forms."""

from math import exp

import pytest

from forefeel.common.causes.capstan import Capstan
from forefeel.common.causes.sensor import SensorLag, SensorQuantisation, SensorSaturation
from forefeel.common.causes.transmission import Backlash
from forefeel.common.causes.wall import ContactLoss


def test_backlash_loses_its_width_at_each_reversal() -> None:
    effect = Backlash(width_m=0.002)
    path = [0.0, 0.001, 0.002, 0.010, 0.009, 0.008, 0.007, 0.005]
    instrument = [effect.transform(0.0, x, 1.0, 2.0, 1e-3) for x in path]
    assert [y for y, _, _ in instrument] == pytest.approx(
        [0.0, 0.0, 0.001, 0.009, 0.009, 0.009, 0.008, 0.006]
    )
    assert [v for _, v, _ in instrument] == [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0]
    assert [a for _, _, a in instrument] == [2.0 * v for _, v, _ in instrument]


def test_backlash_without_width_changes_nothing() -> None:
    effect = Backlash(width_m=0.0)
    assert [effect.transform(0.0, x, 0.3, 0.4, 1e-3) for x in (0.1, 0.1)] == [(0.1, 0.3, 0.4)] * 2


def test_contact_begins_beyond_its_position() -> None:
    effect = ContactLoss(contact_position_m=0.01)
    assert effect.penetration_m(0.01, 0.0) is None
    assert effect.penetration_m(0.013, 0.0) == pytest.approx(0.003)


def test_a_damped_wall_pushes_and_does_not_pull() -> None:
    effect = ContactLoss(contact_position_m=0.01, release_s=0.1)
    assert effect.penetration_m(0.013, -0.029) == pytest.approx(0.003)
    assert effect.penetration_m(0.013, -0.031) is None, "spring and damper together would pull"
    assert effect.penetration_m(0.009, 1.0) is None


def test_a_shaft_whose_bends_grow_with_its_length_multiplies_more_the_deeper_it_is() -> None:
    effect = Capstan(wrap_rad=0.1, wrap_rad_m=20.0)
    assert effect.factor(0.01, 1.0, 1.0) == pytest.approx(exp(0.3))
    assert effect.factor(0.01, -1.0, 1.0) == pytest.approx(exp(-0.3))
    assert effect.factor(0.01, -1.0, -1.0) == pytest.approx(exp(0.3)), "a tip that pulls"
    assert effect.factor(-0.01, 1.0, 1.0) == pytest.approx(exp(0.1))


@pytest.mark.parametrize("steps", [1, 10, 1000])
def test_sensor_lag_answers_a_step_exactly(steps: int) -> None:
    effect = SensorLag(time_constant_s=0.02)
    assert effect.sense(0.0, 1.0, 1e-3) == 1.0
    readings = [effect.sense(0.0, 3.0, 0.05 / steps) for _ in range(steps)]
    assert readings[-1] == pytest.approx(3.0 - 2.0 * exp(-0.05 / 0.02), rel=1e-9)


def test_sensor_lag_after_a_reset_is_settled_at_its_first_force() -> None:
    effect = SensorLag(time_constant_s=0.02)
    effect.sense(0.0, 1.0, 1e-3)
    effect.reset()
    assert effect.sense(0.0, -5.0, 1e-3) == -5.0


def test_saturation_clips_both_signs() -> None:
    effect = SensorSaturation(limit_n=0.5)
    assert [effect.sense(0.0, f, 1e-3) for f in (-2.0, -0.5, 0.2, 0.7)] == [-0.5, -0.5, 0.2, 0.5]


def test_quantisation_gives_a_comb() -> None:
    effect = SensorQuantisation(step_n=0.01)
    readings = [effect.sense(0.0, f, 1e-3) for f in (-0.0149, 0.0049, 0.0051, 0.026)]
    assert readings == pytest.approx([-0.01, 0.0, 0.01, 0.03])
