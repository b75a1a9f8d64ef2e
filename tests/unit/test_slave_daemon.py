"""The slave's daemon when something fails at its start or its end: everything else is closed all the same."""

import pytest

from forefeel.common.errors import DeviceError, RunError
from forefeel.common.messages import SafetyState
from forefeel.common.runtime.virtual import VirtualRuntime
from forefeel.common.transport.memory import MemoryBus
from forefeel.slave import daemon
from forefeel.slave.daemon import SlaveDaemon
from forefeel.slave.devices import Devices
from forefeel.slave.settings import SlaveAxisSettings, SlaveSettings
from tests.unit.failing import refusing
from tests.unit.slave_cell import Book
from tests.unit.slave_rig import MS, FakeGripper, FakeLoadCell, FakeStage

AXES = ("insertion", "rotation")


class Bench:
    """A slave of two axes whose devices a test breaks."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.devices = {name: Devices(FakeStage(), FakeGripper(), FakeLoadCell()) for name in AXES}
        monkeypatch.setattr("forefeel.slave.daemon._devices", lambda axis, _: self.devices[axis.name])
        self.runtime, self.book = VirtualRuntime(), Book()
        self.network = MemoryBus()
        self.session = self.network.session(self.runtime.clock)

    def start(self) -> SlaveDaemon:
        settings = SlaveSettings(axes=tuple(SlaveAxisSettings(name=name) for name in AXES))
        return SlaveDaemon(settings, self.session, self.runtime, lambda: 7, self.book)

    def enabled(self) -> list[bool]:
        stages = [devices.stage for devices in self.devices.values()]
        return [stage.opened for stage in stages if isinstance(stage, FakeStage)]


@pytest.fixture(name="bench")
def with_fake_devices(monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(monkeypatch)


@pytest.mark.parametrize(
    ("device", "call"), [("gripper", "open"), ("load_cell", "open"), ("stage", "read"), ("", "Reports")]
)
def test_no_stage_stays_enabled_when_the_daemon_does_not_start(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, device: str, call: str
) -> None:
    broken = getattr(bench.devices["rotation"], device) if device else daemon
    monkeypatch.setattr(broken, call, refusing(RunError("silent")))
    with pytest.raises((DeviceError, RunError), match="silent"):
        bench.start()
    assert bench.enabled() == [False, False]


def test_all_devices_are_open_while_the_daemon_lives_and_closed_after_it(bench: Bench) -> None:
    started = bench.start()
    assert bench.enabled() == [True, True]
    bench.runtime.run(5 * MS)
    started.close(bench.runtime.clock.now_ns())
    assert bench.enabled() == [False, False]


def test_a_session_that_is_broken_keeps_no_device_open_and_nothing_from_the_event_log(bench: Bench) -> None:
    started = bench.start()
    bench.runtime.run(5 * MS)
    for axis in started.axes:
        axis.emergency_stop("pressed", "nurse")
    others = bench.network.session(bench.runtime.clock)  # whoever hears raises where it is put
    others.subscribe_all("forefeel", refusing(RunError("the session is closed")))
    with pytest.raises(RunError, match="the session is closed"):
        started.close(bench.runtime.clock.now_ns())
    assert bench.enabled() == [False, False]
    assert bench.session.peers() == 0 and others.peers() == 0
    assert [noted["after"] for noted in bench.book.of("safety")] == ["estopped", "estopped"]
    assert [noted["by"] for noted in bench.book.of("emergency_stop")] == ["nurse", "nurse"]


@pytest.mark.parametrize("failing", ["stage", "gripper", "load_cell"])
def test_a_device_that_does_not_close_keeps_no_other_one_open(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, failing: str
) -> None:
    started, closed = bench.start(), list[str]()
    for name in AXES:
        for device in ("stage", "gripper", "load_cell"):
            monkeypatch.setattr(
                getattr(bench.devices[name], device), "close", lambda it=f"{name} {device}": closed.append(it)
            )
    broken = getattr(bench.devices["insertion"], failing)
    monkeypatch.setattr(broken, "close", refusing(DeviceError("does not let go")))
    with pytest.raises(DeviceError, match="does not let go"):
        started.close(bench.runtime.clock.now_ns())
    every = {f"{name} {device}" for name in AXES for device in ("stage", "gripper", "load_cell")}
    assert set(closed) == every - {f"insertion {failing}"}
    assert bench.session.peers() == 0


FAULT, STOPPED = SafetyState.FAULT, SafetyState.ESTOPPED
