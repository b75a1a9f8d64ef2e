"""The slave's daemon when something fails at its start or its end: everything else is closed all the same."""

import pytest

from forefeel.common.errors import DeviceError, RunError
from forefeel.slave import daemon
from forefeel.slave.devices import Devices
from tests.unit.failing import refusing
from tests.unit.rigs import Cell, FakeGripper, FakeLoadCell, FakeStage

AXES = ("insertion", "rotation")


@pytest.fixture
def devices(monkeypatch: pytest.MonkeyPatch) -> dict[str, Devices]:
    """Fake devices of both axes of a cell, by axis."""
    fakes = {name: Devices(FakeStage(), FakeGripper(), FakeLoadCell()) for name in AXES}
    monkeypatch.setattr("forefeel.slave.daemon._devices", lambda axis, *_: fakes[axis.name])
    return fakes


def enabled(devices: dict[str, Devices]) -> list[bool]:
    stages = [of_axis.stage for of_axis in devices.values()]
    return [stage.opened for stage in stages if isinstance(stage, FakeStage)]


@pytest.mark.parametrize(
    ("device", "call"), [("gripper", "open"), ("load_cell", "open"), ("stage", "read"), ("", "Reports")]
)
def test_no_stage_stays_enabled_when_the_daemon_does_not_start(
    devices: dict[str, Devices], monkeypatch: pytest.MonkeyPatch, device: str, call: str
) -> None:
    broken = getattr(devices["rotation"], device) if device else daemon
    monkeypatch.setattr(broken, call, refusing(RunError("silent")))
    with pytest.raises((DeviceError, RunError), match="silent"):
        Cell()
    assert enabled(devices) == [False, False]


def test_all_devices_are_open_while_the_daemon_lives_and_closed_after_it(devices: dict[str, Devices]) -> None:
    cell = Cell()
    assert enabled(devices) == [True, True]
    cell.close()
    assert enabled(devices) == [False, False]


def test_a_session_that_is_broken_keeps_no_device_open_and_nothing_from_the_event_log(
    devices: dict[str, Devices],
) -> None:
    cell = Cell()
    for axis in cell.daemon.axes:
        axis.emergency_stop("pressed", "nurse")
    others = cell.network.session(cell.runtime.clock)  # whoever hears raises where it is put
    others.subscribe_all("forefeel", refusing(RunError("the session is closed")))
    with pytest.raises(RunError, match="the session is closed"):
        cell.close()
    assert enabled(devices) == [False, False]
    assert cell.session.peers() == 0 and others.peers() == 0
    assert [noted["after"] for noted in cell.book.of("safety")] == ["estopped", "estopped"]
    assert [noted["by"] for noted in cell.book.of("emergency_stop")] == ["nurse", "nurse"]


@pytest.mark.parametrize("failing", ["stage", "gripper", "load_cell"])
def test_a_device_that_does_not_close_keeps_no_other_one_open(
    devices: dict[str, Devices], monkeypatch: pytest.MonkeyPatch, failing: str
) -> None:
    cell, closed = Cell(), list[str]()
    for name in AXES:
        for device in ("stage", "gripper", "load_cell"):
            monkeypatch.setattr(
                getattr(devices[name], device), "close", lambda it=f"{name} {device}": closed.append(it)
            )
    broken = getattr(devices["insertion"], failing)
    monkeypatch.setattr(broken, "close", refusing(DeviceError("does not let go")))
    with pytest.raises(DeviceError, match="does not let go"):
        cell.close()
    every = {f"{name} {device}" for name in AXES for device in ("stage", "gripper", "load_cell")}
    assert set(closed) == every - {f"insertion {failing}"}
    assert cell.session.peers() == 0
