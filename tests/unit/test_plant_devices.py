"""The load cell, the recorded load cell and the simulated devices."""

from math import nan

import pytest

from forefeel.common.clock import MonotonicClock
from forefeel.common.errors import DeviceError
from forefeel.common.messages import Grip
from forefeel.devices.simulated.driver import (
    SimulatedGripper,
    SimulatedLoadCell,
    SimulatedStage,
)
from forefeel.devices.simulated.recorded import RecordedLoadCell
from forefeel.slave.daemon import _devices
from forefeel.slave.gripper import Gripper
from forefeel.slave.load_cell import LoadCell, LoadCellReading
from forefeel.slave.plant.settings import LoadCellSettings, preset
from forefeel.slave.plant.world import PlantLoadCell, SimulatedWorld
from forefeel.slave.settings import SlaveAxisSettings
from forefeel.slave.stage import Stage

MS = 1_000_000
PERFECT = LoadCellSettings(full_scale_n=1.0, bits=16, filter_hz=200.0, noise_n=0.0, bias_n=0.0, drift_n_s=0.0)


def cell(**changes: float) -> PlantLoadCell:
    return PlantLoadCell(PERFECT.model_copy(update=changes), seed=1)


def settled(plant: PlantLoadCell, force_n: float, t: float = 0.0) -> LoadCellReading:
    plant.filtered.value = force_n
    plant.convert(t)
    return plant.reading


@pytest.mark.parametrize(
    ("force_n", "counts", "valid"),
    [
        (0.94, round(0.94 * 32767), True),
        (0.96, round(0.96 * 32767), False),
        (5.0, 32767, False),
        (-5.0, -32767, False),
    ],
)
def test_beyond_95_percent_of_full_scale_a_reading_is_invalid(
    force_n: float, counts: int, valid: bool
) -> None:
    reading = settled(cell(), force_n)
    assert (reading.raw_counts, reading.valid) == (counts, valid)


TIMES, FORCES = [0.0, 0.01, 0.02, 1.0, 1.05], [0.0, 0.1, 0.3, -0.2, -0.1]


@pytest.mark.parametrize(
    ("at_s", "force_n"), [(0.0, 0.0), (0.005, 0.05), (0.0175, 0.25), (0.02, 0.3), (1.0, -0.2), (1.025, -0.15)]
)
def test_a_recorded_force_is_interpolated_between_its_samples(at_s: float, force_n: float) -> None:
    (reading,) = RecordedLoadCell(TIMES, FORCES).read(123, at_s)
    assert reading.valid
    assert reading.force_n == pytest.approx(force_n, abs=1e-12)
    assert reading.raw_counts == round(force_n * 1e6)


@pytest.mark.parametrize("at_s", [None, nan, -0.001, 1.06, 0.021, 0.5, 0.999])
def test_there_is_no_force_outside_the_recording_nor_across_a_gap(at_s: float | None) -> None:
    assert RecordedLoadCell(TIMES, FORCES).read_at(at_s) == LoadCellReading(0.0, 0, False)


def test_three_devices_share_one_world() -> None:
    world = SimulatedWorld(preset("catheter"), 0)
    stage: Stage = SimulatedStage(world)
    load_cell: LoadCell = SimulatedLoadCell(world)
    gripper: Gripper = SimulatedGripper(world)
    for device in (stage, load_cell, gripper):
        device.open()
    assert stage.read(0).position_m == 0.0
    assert stage.command(0.03, 0.0, 0) == 0.03
    for tick in range(1, 600):
        stage.command(0.03, 0.0, tick * MS)
    assert stage.read(600 * MS).position_m == pytest.approx(0.03, abs=1e-5)
    loaded_n = load_cell.read(600 * MS, None)[-1].force_n
    assert gripper.set(Grip.OPEN, 600 * MS) is Grip.OPEN
    unloaded_n = load_cell.read(700 * MS, 3.0)[-1].force_n
    assert loaded_n > 0.1 > unloaded_n
    stage.command(0.0, 0.0, 700 * MS)
    stage.read(720 * MS)
    stage.hold(720 * MS)
    assert stage.read(900 * MS).velocity_m_s == 0.0


@pytest.mark.parametrize(("position_m", "velocity_m_s"), [(nan, 0.0), (0.0, float("inf"))])
def test_a_setpoint_that_is_not_finite_is_refused(position_m: float, velocity_m_s: float) -> None:
    stage = SimulatedStage(SimulatedWorld(preset("catheter"), 0))
    stage.open()
    with pytest.raises(DeviceError, match="expected finite numbers"):
        stage.command(position_m, velocity_m_s, 0)


def test_beside_real_devices_no_world_is_integrated() -> None:
    """What nobody sees must not cost the control loop a twentieth of a millisecond each tick."""
    axis = {"limits": {"max_force_n": 0.5}}
    cell = {"driver": "bota_serial", "port": "/dev/null", "full_scale_n": 10.0}
    stage = {"driver": "zaber_ascii", "port": "/dev/null", "microstep_m": 1e-7, "travel_m": [-0.01, 0.13]}
    clock = MonotonicClock()
    for devices, observed in (
        ({"stage": stage, "load_cell": cell}, False),
        ({"stage": stage}, True),
        ({"load_cell": cell}, True),
        ({}, True),
    ):
        made = _devices(SlaveAxisSettings.model_validate({**axis, **devices}), clock)
        assert isinstance(made.gripper, SimulatedGripper)
        assert made.gripper._world.observed is observed
