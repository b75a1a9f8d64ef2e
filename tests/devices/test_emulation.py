"""What stands around an emulated device: the vessel, the force on a socket, orders on stdin."""

import sys
from pathlib import Path

import pytest

from forefeel.common.errors import ConfigurationError
from forefeel.devices.emulation.bench import Load
from forefeel.devices.emulation.contact import ContactSimulation, ForceReceiver, ForceSender
from forefeel.emulate.run import obey, obey_stdin
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


def test_a_force_link_takes_the_place_of_a_socket_and_of_no_other_file(tmp_path: Path) -> None:
    path = tmp_path / "notes"
    path.write_text("mine")
    for wrong in path, tmp_path / "none" / "feel":
        with pytest.raises(ConfigurationError, match=f"--feel {wrong}: .*; expected a free path"):
            ForceReceiver(wrong)
    assert path.read_text() == "mine"
    left = ForceReceiver(tmp_path / "feel")
    ForceReceiver(tmp_path / "feel").close()
    left.close()


class Device:
    faults = ("unplug", "plug")

    def __init__(self) -> None:
        self.provoked: list[str] = []

    def step(self) -> None: ...

    def provoke(self, fault: str) -> None:
        self.provoked.append(fault)


def test_orders_on_stdin_are_obeyed_past_wrong_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    device, load = Device(), Load()
    (tmp_path / "orders").write_text("load 1.5\nunplug\n\nwarp\nplug")
    with (tmp_path / "orders").open() as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        for _ in range(3):
            obey_stdin(device, load)
    assert (load.force_n, device.provoked) == (1.5, ["unplug", "plug"])
    assert len(capsys.readouterr().err.splitlines()) == 1
    monkeypatch.setattr(sys, "stdin", None)
    obey_stdin(device, load)


@pytest.mark.parametrize("line", ["warp", "load", "load 1 2", "load nan", "load 1e9", "unplug now"])
def test_wrong_order_is_refused_and_changes_nothing(line: str) -> None:
    device, load = Device(), Load()
    with pytest.raises(ConfigurationError, match="load N, unplug, plug"):
        obey(line, device, load)
    assert (load.force_n, device.provoked) == (0.0, [])


def test_stage_has_no_load() -> None:
    with pytest.raises(ConfigurationError, match="expected unplug"):
        obey("load 1", Device(), None)
