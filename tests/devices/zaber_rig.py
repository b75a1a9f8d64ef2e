"""The Zaber driver on the emulated stage, in stepped time; the control loop ticks each millisecond."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from forefeel.common.hardware.link import LinkState
from forefeel.devices.zaber.driver import ZaberStage
from forefeel.devices.zaber.emulator import ZaberDevice, ZaberModel
from forefeel.devices.zaber.settings import ZaberSettings
from forefeel.testing import SerialLine, SteppedTime, stepped
from tests.emulators.damage import Faults, damaged

MODEL = ZaberModel(limits_m=(-0.005, 0.1), start_m=0.01)


def settings(**changes: object) -> ZaberSettings:
    usual: dict[str, object] = {
        "driver": "zaber_ascii",
        "port": "memory",
        "microstep_m": MODEL.microstep_m,
        "travel_m": (-0.002, 0.09),
    }
    return ZaberSettings.model_validate({**usual, **changes})


class Rig:
    """A stage, its driver, and the control loop: `loop` is called with the stamp while the link is ready."""

    def __init__(
        self, time: SteppedTime, device: ZaberDevice, chosen: ZaberSettings, faults: Faults | None, seed: int
    ) -> None:
        self.time, self.device, self.settings = time, device, chosen
        self.line = SerialLine(time, device, 115_200)
        self.wires = self.line.to_device, self.line.to_host = damaged(115_200, faults, seed)
        self.stage = ZaberStage(chosen, time)
        self.link = self.stage.link
        self.loop: Callable[[int], object] = lambda now_ns: None
        time.tick = self._tick

    def _tick(self, now_ns: int) -> None:
        if self.link.state is LinkState.READY:
            self.loop(now_ns)

    @property
    def now_ns(self) -> int:
        return self.time.now_ns()

    @property
    def x_m(self) -> float:
        return self.device.motion()[0]

    def at_rest(self) -> bool:
        return self.device.motion()[1] == 0.0

    def command(self, position_m: float, velocity_m_s: float = 0.0) -> float:
        return self.stage.command(position_m, velocity_m_s, self.now_ns)

    def state(self) -> LinkState:
        return self.link.state

    def until(self, state: LinkState) -> None:
        self.time.run_until(lambda: self.link.state is state)

    def until_fault(self) -> str:
        self.time.run_until(lambda: self.link.state is not LinkState.READY)
        return str(self.link.inhibited)

    def moves(self, since_s: float = 0.0) -> list[bytes]:
        """Lines that move the stage."""
        lines = [line for t, data in self.line.sent if t >= since_s for line in data.splitlines()]
        return [line for line in lines if b" move" in line or b" home" in line]


@contextmanager
def rigged(
    model: ZaberModel = MODEL,
    faults: Faults | None = None,
    seed: int = 0,
    opened: bool = True,
    **changes: object,
) -> Iterator[Rig]:
    with stepped() as time:
        rig = Rig(time, ZaberDevice(model), settings(**changes), faults, seed)
        try:
            if opened:
                rig.stage.open()
            yield rig
        finally:
            rig.stage.close()
