"""The audit sink of a daemon that has a state folder."""

from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

from forefeel.common.clock import Clock, WallClock
from forefeel.common.errors import ConfigurationError
from forefeel.common.events.audit import SAFETY, AuditSink, ChainEnd, Detail
from forefeel.common.flight import Rings
from forefeel.common.state.audit_writer import AuditWriter
from forefeel.common.state.flight_writer import FlightWriter
from forefeel.common.state.folder import AUDIT, FLIGHT, LATCHED, StateFolder
from forefeel.common.state.latch import Latch


class StateAuditSink(AuditSink):
    """Audit log, flight records and the latch in a state folder.

    Raises:
        ConfigurationError: the audit log or the latch can not be opened.
    """

    def __init__(
        self,
        folder: StateFolder,
        clock: Clock,
        axes: Collection[str],
        keep: int,
        wall: WallClock | None = None,
    ) -> None:
        wall = wall or WallClock()
        self._clock = clock
        self.rings: Rings = Rings()
        audit, latch = folder.path / AUDIT, folder.path / LATCHED
        with ExitStack() as opened:
            new = not audit.exists()
            with _written_to(latch):
                self._latch = Latch(latch, axes, new, self._latch_said)
            opened.callback(self._latch.close)
            with _written_to(audit):
                self._audit = AuditWriter(audit, wall)
            opened.pop_all()
        self.latched = self._latch.found
        self._flight = FlightWriter(folder.path / FLIGHT, keep, self.rings, clock, wall, self.note)

    def start(self, facts: Mapping[str, str]) -> None:
        """Starts the threads; `facts` stand in the first entry and in each flight record."""
        now_ns = self._clock.now_ns()
        self._audit.start(now_ns)
        self._latch.start()
        self._flight.facts = dict(facts)
        self._flight.start()
        self.note("start", now_ns, **facts)

    def note(self, event: str, now_ns: int, axis: str = "", /, **details: Detail) -> None:
        if event == SAFETY:
            self._latch.transition(axis, details)
        self._audit.note(event, now_ns, axis, details)

    def head(self) -> ChainEnd:
        return self._audit.head

    def kept(self, axis: str) -> bool:
        return self._latch.kept(axis)

    def flight(self, axis: str, event: str, reason: str, now_ns: int) -> None:
        self._flight.ask(axis, event, reason, now_ns)

    def problem(self, now_ns: int) -> str | None:
        return self._audit.problem(now_ns) or self._latch.problem or self._flight.problem

    def _latch_said(self, before: str | None, problem: str | None) -> None:
        """That the latch can not be written, or can be again, is an entry; each said once."""
        event = "latch_written_again" if problem is None else "latch_not_kept"
        self.note(event, self._clock.now_ns(), what=problem or before)

    def close(self, reason: str, **details: str | int) -> tuple[ChainEnd, str | None]:
        """The closing entry; the end of the chain, and what could not be written, if so."""
        self._flight.close()
        self._latch.close()
        self.note("stop", self._clock.now_ns(), reason=reason, **details)
        problem = self._audit.close()
        return self._audit.end, problem or self._latch.problem or self._flight.problem


@contextmanager
def _written_to(path: Path) -> Iterator[None]:
    """A file that can not be opened or written is one line."""
    try:
        yield
    except OSError as error:
        raise ConfigurationError(f"{path}: {error.strerror}; expected a file that can be written") from error
