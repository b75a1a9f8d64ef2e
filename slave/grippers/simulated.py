"""The grippers that are no hardware: of a simulated world, and beside a real stage."""

from forefeel.common.messages import Grip
from forefeel.slave.plant.device import SimulatedDevice


class SimulatedGripper(SimulatedDevice):
    """Gripper port on a `SimulatedWorld`; acts at once."""

    def set(self, grip: Grip, now_ns: int) -> Grip:
        """Closes or opens the fixture at `now_ns`."""
        return self._world_at(now_ns).grip(grip)


class UnseenGripper(SimulatedDevice):
    """Gripper port on a world that nobody sees, for stage and load cell are real: it is not integrated."""

    def set(self, grip: Grip, now_ns: int) -> Grip:
        """The grip that was asked for."""
        del now_ns
        self._opened_world()
        return grip
