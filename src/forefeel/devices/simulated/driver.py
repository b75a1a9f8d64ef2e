"""Stage, load cell and gripper of a simulated world."""

from math import inf

from forefeel.common.errors import DeviceError
from forefeel.common.messages import Grip
from forefeel.slave.load_cell import LoadCellReading
from forefeel.slave.plant.world import SimulatedWorld
from forefeel.slave.stage import StageReading, require_finite


class SimulatedDevice:
    """One device of a simulated world, which several devices share.

    Raises:
        DeviceError: used while not open.
    """

    def __init__(self, _settings: object, world: SimulatedWorld) -> None:
        self._world = world
        self._opened = False

    def open(self) -> None:
        self._opened = True

    def close(self) -> None:
        self._opened = False

    def rearm(self) -> None: ...

    def _opened_world(self) -> SimulatedWorld:
        if not self._opened:
            raise DeviceError(f"{type(self).__name__}: used while closed, expected open() before")
        return self._world

    def _world_at(self, now_ns: int) -> SimulatedWorld:
        world = self._opened_world()
        world.advance(now_ns)
        return world


class SimulatedStage(SimulatedDevice):
    """Stage port on a `SimulatedWorld`."""

    def __init__(self, _settings: object, world: SimulatedWorld) -> None:
        super().__init__(_settings, world)
        world.observed = True

    def command(self, position_m: float, velocity_m_s: float, now_ns: int) -> float:
        """Sets the setpoint; a number that is not finite is refused with `DeviceError`."""
        require_finite(position_m, velocity_m_s)
        return self._opened_world().set_target(position_m, velocity_m_s, now_ns)

    def hold(self, now_ns: int) -> None:
        self._opened_world().hold()

    def read(self, now_ns: int) -> StageReading:
        """Readback at now; the world begins with the load cell in the slave's first tick, not here."""
        world = self._opened_world()
        if world.start_ns is not None:
            world.advance(now_ns)
        return StageReading(*world.stage_readback())


class SimulatedLoadCell(SimulatedDevice):
    """Load-cell port on a `SimulatedWorld`."""

    stale_s = inf

    def __init__(self, _settings: object, world: SimulatedWorld) -> None:
        super().__init__(_settings, world)
        world.observed = True
        self.full_scale_n = world.load_cell_full_scale_n

    def read(self, now_ns: int, recording_time_s: float | None) -> tuple[LoadCellReading]:
        return (self._world_at(now_ns).load_cell_reading(),)


class SimulatedGripper(SimulatedDevice):
    """Gripper port on a `SimulatedWorld`; it acts at once.

    A world that neither a stage nor a load cell belongs to is not integrated.
    """

    def set(self, grip: Grip, now_ns: int) -> Grip:
        observed = self._opened_world().observed
        return self._world_at(now_ns).grip(grip) if observed else grip
