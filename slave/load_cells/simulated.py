"""The load cell of a simulated world."""

from math import inf

from slave.load_cells.port import LoadCellReading
from slave.plant.device import SimulatedDevice


class SimulatedLoadCell(SimulatedDevice):
    """Load-cell port on a `SimulatedWorld`."""

    stale_s = inf

    def read(self, now_ns: int, recording_time_s: float | None) -> tuple[LoadCellReading]:
        """The newest conversion at `now_ns`."""
        return (self._world_at(now_ns).load_cell_reading(),)
