"""What the simulated stage, load cell and gripper have in common."""

from forefeel.common.errors import DeviceError
from forefeel.slave.plant.world import SimulatedWorld


class SimulatedDevice:
    """One device of a simulated world, which several devices share.

    Raises:
        DeviceError: used while not open.
    """

    def __init__(self, world: SimulatedWorld) -> None:
        self._world = world
        self._opened = False

    def open(self) -> None:
        """Connects."""
        self._opened = True

    def close(self) -> None:
        """Lets the device go; idempotent."""
        self._opened = False

    def rearm(self) -> None:
        """A simulated device does not fail."""

    def _opened_world(self) -> SimulatedWorld:
        if not self._opened:
            raise DeviceError(f"{type(self).__name__}: used while closed, expected open() before")
        return self._world

    def _world_at(self, now_ns: int) -> SimulatedWorld:
        world = self._opened_world()
        world.advance(now_ns)
        return world
