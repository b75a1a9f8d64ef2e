"""Models as data, their composition, and effects by name."""

import pytest

from forefeel.common.causes.candidate import entry
from forefeel.common.causes.friction import CoulombFriction
from forefeel.common.causes.model import ContactModel
from tests.unit.model_samples import effect, mapping, model

DT = 1e-3


CONTACT = effect("contact_loss", contact_position_m=0.01)
WALL = effect("mass_damper_spring", mass_kg=0.01, damping_n_s_m=0.5, stiffness_n_m=8.0)
VALVE, BIAS = effect("coulomb_friction", force_n=0.2), effect("bias", force_n=0.03)
RELAXATION = effect("stress_relaxation", stiffness_n_m=6.0, time_constant_s=0.5)


def test_the_wall_sees_the_depth_and_the_shaft_the_position() -> None:
    runtime = model(WALL, CONTACT, VALVE, BIAS).runtime()
    assert runtime.step(0.0, 0.009, 0.02, 1.0, DT) == pytest.approx(0.2 + 0.03)
    wall_n = 0.01 * 1.0 + 0.5 * 0.02 + 8.0 * 0.005
    assert runtime.step(0.0, 0.015, 0.02, 1.0, DT) == pytest.approx(wall_n + 0.2 + 0.03)
    assert runtime.step(0.0, 0.015, -0.02, 0.0, DT) == pytest.approx(-0.5 * 0.02 + 8.0 * 0.005 - 0.2 + 0.03)


def test_losing_contact_forgets_the_state_of_the_wall() -> None:
    runtime = model(CONTACT, RELAXATION).runtime()
    first = runtime.step(0.0, 0.011, 0.02, 0.0, DT)
    assert runtime.step(0.0, 0.012, 0.02, 0.0, DT) > first > 0.0
    assert runtime.step(0.0, 0.009, 0.02, 0.0, DT) == 0.0
    assert runtime.step(0.0, 0.011, 0.02, 0.0, DT) == first


def test_without_contact_loss_or_at_another_site_it_is_always_touched() -> None:
    for always in (model(WALL), model(CONTACT, {**WALL, "site": "shaft"})):
        assert always.runtime().step(0.0, 0.009, 0.0, 0.0, DT) == pytest.approx(8.0 * 0.009)


def test_motion_effects_come_before_contact() -> None:
    runtime = model(CONTACT, WALL, effect("backlash", width_m=0.002)).runtime()
    runtime.step(0.0, 0.0, 0.0, 0.0, DT)
    assert runtime.step(0.0, 0.0105, 0.02, 0.0, DT) == 0.0
    assert runtime.instrument_m == pytest.approx(0.0095)
    assert runtime.step(0.0, 0.014, 0.0, 0.0, DT) == pytest.approx(8.0 * 0.003)


def test_sensor_effects_come_last_and_leave_the_regressors_alone() -> None:
    runtime = model(effect("sensor_saturation", limit_n=0.25), BIAS, VALVE, WALL).runtime()
    assert runtime.step(0.0, 0.1, 0.02, 0.0, DT) == 0.25
    assert runtime.regressors(0.0, 0.1, 0.02, 0.0, DT) == [1.0, 1.0, 0.0, 0.0, 0.02, 0.1]


def test_an_instrument_that_is_not_held_leaves_the_sensor_only() -> None:
    runtime = model(WALL, VALVE, BIAS).runtime()
    assert runtime.step_unheld(0.0, 0.1, 0.02, 0.0, DT) == pytest.approx(0.03)
    assert runtime.regressors_unheld(0.0, 0.1, 0.02, 0.0, DT) == [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]


def test_a_new_grip_forgets_the_contact_but_not_the_sensor() -> None:
    runtime = model(RELAXATION, effect("sensor_lag", time_constant_s=0.1)).runtime()
    for _ in range(200):
        loaded = runtime.step(0.0, 0.0, 0.05, 0.0, DT)
    runtime.reset_contact()
    assert 0.9 * loaded < runtime.step(0.0, 0.0, 0.0, 0.0, DT) < loaded
    runtime.reset()
    assert runtime.step(0.0, 0.0, 0.0, 0.0, DT) == 0.0


def test_linear_names_number_effects_of_equal_name() -> None:
    runtime = model(RELAXATION, VALVE, RELAXATION, BIAS).runtime()
    assert runtime.linear_names == (
        "bias.force_n",
        "coulomb_friction.forward_n",
        "coulomb_friction.backward_n",
        "stress_relaxation.stiffness_n_m",
        "stress_relaxation-2.stiffness_n_m",
    )
    assert runtime.linear_values == (0.03, 0.2, 0.2, 6.0, 6.0)


def test_a_mapping_comes_back_with_its_defaults() -> None:
    short = effect("stress_relaxation", "shaft", stiffness_n_m=6.0)
    described = model(short, VALVE).to_mapping()
    full = {"stiffness_n_m": 6.0, "time_constant_s": 1.0}
    friction = {"forward_n": 0.2, "backward_n": 0.2, "breakaway_m": 0.0, "transition_speed_m_s": 0.0}
    assert described == mapping({**short, "parameters": full}, effect("coulomb_friction", **friction))


@pytest.mark.parametrize(
    ("wrong", "place"),
    [
        (3, "model = 3: "),
        ({"name": "a", "effects": []}, "model: schema "),
        ({**mapping(), "schema": "other/1"}, "schema = 'other/1': "),
        ({**mapping(), "name": ""}, "name = '': "),
        ({**mapping(), "effects": 3}, "effects = 3: "),
        ({**mapping(), "more": 1}, "model: unknown key 'more', "),
        (mapping(WALL, {}), "effects[1]: effect "),
        (mapping({"effect": 4}), "effects[0].effect = 4: "),
        (mapping({**WALL, "site": "moon"}), "effects[0].site = 'moon': expected one of wall, shaft, sensor"),
        (mapping({**CONTACT, "site": "wall"}), "effects[0].site = 'wall': contact_loss adds no force, "),
        (mapping({"effect": "bias", "parameters": 1}), "effects[0].parameters = 1: "),
        (
            mapping({"effect": "with_column", "parameters": {"column": "rotation", "slope": 2.0}}),
            "effects[0].parameters.column: no parameter, expected as effects[0].column, ",
        ),
        (
            mapping(WALL, VALVE, effect("backlash", width_m=-1)),
            "effects[2].parameters.width_m = -1: expected ",
        ),
        (mapping(effect("bias", width_m=1)), "effects[0].parameters.width_m: unknown "),
        (mapping(CONTACT, WALL, CONTACT), "effects[2].effect: a second contact effect, "),
    ],
)
def test_a_wrong_mapping_is_refused_in_one_line_that_names_the_place(wrong: object, place: str) -> None:
    with pytest.raises(ValueError) as caught:
        ContactModel.from_mapping(wrong)
    assert str(caught.value).startswith(place)
    assert "\n" not in str(caught.value)


def test_entry_spells_out_a_shorthand_beside_a_parameter() -> None:
    given = {"force_n": 1.2, "breakaway_m": 1e-4}
    parameters = entry(CoulombFriction, given)["parameters"]
    assert parameters == {"forward_n": 1.2, "backward_n": 1.2, "breakaway_m": 1e-4}
    assert entry(CoulombFriction, {**given, "backward_n": 0.5})["parameters"]["backward_n"] == 0.5
