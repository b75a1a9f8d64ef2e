"""The slave's daemon with devices that fail when they are opened or closed: the others are closed all the same."""

from collections.abc import Callable

import pytest

from common.errors import DeviceError
from common.runtime.virtual import VirtualRuntime
from common.transport.memory import MemoryBus
from slave.daemon import SlaveDaemon
from slave.devices import Devices
from slave.settings import SlaveAxisSettings, SlaveSettings
from tests.unit.slave_cell import Book
from tests.unit.slave_rig import MS, FakeGripper, FakeLoadCell, FakeStage

AXES = ("insertion", "rotation")


class Bench:
    """A slave of two axes whose devices a test breaks."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.devices = {name: Devices(FakeStage(), FakeGripper(), FakeLoadCell()) for name in AXES}
        monkeypatch.setattr("slave.daemon._devices", lambda axis: self.devices[axis.name])
        self.runtime, self.book = VirtualRuntime(), Book()
        self.session = MemoryBus().session(self.runtime.clock)

    def start(self) -> SlaveDaemon:
        settings = SlaveSettings(axes=tuple(SlaveAxisSettings(name=name) for name in AXES))
        return SlaveDaemon(settings, self.session, self.runtime, lambda: 7, self.book)

    def enabled(self) -> list[bool]:
        stages = [devices.stage for devices in self.devices.values()]
        return [stage.opened for stage in stages if isinstance(stage, FakeStage)]


@pytest.fixture(name="bench")
def with_fake_devices(monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(monkeypatch)


def refusing(error: Exception) -> Callable[..., None]:
    def refuse(*_: object, **__: object) -> None:
        raise error

    return refuse


@pytest.mark.parametrize("failing", ["gripper", "load_cell"])
def test_no_stage_stays_enabled_when_another_device_does_not_open(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, failing: str
) -> None:
    device = getattr(bench.devices["rotation"], failing)
    monkeypatch.setattr(device, "open", refusing(DeviceError(f"{failing}: silent")))
    with pytest.raises(DeviceError, match=f"^{failing}: silent$"):
        bench.start()
    assert bench.enabled() == [False, False]


def test_no_stage_stays_enabled_that_does_not_say_where_it_is(bench: Bench) -> None:
    stage = bench.devices["insertion"].stage
    assert isinstance(stage, FakeStage)
    stage.broken = {"read"}
    with pytest.raises(DeviceError, match="read refused"):
        bench.start()
    assert bench.enabled() == [False, False]


def test_all_devices_are_open_while_the_daemon_lives_and_closed_after_it(bench: Bench) -> None:
    daemon = bench.start()
    assert bench.enabled() == [True, True]
    bench.runtime.run(5 * MS)
    daemon.close(bench.runtime.clock.now_ns())
    assert bench.enabled() == [False, False]
