"""Devices without hardware behind the ports, a clock that steps when it is waited for, a person at stdin."""

from collections.abc import Iterator, Sequence
from random import Random
from typing import Self

from forefeel.common.clock import VirtualClock
from forefeel.common.errors import DeviceError
from forefeel.common.hardware.calibration import CellScale
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.slave.load_cell import LoadCellReading, NativeReading
from forefeel.slave.stage import StageReading

S = 1_000_000_000


class SteppedClock(VirtualClock):
    """Waiting for it takes no time."""

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self.set_ns(max(deadline_ns, self.now_ns()))


class Fake:
    """A device with a link; `refuses`: raised by open; `fails_at_s`: it faults then."""

    refuses: Exception | None = None
    fails_at_s: float | None = None

    def __init__(self, clock: SteppedClock, serial: str = "SN-7") -> None:
        self.link = DeviceLink("a fake")
        self.clock, self.calls, self.serial = clock, list[str](), serial

    def open(self) -> None:
        self.calls.append("open")
        self.link = DeviceLink("a fake")
        if self.refuses is not None:
            raise self.refuses
        for state in (LinkState.OPEN, LinkState.IDENTIFIED, LinkState.CONFIGURED, LinkState.READY):
            self.link.advance(state)
        self.link.identity, self.link.serial = "Fake 2000", self.serial

    def close(self) -> None:
        self.calls.append("close")
        self.link.close()

    def check(self, now_ns: int) -> None:
        if self.fails_at_s is not None and now_ns >= self.fails_at_s * S:
            self.link.fault("unplugged")
        self.link.require_ready()

    def __getattr__(self, name: str) -> object:
        """`command`, `hold`, `render`, `rearm`, whatever else is asked for: noted, and not there."""
        if name in {"command", "hold", "home", "render", "rearm", "show"}:
            self.calls.append(name)
        raise AttributeError(name)


class FakeStage(Fake):
    """Answers 250 times a second, in 2 ms or (each fiftieth time) in 6 ms."""

    _asked = 0

    def read(self, now_ns: int) -> StageReading:
        self.check(now_ns)
        while self._asked * S < 250 * now_ns:
            self._asked += 1
            self.link.exchanged(6_000_000 if self._asked % 50 == 0 else 2_000_000)
        return StageReading(0.01, 0.0)


class FakeCell(Fake):
    """Reads `native = zero + force / gain` plus what the test adds, at `rate_hz`.

    Attributes:
        force_n: the load now.
    """

    scale = CellScale(2e-5, 10.0)
    rate_hz, gain_n, zero, noise = 80.0, 2e-5, 8_388.0, 3.0
    drift_per_s = 0.0
    valid = True

    def __init__(self, clock: SteppedClock, serial: str = "SN-7") -> None:
        super().__init__(clock, serial)
        self._random, self._read = Random(5), 0
        self.force_n = 0.0

    def load(self, force_n: float) -> None:
        """Another load is applied."""
        self.force_n = force_n

    open_native = Fake.open

    def read_native(self, now_ns: int) -> Sequence[NativeReading]:
        self.check(now_ns)
        return list(self._due(now_ns))

    def read(self, now_ns: int, recording_time_s: float | None) -> Sequence[LoadCellReading]:
        del recording_time_s
        self.check(now_ns)
        found = [
            LoadCellReading(1.0, round(each.native), each.valid, each.stamp_ns) for each in self._due(now_ns)
        ]
        self.link.exchanges += len(found)
        return found

    def _due(self, now_ns: int) -> Iterator[NativeReading]:
        while self.rate_hz and (self._read + 1) * S <= self.rate_hz * now_ns:
            self._read += 1
            stamp_ns = round(self._read * S / self.rate_hz)
            native = self.zero + self.force_n / self.gain_n + self._random.gauss(0.0, self.noise)
            yield NativeReading(native + self.drift_per_s * stamp_ns / S, self.valid, stamp_ns)


class FakeHandle(Fake):
    """A handle that only reads."""

    def read(self, now_ns: int) -> tuple[float, float]:
        self.check(now_ns)
        return 0.0, 0.0


class FakeHoming(Fake):
    """A stage of 100 mm at 1 micrometre a step."""

    ends = (-1000.0, 99_000.0)
    stuck: BaseException | None = None

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.calls.append("stop")
        self.close()

    def home(self) -> float:
        self.calls.append("homed")
        return 0.0

    def travel_ends(self, velocity_m_s: float) -> tuple[float, float]:
        self.calls.append(f"travelled at {velocity_m_s:g}")
        if self.stuck is not None:
            raise self.stuck
        return self.ends[1], self.ends[0]


class Hands:
    """stdin: at each Enter the next load is on the cell. `says`: lines in its place; then stdin ends."""

    def __init__(
        self, cell: FakeCell | None = None, loads: Sequence[float] = (), says: Sequence[str] = ()
    ) -> None:
        self._cell, self._loads, self._says = cell, list(loads), list(says)

    def readline(self) -> str:
        if self._cell is not None and self._loads:
            self._cell.load(self._loads.pop(0))
            return "\n"
        return self._says.pop(0) if self._says else ""


UNPLUGGED = DeviceError("unplugged")
