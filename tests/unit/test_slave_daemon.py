"""The slave's daemon when something fails at its start or its end: everything else is closed all the same."""

from collections.abc import Callable

import pytest

from forefeel.common.errors import DeviceError, RunError
from forefeel.slave import daemon
from forefeel.slave.devices import Devices
from tests.unit.failing import refusing
from tests.unit.rigs import Cell, FakeGripper, FakeLoadCell, FakeStage

AXES = ("insertion", "rotation")


SLOTS = ("stage", "gripper", "load_cell")


Opened = Callable[[], set[str]]


@pytest.fixture
def devices(monkeypatch: pytest.MonkeyPatch) -> dict[str, Devices]:
    """Fake devices of both axes of a cell, by axis."""
    fakes = {name: Devices(FakeStage(), FakeGripper(), FakeLoadCell()) for name in AXES}
    monkeypatch.setattr("forefeel.slave.daemon._devices", lambda axis, *_: fakes[axis.name])
    return fakes


@pytest.fixture
def opened(devices: dict[str, Devices]) -> Opened:
    """Gives the devices that are open."""
    named = {f"{axis} {slot}": getattr(devices[axis], slot) for axis in AXES for slot in SLOTS}
    return lambda: {name for name, device in named.items() if device.opened}


@pytest.mark.parametrize(
    ("device", "call"), [("gripper", "open"), ("load_cell", "open"), ("stage", "read"), ("", "Reports")]
)
def test_no_stage_stays_enabled_when_the_daemon_does_not_start(
    devices: dict[str, Devices], opened: Opened, monkeypatch: pytest.MonkeyPatch, device: str, call: str
) -> None:
    broken = getattr(devices["rotation"], device) if device else daemon
    monkeypatch.setattr(broken, call, refusing(RunError("silent")))
    with pytest.raises((DeviceError, RunError), match="silent"):
        Cell()
    assert not {name for name in opened() if "stage" in name}


def test_a_session_that_is_broken_keeps_no_device_open_and_nothing_from_the_event_log(opened: Opened) -> None:
    cell = Cell()
    for axis in cell.daemon.axes:
        axis.emergency_stop("pressed", "nurse")
    others = cell.network.session(cell.runtime.clock)  # whoever hears raises where it is put
    others.subscribe_all("forefeel", refusing(RunError("the session is closed")))
    with pytest.raises(RunError, match="the session is closed"):
        cell.close()
    assert opened() == set()
    assert cell.session.peers() == 0 and others.peers() == 0
    assert [noted["after"] for noted in cell.book.of("safety")] == ["estopped", "estopped"]
    assert [noted["by"] for noted in cell.book.of("emergency_stop")] == ["nurse", "nurse"]


@pytest.mark.parametrize("failing", SLOTS)
def test_a_device_that_does_not_close_keeps_no_other_one_open(
    devices: dict[str, Devices], opened: Opened, monkeypatch: pytest.MonkeyPatch, failing: str
) -> None:
    cell = Cell()
    assert len(opened()) == len(AXES) * len(SLOTS)
    monkeypatch.setattr(
        getattr(devices["insertion"], failing), "close", refusing(DeviceError("does not let go"))
    )
    with pytest.raises(DeviceError, match="does not let go"):
        cell.close()
    assert opened() == {f"insertion {failing}"}
    assert cell.session.peers() == 0
