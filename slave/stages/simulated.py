"""The stage of a simulated world."""

from forefeel.slave.plant.device import SimulatedDevice
from forefeel.slave.stages.port import StageReading, require_finite


class SimulatedStage(SimulatedDevice):
    """Stage port on a `SimulatedWorld`."""

    def command(self, position_m: float, velocity_m_s: float, now_ns: int) -> float:
        """Sets the setpoint; a number that is not finite is refused with `DeviceError`."""
        require_finite(position_m, velocity_m_s)
        return self._world_at(now_ns).set_target(position_m, velocity_m_s, now_ns)

    def hold(self, now_ns: int) -> None:
        """Decelerates to rest and holds, from the next step on."""
        self._opened_world().hold()

    def read(self, now_ns: int) -> StageReading:
        """The readback at `now_ns`."""
        return StageReading(*self._world_at(now_ns).stage_readback())
