"""What a driver has to keep, one check for each promise of its port.

A check is a function of a `DriverUnderTest`. It returns what was measured, and raises `BrokenError` with what
was expected instead. A check that can not be made here raises `NotTested`.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite
from typing import Any

from forefeel.common.clock import MonotonicClock
from forefeel.common.errors import ForefeelError
from forefeel.common.hardware.driver import DriverSettings, InstalledDriver
from forefeel.conformance.emulators import EmulatedBench

_TICK_NS = 1_000_000  # ns, the control and haptic loops' period
_NOTICED_S = 1.0  # s until a silent device is a fault; chosen, not measured: a person still waits for it
_SILENT_S = 0.2  # s without a reading that is believed, after which a cell counts as lost
_UNBELIEVED = "no reading is believed"
_STUCK_S = 3.0  # s until repeated readings are not believed; `StuckWatch` needs 1 s
_BACK_S = 15.0  # s until a device that was plugged in again can be re-armed; a CAN adapter takes 3 s
_READ_S = 1.0  # s, span over which readings are counted
_RATE_SHARE = 0.2  # of the rate in the settings, how far the measured one may be off
_MOVE_M = 0.001  # m, distance of the test motion
_SPEED_M_S = 0.005  # m/s, its speed: as slow as a hand
_REACHED_M = 0.0002  # m, how near the stage must come
_UNDER_WAY_S = 0.1  # s, what may be under way when the setpoints end; the lead of `zaber_ascii` is 0.06 s
_REST_S = 0.5  # s from the last setpoint until the stage must stand
_RESTING_M = 2e-5  # m, how far a stage at rest may be read to move in 0.2 s
_LOAD_N = 1.0  # N, hung on an emulated cell
_LOAD_SHARE = 0.05  # of the load, how far the reading may be off
_RENDERED_N = 0.3  # N, asked of a handle


class BrokenError(Exception):
    """The driver breaks a promise of its port."""


class NotTested(Exception):  # noqa: N818 - no error
    """The bench can not make this check."""


@dataclass(frozen=True)
class DriverUnderTest:
    """A driver and what it talks to. `emulated`: None on a real device. `moves`: a real stage may move."""

    driver: InstalledDriver
    settings: DriverSettings
    emulated: EmulatedBench | None
    moves: bool
    clock: MonotonicClock

    def made(self, settings: DriverSettings | None = None) -> Any:  # noqa: ANN401 - the port of its slot
        """The device, not opened."""
        return self.driver.make(settings or self.settings, self.clock)

    @contextmanager
    def opened(self) -> Iterator[Any]:
        """The device, open within the block."""
        device = self.made()
        try:
            device.open()
            yield device
        finally:
            device.close()

    def emulator(self) -> EmulatedBench:
        """The emulator. Raises NotTested on a real device."""
        if self.emulated is None:
            raise NotTested("needs the driver's emulator")
        return self.emulated

    def read(self, device: Any) -> Any:  # noqa: ANN401 - a reading, or those of a load cell
        """What the loop does at each tick."""
        now_ns = self.clock.now_ns()
        return device.read(now_ns, None) if self.driver.slot == "load_cell" else device.read(now_ns)

    def ticks(self, seconds: float) -> Iterator[int]:
        """Stamps of a loop that runs for that time."""
        start_ns = now_ns = self.clock.now_ns()
        while now_ns - start_ns < seconds * 1e9:
            yield now_ns
            self.clock.sleep_until_ns(now_ns + _TICK_NS)
            now_ns = self.clock.now_ns()

    def until_it_fails(self, device: Any, what: str) -> str:  # noqa: ANN401
        """Reads until the driver notices: `read` raises, or a load cell gives nothing that is believed."""
        start_ns = newest_ns = self.clock.now_ns()
        stale_s = getattr(device, "stale_s", 0.0)
        for now_ns in self.ticks(
            max(_NOTICED_S + stale_s, _STUCK_S if self.driver.slot == "load_cell" else 0.0)
        ):
            try:
                found = self.read(device)
            except ForefeelError as error:
                return f"after {(self.clock.now_ns() - start_ns) * 1e-6:.0f} ms: {error}"
            if self.driver.slot != "load_cell":
                continue
            newest_ns = max([newest_ns, *(reading.stamp_ns or now_ns for reading in found if reading.valid)])
            if now_ns - newest_ns > max(stale_s, _SILENT_S) * 1e9:
                return f"{_UNBELIEVED} after {(now_ns - start_ns) * 1e-6:.0f} ms"
        raise BrokenError(f"{what} was not noticed; expected DeviceError from read within {_NOTICED_S:g} s")


def opens(bench: DriverUnderTest) -> str:
    """`open` connects and identifies, `close` may be called twice."""
    device = bench.made()
    start_ns = bench.clock.now_ns()
    device.open()
    device.close()
    device.close()
    return f"{device.link.identity or 'no identity'} within {(bench.clock.now_ns() - start_ns) * 1e-9:.2f} s"


def reads(bench: DriverUnderTest) -> str:
    """`read` never waits; a load cell gives each reading once, in order, at the rate of its settings."""
    with bench.opened() as device:
        bench.read(device)
        found, longest_ns = [], 0
        for now_ns in bench.ticks(_READ_S):
            reading = bench.read(device)
            longest_ns = max(longest_ns, bench.clock.now_ns() - now_ns)
            found += list(reading) if bench.driver.slot == "load_cell" else [reading]
    if bench.driver.slot != "load_cell":
        if not all(isfinite(each.position_m) and isfinite(each.velocity_m_s) for each in found):
            raise BrokenError("a position or velocity is no number")
        return f"{len(found)} readings, the longest took {longest_ns * 1e-6:.2f} ms"
    return _rate_kept(bench, [each.stamp_ns for each in found])


def _rate_kept(bench: DriverUnderTest, stamps_ns: list[int]) -> str:
    if len(stamps_ns) < 2 or any(after <= before for before, after in pairwise(stamps_ns)):
        raise BrokenError(f"{len(stamps_ns)} readings; expected each once, with increasing stamps")
    if stamps_ns[-1] > bench.clock.now_ns():
        raise BrokenError("a reading is stamped in the future")
    rate_hz = (len(stamps_ns) - 1) * 1e9 / (stamps_ns[-1] - stamps_ns[0])
    expected_hz = getattr(bench.settings, "rate_hz", rate_hz)
    if abs(rate_hz - expected_hz) > _RATE_SHARE * expected_hz:
        raise BrokenError(f"{rate_hz:.1f} readings per second; expected {expected_hz:g}, its rate_hz")
    return f"{rate_hz:.1f} readings per second"


def refuses(bench: DriverUnderTest) -> str:
    """What can not work is refused with one line: a port that is not there, use while closed, no number."""
    device = bench.made()
    _refused(lambda: bench.read(device), "read while closed")
    if bench.driver.slot == "stage":
        with bench.opened() as stage:
            _refused(lambda: stage.command(float("nan"), 0.0, bench.clock.now_ns()), "a setpoint of nan")
    if bench.emulated is None:
        return "use while closed"
    missing = bench.made(bench.emulated.missing)
    line = _refused(missing.open, "a port that is not there")
    missing.close()
    return line


def _refused(act: Callable[[], object], what: str) -> str:
    try:
        act()
    except ForefeelError as error:
        if "\n" in str(error):
            raise BrokenError(f"{what}: expected one line, not {str(error)!r}") from error
        return str(error)
    raise BrokenError(f"{what} was not refused; expected DeviceError")


def freezes(bench: DriverUnderTest) -> str:
    """A device that stops answering is a fault, and stays one until `rearm`."""
    emulator = bench.emulator()
    with bench.opened() as device:
        with emulator.frozen():
            said = bench.until_it_fails(device, "a device that is frozen")
        _stays_failed_until_rearmed(bench, device, said)
    return said


def unplugs(bench: DriverUnderTest) -> str:
    """A cable that is pulled is a fault; plugged in again, the device serves after `rearm`."""
    emulator = bench.emulator()
    with bench.opened() as device:
        emulator.unplug()
        said = bench.until_it_fails(device, "a cable that is pulled")
        emulator.plug()
        _stays_failed_until_rearmed(bench, device, said)
    return said


def _stays_failed_until_rearmed(bench: DriverUnderTest, device: Any, said: str) -> None:  # noqa: ANN401
    if device.link.inhibited is None and not said.startswith(_UNBELIEVED):
        raise BrokenError("after a fault the link is not inhibited; expected it to wait for rearm")
    for _ in bench.ticks(_BACK_S):
        try:
            device.rearm()
            bench.read(device)
            return
        except ForefeelError as error:
            last = error
    raise BrokenError(f"not served again within {_BACK_S:g} s of `rearm`: {last}")


def comes_to_rest(bench: DriverUnderTest) -> str:
    """A stage follows setpoints, and comes to rest by itself when they end."""
    if bench.driver.slot != "stage":
        raise NotTested("not a stage")
    if bench.emulated is None and not bench.moves:
        raise NotTested("moves the stage; needs --moves")
    with bench.opened() as stage:
        start_m = bench.read(stage).position_m
        way = _way(bench, start_m)
        begun_ns = bench.clock.now_ns()
        for now_ns in bench.ticks(_MOVE_M / _SPEED_M_S):
            gone_m = _SPEED_M_S * (now_ns - begun_ns) * 1e-9
            stage.command(start_m + way * gone_m, way * _SPEED_M_S, now_ns)
        for _ in bench.ticks(_REST_S):
            bench.read(stage)
        rest_m = bench.read(stage).position_m
        for _ in bench.ticks(0.2):
            bench.read(stage)
        moved_m = abs(bench.read(stage).position_m - rest_m)
    beyond_m = way * (rest_m - start_m) - _MOVE_M
    if not -_REACHED_M <= beyond_m <= _REACHED_M + _SPEED_M_S * _UNDER_WAY_S:
        raise BrokenError(f"moved {1e3 * (rest_m - start_m):.3f} mm; expected {1e3 * way * _MOVE_M:g} mm")
    if moved_m > _RESTING_M:
        raise BrokenError(
            f"still moved {1e6 * moved_m:.0f} um in 0.2 s, {_REST_S:g} s after the last setpoint"
        )
    return f"{1e3 * (rest_m - start_m):.3f} mm, then at rest without being told"


def _way(bench: DriverUnderTest, start_m: float) -> int:
    low_m, high_m = getattr(bench.settings, "travel", None) or (start_m - 1.0, start_m + 1.0)
    return 1 if start_m < (low_m + high_m) / 2 else -1


def measures(bench: DriverUnderTest) -> str:
    """A load on an emulated cell is read with its sign and value."""
    if bench.driver.slot != "load_cell":
        raise NotTested("not a load cell")
    emulator = bench.emulator()
    with bench.opened() as cell:
        empty_n = _mean_n(bench, cell)
        emulator.order(f"load {_LOAD_N:g}")
        bench.clock.sleep_until_ns(bench.clock.now_ns() + 200 * _TICK_NS)
        read_n = _mean_n(bench, cell) - empty_n
        emulator.order("load 0")
    if abs(read_n - _LOAD_N) > _LOAD_SHARE * _LOAD_N:
        raise BrokenError(f"{read_n:.3f} N read under a load of {_LOAD_N:g} N that resists insertion")
    return f"{read_n:.3f} N under {_LOAD_N:g} N"


def _mean_n(bench: DriverUnderTest, cell: Any) -> float:  # noqa: ANN401 - a load cell
    bench.read(cell)
    forces_n = [each.force_n for _ in bench.ticks(_READ_S / 2) for each in bench.read(cell) if each.valid]
    if not forces_n:
        raise BrokenError("no valid reading")
    return float(sum(forces_n) / len(forces_n))


def distrusts(bench: DriverUnderTest) -> str:
    """A cell that sticks or saturates gives no reading that is believed."""
    if bench.driver.slot != "load_cell":
        raise NotTested("not a load cell")
    emulator = bench.emulator()
    told = [fault for fault in ("stuck", "overrange") if fault in emulator.faults]
    if not told:
        raise NotTested("the emulator has neither `stuck` nor `overrange`")
    with bench.opened() as cell:
        for _ in bench.ticks(_READ_S):  # it must have been seen to be noisy before it can stick
            bench.read(cell)
        for fault in told:
            emulator.order(fault)
            _not_believed(bench, cell, fault)
            emulator.order("free")
            bench.clock.sleep_until_ns(bench.clock.now_ns() + 200 * _TICK_NS)
    return " and ".join(told)


def _not_believed(bench: DriverUnderTest, cell: Any, fault: str) -> None:  # noqa: ANN401 - a load cell
    for _ in bench.ticks(_STUCK_S):
        readings = bench.read(cell)
        if readings and not readings[-1].valid:
            return
    raise BrokenError(f"{fault}: readings are still believed after {_STUCK_S:g} s; expected valid = false")


def renders(bench: DriverUnderTest) -> str:
    """A handle gives the force that it says it gives, and none when it is closed."""
    if bench.driver.slot != "handle":
        raise NotTested("not a handle")
    if bench.emulated is None and not bench.moves:
        raise NotTested("pushes the hand; needs --moves")
    with bench.opened() as handle:
        applied_n = 0.0
        for now_ns in bench.ticks(0.1):
            handle.read(now_ns)
            applied_n = handle.render(_RENDERED_N, now_ns)
        handle.render(0.0, bench.clock.now_ns())
    if not (isfinite(applied_n) and abs(applied_n) <= _RENDERED_N + 1e-9):
        raise BrokenError(f"{applied_n:g} N applied where {_RENDERED_N:g} N were asked for")
    return f"{applied_n:.3f} N of {_RENDERED_N:g} N"


CHECKS: dict[str, Callable[[DriverUnderTest], str]] = {
    "opens": opens,
    "reads": reads,
    "measures": measures,
    "renders": renders,
    "comes to rest": comes_to_rest,
    "distrusts": distrusts,
    "refuses": refuses,
    "freezes": freezes,
    "unplugs": unplugs,
}
"""In the order in which they are made."""
