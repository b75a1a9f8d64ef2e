"""The gripper of a simulated world."""

from common.messages import Grip
from slave.plant.device import SimulatedDevice


class SimulatedGripper(SimulatedDevice):
    """Gripper port on a `SimulatedWorld`; acts at once."""

    def set(self, grip: Grip, now_ns: int) -> Grip:
        """Closes or opens the fixture at `now_ns`."""
        return self._world_at(now_ns).grip(grip)
