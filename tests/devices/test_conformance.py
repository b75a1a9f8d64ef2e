"""The conformance checks find drivers that break their port."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from math import isnan, nan
from typing import Any, Literal

import pytest

from forefeel.common.errors import DeviceError
from forefeel.common.hardware.driver import Driver, DriverSettings, InstalledDriver, Slot
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.conformance import checks
from forefeel.conformance.checks import BrokenError, DriverUnderTest, NotTested
from forefeel.slave.load_cell import LoadCellReading
from forefeel.slave.stage import StageReading
from tests.devices.fake_devices import SteppedClock

MS = 1_000_000


class Obeying(DriverSettings):
    driver: Literal["obeying"] = "obeying"
    rate_hz: float = 100.0


class Device:
    """A device that keeps its port; tests replace single methods."""

    stale_s = 0.05

    def __init__(self, clock: SteppedClock) -> None:
        self.clock, self.link = clock, DeviceLink("obeying")
        self.broken: str | None = None
        self.position_m, self.target_m, self.told_ns = 0.0, 0.0, 0
        self.load_n, self.valid, self.newest_ns = 0.0, True, 0
        self.count = 0

    def open(self) -> None:
        self.link.begin()
        for step in (LinkState.OPEN, LinkState.IDENTIFIED, LinkState.CONFIGURED, LinkState.READY):
            self.link.advance(step)

    def close(self) -> None:
        self.link.close()

    def rearm(self) -> None:
        if self.broken is None and self.link.inhibited is not None:
            self.link.begin()
            self.open()

    def require_ready(self) -> None:
        if self.broken is not None and self.link.inhibited is None:
            self.link.fault(self.broken)
        self.link.require_ready()

    def command(self, position_m: float, velocity_m_s: float, now_ns: int) -> float:
        if isnan(position_m):
            raise DeviceError("a setpoint that is no number")
        self.position_m = position_m
        return position_m

    def render(self, force_n: float, now_ns: int) -> float:
        return force_n


class Stage(Device):
    def read(self, now_ns: int) -> StageReading:
        self.require_ready()
        return StageReading(self.position_m, 0.0)


class Cell(Device):
    def read(self, now_ns: int, recording_time_s: float | None) -> Sequence[LoadCellReading]:
        self.require_ready()
        found = []
        while (self.count + 1) * 10 * MS <= now_ns:
            self.count += 1
            found.append(LoadCellReading(self.load_n, 0, self.valid, self.count * 10 * MS))
        return found


class Emulator:
    """Tells the device what happens to it."""

    faults = "stuck", "overrange"

    def __init__(self, device: Device) -> None:
        self.device, self.missing, self.heeded = device, Obeying(), True

    def unplug(self) -> None:
        self.device.broken = "gone" if self.heeded else None

    def plug(self) -> None:
        self.device.broken = None

    def order(self, line: str) -> None:
        word, _, number = line.partition(" ")
        if word == "load":
            self.device.load_n = float(number)
        elif self.heeded:
            self.device.valid = word == "free"

    def frozen(self) -> AbstractContextManager[None]:
        self.unplug()
        return _Frozen(self)


class _Frozen(nullcontext[None]):
    def __init__(self, emulator: Emulator) -> None:
        super().__init__()
        self._emulator = emulator

    def __exit__(self, *_: object) -> None:
        self._emulator.plug()


def bench(
    slot: Slot, monkeypatch: pytest.MonkeyPatch, emulated: bool = True, moves: bool = True
) -> tuple[DriverUnderTest, Any, Emulator]:
    clock = SteppedClock()
    device: Device = Cell(clock) if slot == "load_cell" else Stage(clock)
    emulator = Emulator(device)
    driver = InstalledDriver(
        slot, "obeying", "elsewhere", "1.0", Driver(Obeying, "nowhere:Nothing", "a device")
    )
    made: Any = DriverUnderTest(driver, Obeying(), emulator if emulated else None, moves, clock)  # type: ignore[arg-type]
    monkeypatch.setattr(DriverUnderTest, "made", lambda self, settings=None: device)
    return made, device, emulator


@pytest.mark.parametrize(
    ("slot", "check"),
    [
        ("stage", checks.opens), ("stage", checks.reads), ("stage", checks.comes_to_rest),
        ("stage", checks.freezes), ("stage", checks.unplugs), ("load_cell", checks.reads),
        ("load_cell", checks.measures), ("load_cell", checks.distrusts), ("load_cell", checks.unplugs),
        ("handle", checks.renders),
    ],
)  # fmt: skip
def test_a_device_that_keeps_its_port_passes(
    slot: Slot, check: Callable[[DriverUnderTest], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    made, _, _ = bench(slot, monkeypatch)
    assert check(made)


def test_a_cable_that_nobody_misses_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    made, _, emulator = bench("stage", monkeypatch)
    emulator.heeded = False
    with pytest.raises(BrokenError, match="a cable that is pulled was not noticed"):
        checks.unplugs(made)
    with pytest.raises(BrokenError, match="a device that is frozen was not noticed"):
        checks.freezes(made)


def test_a_fault_that_heals_by_itself_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    made, device, _ = bench("stage", monkeypatch)

    def fault_and_go_on(reason: str) -> None:
        device.link.begin()

    device.link.fault = fault_and_go_on
    with pytest.raises(BrokenError, match="the link is not inhibited"):
        checks.unplugs(made)


def test_a_device_that_never_comes_back_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    made, device, _ = bench("stage", monkeypatch)
    device.rearm = lambda: None
    with pytest.raises(BrokenError, match="not served again within"):
        checks.unplugs(made)


def test_a_stage_that_creeps_or_does_not_follow_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    made, device, _ = bench("stage", monkeypatch)
    read = device.read

    def creeping(now_ns: int) -> StageReading:
        device.position_m += 2e-7
        found: StageReading = read(now_ns)
        return found

    device.read = creeping
    with pytest.raises(BrokenError, match="still moved"):
        checks.comes_to_rest(made)
    device.read, device.command = read, lambda *_: 0.0
    with pytest.raises(BrokenError, match=r"moved 0\.000 mm; expected 1 mm"):
        checks.comes_to_rest(made)


def test_a_real_stage_moves_only_when_it_may(monkeypatch: pytest.MonkeyPatch) -> None:
    made, _, _ = bench("stage", monkeypatch, emulated=False, moves=False)
    for check in (checks.comes_to_rest, checks.freezes):
        with pytest.raises(NotTested):
            check(made)


def test_a_position_that_is_no_number_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    made, device, _ = bench("stage", monkeypatch)
    device.position_m = nan
    with pytest.raises(BrokenError, match="no number"):
        checks.reads(made)


def test_a_cell_that_repeats_a_reading_or_has_another_rate_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    made, device, _ = bench("load_cell", monkeypatch)
    read = device.read
    device.read = lambda *when: [*read(*when)] * 2
    with pytest.raises(BrokenError, match="expected each once"):
        checks.reads(made)
    device.read = lambda *when: read(*when)[::2]
    device.count = 0
    monkeypatch.setattr(Obeying, "rate_hz", 130.0, raising=False)
    made.settings.__dict__["rate_hz"] = 130.0
    with pytest.raises(BrokenError, match="readings per second; expected 130"):
        checks.reads(made)


def test_a_cell_of_another_scale_or_that_believes_a_fault_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    made, device, emulator = bench("load_cell", monkeypatch)
    emulator.heeded = False
    with pytest.raises(BrokenError, match="stuck: readings are still believed"):
        checks.distrusts(made)
    read = device.read
    device.read = lambda *when: [each._replace(force_n=-each.force_n) for each in read(*when)]
    with pytest.raises(BrokenError, match=r"-1\.000 N read under a load of 1 N"):
        checks.measures(made)


def test_a_handle_that_gives_more_than_asked_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    made, device, _ = bench("handle", monkeypatch)
    device.render = lambda force_n, now_ns: 2.0 * force_n
    with pytest.raises(BrokenError, match=r"0\.6 N applied where 0\.3 N were asked for"):
        checks.renders(made)


def test_what_can_not_work_must_be_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    made, device, _ = bench("stage", monkeypatch)
    with pytest.raises(BrokenError, match="a port that is not there was not refused"):
        checks.refuses(made)  # the device of this test opens whatever its settings say
    device.close()
    device.command = lambda *_: 0.0
    with pytest.raises(BrokenError, match="a setpoint of nan was not refused"):
        checks.refuses(made)
