"""A slave of two simulated axes in virtual time, and the events that it logs."""

from forefeel.common.events.sink import Detail, EventSink
from forefeel.common.messages import SafetyState
from forefeel.common.runtime.virtual import VirtualRuntime
from forefeel.common.transport.memory import MemoryBus
from forefeel.slave.daemon import Clearing, SlaveDaemon
from forefeel.slave.settings import SlaveAxisSettings, SlaveSettings

MS = 1_000_000


class Book(EventSink):
    """An event sink in memory."""

    def __init__(self) -> None:
        self.noted: list[tuple[str, int, str, dict[str, Detail]]] = []
        self.flights: list[tuple[str, str]] = []
        self.broken: str | None = None

    def note(self, event: str, now_ns: int, axis: str = "", /, **details: Detail) -> None:
        self.noted.append((event, now_ns, axis, details))

    def flight(self, axis: str, event: str, reason: str, now_ns: int) -> None:
        del reason, now_ns
        self.flights.append((axis, event))

    @property
    def problem(self) -> str | None:
        return self.broken

    def of(self, event: str) -> list[dict[str, Detail]]:
        return [details for name, _, _, details in self.noted if name == event]


class Cell:
    """A slave of two simulated axes in virtual time."""

    def __init__(self) -> None:
        self.runtime, self.book = VirtualRuntime(), Book()
        settings = SlaveSettings(axes=(SlaveAxisSettings(), SlaveAxisSettings(name="rotation")))
        session = MemoryBus().session(self.runtime.clock)
        self.daemon = SlaveDaemon(settings, session, self.runtime, lambda: 7, self.book)
        self.step()

    def step(self, ticks: int = 5) -> None:
        self.runtime.run(ticks * MS)

    def states(self) -> list[SafetyState]:
        return [axis.state for axis in self.daemon.axes]

    def clear(self, axis: str | None = None) -> list[Clearing]:
        done = self.daemon.clear(axis)
        self.step()
        return done.result(0)
