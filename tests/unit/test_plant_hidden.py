"""What is hidden in the simulated world: switched on at an instant, with the memory of the motion so far."""

from typing import Any

import numpy as np
import pytest

from forefeel.common.causes.model import SCHEMA
from forefeel.common.errors import ConfigurationError
from forefeel.common.recording.recording import Array
from forefeel.slave.plant.settings import world_settings
from forefeel.slave.plant.world import SimulatedWorld
from tests.unit.test_plant_world import QUIET, drive, stroke

WALL = {"effect": "mass_damper_spring", "parameters": {"damping_n_s_m": 0.5, "stiffness_n_m": 10.0}}
RELAXING = {"effect": "stress_relaxation", "parameters": {"stiffness_n_m": 8.0, "time_constant_s": 0.5}}
FRICTION = {"effect": "presliding_hysteresis", "parameters": {"force_n": 0.1, "stiffness_n_m": 100.0}}


def model(*effects: dict[str, Any]) -> dict[str, Any]:
    return {"schema": SCHEMA, "name": "world", "effects": list(effects)}


def forces(*effects: dict[str, Any], load_cell: dict[str, Any] = QUIET, **hidden: Any) -> Array:  # noqa: ANN401
    """The readings of 2 s of strokes in a world of these effects."""
    mapping: dict[str, Any] = {"contact": model(*effects), "load_cell": load_cell}
    if hidden:
        mapping["hidden"] = hidden
    world = SimulatedWorld(world_settings(mapping), 1)
    return np.array([reading.force_n for reading in drive(world, stroke(0.02, 1.3), 2.0)])


@pytest.mark.parametrize("hidden", [RELAXING, FRICTION], ids=["relaxation", "friction"])
def test_before_it_is_not_there_and_then_it_has_felt_the_motion_all_along(hidden: dict[str, Any]) -> None:
    switched = forces(WALL, effects=model(hidden), from_s=1.0)
    without, throughout = forces(WALL), forces(WALL, hidden)
    np.testing.assert_array_equal(switched[:999], without[:999])
    np.testing.assert_allclose(switched[1010:], throughout[1010:], atol=1e-6)  # behind the cell's filter
    assert np.abs(switched - without)[1010:].max() > 0.02


def test_a_sensor_acts_on_readings_behind_the_noise_and_from_its_instant_on() -> None:
    noisy = {**QUIET, "noise_n": 0.01}
    flat = {"effect": "sensor_saturation", "parameters": {"limit_n": 0.1}}
    always, later = (
        forces(WALL, flat, load_cell=noisy),
        forces(WALL, load_cell=noisy, effects=model(flat), from_s=1.5),
    )
    assert always.max() == pytest.approx(0.1, abs=1e-6), "flat tops, not tops with noise on them"
    assert np.count_nonzero(always > 0.0999) > 100
    assert later[:1499].max() > 0.2
    assert later[1500:].max() == pytest.approx(0.1, abs=1e-6)


@pytest.mark.parametrize(
    ("hidden", "words"),
    [
        ({"effects": model({"effect": "contact_loss"})}, "a second contact effect"),
        ({"effects": model({"effect": "magic"})}, "magic"),
        ({"effects": model(FRICTION), "from_s": -1.0}, "from_s"),
        ({"effects": model(FRICTION), "model": "m.yaml"}, "expected one of them"),
        ({"from_s": 1.0}, "effects"),
    ],
)
def test_what_can_not_be_hidden_is_refused_in_one_line(hidden: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigurationError) as refused:
        world_settings({"preset": "catheter", "hidden": hidden})
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)
