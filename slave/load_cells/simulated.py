"""The load cell of a simulated world."""

from math import inf

from forefeel.slave.load_cells.port import LoadCellReading
from forefeel.slave.plant.device import SimulatedDevice
from forefeel.slave.plant.world import SimulatedWorld


class SimulatedLoadCell(SimulatedDevice):
    """Load-cell port on a `SimulatedWorld`."""

    stale_s = inf

    def __init__(self, world: SimulatedWorld) -> None:
        super().__init__(world)
        self.full_scale_n = world.load_cell_full_scale_n

    def read(self, now_ns: int, recording_time_s: float | None) -> tuple[LoadCellReading]:
        """The newest conversion at `now_ns`."""
        return (self._world_at(now_ns).load_cell_reading(),)
