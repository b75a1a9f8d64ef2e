"""A contact by an engine of others: its port, what is hidden beside it, its faults, MuJoCo's models."""

from collections.abc import Iterator, Sequence
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import yaml

from forefeel.common.errors import ConfigurationError, DeviceError
from forefeel.common.hardware import driver
from forefeel.common.hardware.driver import SLOTS, Driver, installed_driver
from forefeel.common.messages import ForceSample, InstrumentShape
from forefeel.common.recording.mcap_reader import Run
from forefeel.devices.mujoco.model import MujocoModel
from forefeel.devices.mujoco.settings import MujocoSettings
from forefeel.loopback.outcome import amber_lines
from forefeel.loopback.plan import LoopbackOptions, make_plan
from forefeel.loopback.virtual import VirtualLoopback
from forefeel.report.summary import summarise
from forefeel.slave.plant.foreign import WorldDriverSettings
from forefeel.slave.plant.settings import world_settings
from forefeel.slave.plant.world import SimulatedWorld
from tests.looped import looped
from tests.unit.model_samples import effect, mapping

MS = 1_000_000
STIFFNESS_N_M = 40.0


class SpringSettings(WorldDriverSettings):
    driver: Literal["spring"]
    breaks_at_m: float = 1.0
    points: int = 0
    friction_n: float = 0.0
    force_sign: Literal[1, -1] = 1


class Spring:
    """Steps of one integration step of our own world, so that both have the same force at the same time."""

    period_s = 2e-4

    def __init__(self, settings: SpringSettings) -> None:
        self._breaks_at_m, self._points = settings.breaks_at_m, settings.points
        self._friction_n, self._sign = settings.friction_n, settings.force_sign
        self._tip_m = 0.0
        if not self._breaks_at_m:
            raise ArithmeticError("it is\nbroken")

    def step(self, position_m: float, velocity_m_s: float) -> float:
        if position_m > self._breaks_at_m:
            raise ArithmeticError("it broke")
        self._tip_m = position_m
        rubs_n = self._friction_n * np.tanh(velocity_m_s / 1e-3)
        return self._sign * (rubs_n or STIFFNESS_N_M * position_m)

    def shape_m(self) -> Sequence[tuple[float, float, float]]:
        """A straight line with its tip at the carriage, 1 mm between two points."""
        return [(self._tip_m - 1e-3 * i, 2e-3, 3e-3) for i in range(self._points)][::-1]


SPRING = Driver(SpringSettings, f"{__name__}:Spring", "a spring")


@pytest.fixture(autouse=True)
def spring(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    groups = (f"forefeel.{slot}s" for slot in SLOTS if slot != "world")
    others = (entry for group in groups for entry in entry_points(group=group))
    found = EntryPoints([*others, EntryPoint("spring", f"{__name__}:SPRING", "forefeel.worlds")])
    monkeypatch.setattr(driver, "_installed", lambda: found)
    installed_driver.cache_clear()
    yield
    installed_driver.cache_clear()


def readings(mapping: dict[str, Any]) -> list[float]:
    """Load cell along 30 mm at 50 mm/s."""
    cell = {"noise_n": 0.0, "bias_n": 0.0, "drift_n_s": 0.0, "pushes_only": False}
    world = SimulatedWorld(world_settings({"load_cell": cell, **mapping}), 0)
    forces = []
    for tick in range(600):
        world.set_target(5e-5 * tick, 0.05, tick * MS)
        world.advance((tick + 1) * MS)
        forces.append(world.load_cell_reading().force_n)
    return forces


OURS = mapping(effect("mass_damper_spring", mass_kg=0.0, damping_n_s_m=0.0, stiffness_n_m=STIFFNESS_N_M))
RUBS = mapping(effect("coulomb_friction", force_n=0.1))


def test_a_spring_of_others_is_our_spring_and_what_is_hidden_acts_beside_it() -> None:
    hidden = {"effects": RUBS, "from_s": 0.3}
    theirs = readings({"world": {"driver": "spring"}, "hidden": hidden})
    assert theirs == pytest.approx(readings({"contact": OURS, "hidden": hidden}), abs=1e-9)
    assert theirs[-1] - readings({"world": {"driver": "spring"}})[-1] == pytest.approx(0.1, abs=1e-3)


def test_an_engine_that_fails_is_a_fault_of_the_device() -> None:
    with pytest.raises(DeviceError, match=r"^world spring: it broke$"):
        readings({"world": {"driver": "spring", "breaks_at_m": 0.01}})


def test_an_engine_that_can_not_be_made_is_refused() -> None:
    with pytest.raises(
        ConfigurationError, match=r"^world spring: can not be made of its settings: it is broken$"
    ):
        readings({"world": {"driver": "spring", "breaks_at_m": 0.0}})


def test_settings_of_a_world_are_checked_as_those_of_a_device() -> None:
    with pytest.raises(ConfigurationError, match=r"driver = 'sofa': expected one of 'spring'"):
        world_settings({"world": {"driver": "sofa"}})
    with pytest.raises(ConfigurationError, match="unknown key"):
        world_settings({"world": {"driver": "spring", "springs": 2}})
    again = world_settings(world_settings({"world": {"driver": "spring"}}).model_dump(mode="json"))
    assert isinstance(again.world, SpringSettings)


def loopback(tmp_path: Path, duration_s: float, **world: object) -> VirtualLoopback:
    """A run in virtual time, of strokes of 2 s."""
    simulation = {"preset": "guidewire", "world": {"driver": "spring", **world}}
    operator = {"insert_s": 0.9, "withdraw_s": 0.9, "dwell_s": 0.1}
    file = {"simulation": simulation, "limits": {"max_force_n": 0.4}, "operator": operator}
    (tmp_path / "spring.yaml").write_text(yaml.safe_dump(file))
    options = LoopbackOptions(world=str(tmp_path / "spring.yaml"), duration_s=duration_s)
    return looped(make_plan(options))


def shapes(tmp_path: Path, points: int, duration_s: float = 0.5) -> list[tuple[InstrumentShape, float]]:
    """Shapes, each with the readback of its moment."""
    loop = loopback(tmp_path, duration_s, points=points)
    at_m = {m.stamp_ns: m.position_m for _, m, _ in loop.messages if isinstance(m, ForceSample)}
    return [(m, at_m[m.stamp_ns]) for _, m, _ in loop.messages if isinstance(m, InstrumentShape)]


def test_shape_of_the_instrument_is_published_at_20_hz(tmp_path: Path) -> None:
    heard = shapes(tmp_path, 5, 2.0)
    assert {later.stamp_ns - m.stamp_ns for (m, _), (later, _) in pairwise(heard)} == {50 * MS}
    assert len(heard) in range(40, 50)
    inserted_m = heard[0][0].x_m[-1] - heard[0][1]
    assert [m.x_m[-1] for m, _ in heard] == pytest.approx([at_m + inserted_m for _, at_m in heard], abs=1e-4)
    assert len({m.x_m[-1] for m, _ in heard}) > 20
    newest, _ = heard[-1]
    assert np.diff(newest.x_m) == pytest.approx([1e-3] * 4)
    assert (newest.y_m, newest.z_m) == ((2e-3,) * 5, (3e-3,) * 5)


def test_shape_of_many_points_is_thinned_from_the_tip_on(tmp_path: Path) -> None:
    (newest, _), (few, _) = shapes(tmp_path, points=129)[-1], shapes(tmp_path, points=64)[-1]
    assert len(newest.x_m) == 43
    assert np.diff(newest.x_m) == pytest.approx([3e-3] * 42)
    assert newest.x_m[-1] == few.x_m[-1]
    assert len(few.x_m) == 64


def test_world_without_a_shape_publishes_none(tmp_path: Path) -> None:
    assert shapes(tmp_path, points=0) == []


@pytest.mark.parametrize(("force_n", "duration_s"), [(0.1, 2.0), (0.015, 8.0)])
def test_reversed_force_of_a_world_is_a_fault_that_the_report_says(
    tmp_path: Path, force_n: float, duration_s: float
) -> None:
    """One that shows in the first contact, and one that is too small for that."""
    loopback(tmp_path, duration_s, friction_n=force_n, force_sign=-1).write(tmp_path / "run.mcap")
    report = summarise(Run(tmp_path / "run.mcap"))
    (line,) = amber_lines(report)
    assert line.endswith("its sign is wrong; change simulation.world.force_sign.")
    assert line in report.notes
    assert report.stops == 1


def test_force_of_a_world_that_resists_is_none(tmp_path: Path) -> None:
    loopback(tmp_path, 8.0, friction_n=0.015).write(tmp_path / "run.mcap")
    report = summarise(Run(tmp_path / "run.mcap"))
    assert (amber_lines(report), report.stops) == ([], 0)
    assert report.armed_share == 1.0


MJCF = """
<mujoco>
  <option timestep="{step_s}" gravity="0 0 0"/>
  <worldbody>
    <body name="carriage">
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <joint name="slide" type="slide" axis="1 0 0"/>
      <body name="tip" pos="10 0 0">
        <inertial pos="0 0 0" mass="0.1" diaginertia="1 1 1"/>
        <joint name="spring" type="slide" axis="1 0 0" stiffness="50" damping="2"/>
        <geom type="sphere" size="1" solref="0.002 1"/>
      </body>
    </body>
    <geom type="box" pos="16 0 0" size="2 5 5"/>
  </worldbody>
  <tendon><fixed name="cable"><joint joint="spring" coef="1"/></fixed></tendon>
  <actuator><position name="winch" tendon="cable"/></actuator>
  <sensor><jointpos name="gap" joint="spring"/><jointpos name="at" joint="slide"/></sensor>
</mujoco>"""


def model(tmp_path: Path, step_s: float = 5e-4, **settings: object) -> MujocoModel:
    (tmp_path / "wall.xml").write_text(MJCF.format(step_s=step_s))
    given: dict[str, Any] = {"drive": "slide", "force": "gap", "force_sign": -1, "unit_m": 1e-3, **settings}
    return MujocoModel(MujocoSettings(driver="mujoco", model=tmp_path / "wall.xml", **given))


def test_a_model_in_millimetres_moves_as_the_carriage_and_says_its_sensor(tmp_path: Path) -> None:
    world = model(tmp_path, shape="carriage")
    path_m = np.concatenate([np.linspace(0.0, 4e-3, 800), np.full(400, 4e-3)])
    forces = [world.step(x, 5e-3 if x < 4e-3 else 0.0) for x in path_m.tolist()]
    assert forces[500] == pytest.approx(0.0, abs=1e-4)
    # the sphere stands at the wall, at 13 - 10 = 3 mm: the spring gives way by the rest
    assert forces[-1] == pytest.approx(1e-3, rel=0.05)  # the reading, 1 mm, times `unit_m`
    assert np.array(world.shape_m())[:, 0] == pytest.approx([4e-3, 13e-3], rel=0.02)


def test_a_body_that_is_pushed_through_a_wall_ends_it(tmp_path: Path) -> None:
    world = model(tmp_path, overlap_m=1e-5)
    with pytest.raises(FloatingPointError, match=r"bodies overlap by .* mm at .* s: no physics"):
        for tick in range(2000):
            world.step(1e-5 * tick, 1e-2)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"drive": "motor"}, "drive = 'motor'; expected an actuator or a joint of it"),
        ({"drive": "winch"}, "drive = 'winch'; expected an actuator or a joint of it"),
        ({"force": "cell"}, "force = 'cell'; expected one of gap, at"),
        ({"shape": "wire"}, "shape = 'wire'; expected one of world, carriage, tip"),
        ({"step_s": 7e-4}, "timestep = 0.0007; expected a whole part of 1 ms"),
    ],
)
def test_what_a_model_lacks_is_named(tmp_path: Path, settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message) as caught:
        model(tmp_path, **settings)
    assert str(caught.value).startswith(str(tmp_path / "wall.xml"))


def test_a_file_that_is_no_model_is_refused_in_a_line(tmp_path: Path) -> None:
    (tmp_path / "no.xml").write_text("<mujoco><nothing/></mujoco>")
    with pytest.raises(ConfigurationError, match="expected an MJCF model") as caught:
        MujocoModel(MujocoSettings(driver="mujoco", model=tmp_path / "no.xml", drive="a", force="b"))
    assert "\n" not in str(caught.value)
