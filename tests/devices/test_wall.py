"""The vessel in front of an emulated stage, and the emulated load cell that feels it."""

from pathlib import Path

import pytest

from forefeel.devices.emulation.contact import ContactSimulation, ForceReceiver, ForceSender
from forefeel.slave.plant.settings import world_settings

SPRING = {
    "contact": {
        "schema": "forefeel.model/1",
        "name": "spring",
        "effects": [
            {
                "effect": "mass_damper_spring",
                "parameters": {"mass_kg": 0.02, "damping_n_s_m": 0.5, "stiffness_n_m": 30.0},
            }
        ],
    },
    "fixture": {"inserted_m": 0.0},
}


def test_the_wall_answers_the_motion_of_the_stage() -> None:
    wall = ContactSimulation(world_settings(SPRING))
    speed, rate = 0.02, 1.0
    for step in range(1, 2001):
        t = step * 1e-3
        wall.moved(t, speed * t, speed, rate)
    assert wall.force_n == pytest.approx(0.02 * rate + 0.5 * speed + 30.0 * speed * 2.0, rel=1e-6)


def test_the_cell_feels_the_newest_force_and_outlives_the_stage(tmp_path: Path) -> None:
    path = tmp_path / "feel"
    early = ForceSender(path)
    early.send(9.0)  # nobody there yet: nothing happens
    cell = ForceReceiver(path)
    assert cell.newest_n() == 0.0
    for force_n in (0.1, 0.2, -0.3):
        early.send(force_n)
    assert cell.newest_n() == -0.3
    early.close()
    assert cell.newest_n() == -0.3
    cell.close()
    assert not path.exists()
