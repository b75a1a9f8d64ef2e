"""The Zaber driver on the emulated stage, in one thread and virtual time.

Bytes take their time on the wire; the control loop ticks each millisecond.
"""

from collections.abc import Callable, Iterator

from forefeel.common.clock import VirtualClock
from forefeel.common.errors import DeviceError
from forefeel.common.hardware.link import LinkState
from forefeel.devices.emulation.wire import Faults, Wire
from forefeel.devices.shared.conversation import Conversation
from forefeel.devices.shared.settings import SerialSettings
from forefeel.devices.zaber.driver import ZaberStage
from forefeel.devices.zaber.emulator import ZaberDevice, ZaberModel
from forefeel.devices.zaber.settings import ZaberSettings

MODEL = ZaberModel(limits_m=(-0.005, 0.1), start_m=0.01)
_TICK_NS = 1_000_000
_WAIT_TICKS = 20


def settings(**changes: object) -> ZaberSettings:
    usual: dict[str, object] = {
        "driver": "zaber_ascii",
        "port": "memory",
        "microstep_m": MODEL.microstep_m,
        "travel_m": (-0.002, 0.09),
    }
    return ZaberSettings.model_validate({**usual, **changes})


class MemoryStream:
    """A serial port of a device in this process. While it is read time goes on."""

    def __init__(self, rig: "Rig") -> None:
        self._rig = rig

    def read(self) -> bytes:
        for _ in range(_WAIT_TICKS):
            self._rig.pass_time(_TICK_NS)
            if found := self._rig.arrived():
                return found
        return b""

    def write(self, data: bytes) -> None:
        self._rig.send(data)

    def close(self) -> None:
        self._rig.opened -= 1


class Rig:
    """`script` is a generator: between its yields is one round of the driver's thread each. It ends the run.

    Attributes:
        tick: called each millisecond with the stamp, as the control loop would be.
        sent: what the driver wrote, with its time in s.
    """

    def __init__(
        self,
        model: ZaberModel = MODEL,
        faults: str = "",
        seed: int = 0,
        baud: int = 115_200,
        **changes: object,
    ) -> None:
        self.clock = VirtualClock(1_000_000_000)
        self.device = ZaberDevice(model)
        self.device_answers = True
        self.plugged = True
        self.opened = 0
        self.sent: list[tuple[float, bytes]] = []
        self.wires = [Wire(baud, Faults.parse(faults), f"{way} {seed}") for way in ("in", "out")]
        self.settings = settings(**changes)
        self.stage = ZaberStage(self.settings, self.clock, self.open_stream)
        self.tick: Callable[[int], object] = lambda now_ns: None

    @property
    def t_s(self) -> float:
        return (self.clock.now_ns() - 1_000_000_000) * 1e-9

    @property
    def x_m(self) -> float:
        return self.device.motion()[0]

    def at_rest(self) -> bool:
        return self.device.motion()[1] == 0.0

    def state(self) -> LinkState:
        return self.stage.link.state

    def moves(self, since_s: float = 0.0) -> list[tuple[float, bytes]]:
        """Lines that move the stage."""
        return [
            (t, line)
            for t, data in self.sent
            for line in data.splitlines()
            if t >= since_s and (b" move" in line or b" home" in line)
        ]

    def open_stream(self, _: SerialSettings) -> MemoryStream:
        if not self.plugged:
            raise DeviceError("memory: no such port")
        self.opened += 1
        return MemoryStream(self)

    def send(self, data: bytes) -> None:
        if not self.plugged:
            raise DeviceError("memory: gone while writing")
        self.sent.append((self.t_s, data))
        self.wires[0].send(data, self.t_s)

    def pass_time(self, duration_ns: int) -> None:
        """The device lives, the control loop ticks."""
        self.clock.set_ns(self.clock.now_ns() + duration_ns)
        data = self.wires[0].arrived(self.t_s)
        if data and self.device_answers:
            self.device.receive(data, self.t_s)
        sent = self.device.advance(self.t_s)
        if self.device_answers:
            self.wires[1].send(sent, self.t_s)
        if self.stage.link.state is LinkState.READY:
            self.tick(self.clock.now_ns())

    def arrived(self) -> bytes:
        if not self.plugged:
            raise DeviceError("memory: gone while reading")
        return self.wires[1].arrived(self.t_s)

    def rest(self, seconds: float) -> None:
        """Time without a host."""
        for _ in range(round(seconds * 1000)):
            self.pass_time(_TICK_NS)

    def run(self, script: Iterator[None]) -> "Rig":
        """The driver's thread, to the end of the script; a first handshake that fails is raised."""
        conversation = _Scripted(self, script)
        conversation._run()
        self.stage.link.close()
        if conversation.failed is not None:
            raise conversation.failed
        if isinstance(conversation._first, DeviceError):
            raise conversation._first
        return self


class _Scripted(Conversation):
    def __init__(self, rig: Rig, script: Iterator[None]) -> None:
        super().__init__(rig.stage.link, rig.stage._converse)
        self._rig, self._script = rig, script
        self._begun = False
        self.failed: BaseException | None = None

    @property
    def stopping(self) -> bool:
        """Asked before the handshake, and once a round after it."""
        if self._begun and not self._stopping.is_set():
            self._advance()
        self._begun = True
        return self._stopping.is_set()

    def _advance(self) -> None:
        try:
            next(self._script)
        except StopIteration:
            self._stopping.set()
        except BaseException as error:  # noqa: BLE001 - of the test; the conversation would take it for a fault
            self.failed = error
            self._stopping.set()

    def pause(self, seconds: float) -> None:
        self._rig.rest(seconds)


def for_seconds(rig: Rig, seconds: float) -> Iterator[None]:
    """Rounds for that long."""
    end_s = rig.t_s + seconds
    while rig.t_s < end_s:
        yield
