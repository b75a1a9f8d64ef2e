"""The journal of a daemon that has a state folder."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from common.audit import SAFETY, Detail, Link, Noted
from common.clock import Clock, WallClock
from common.errors import ConfigurationError
from common.flight import Rings
from common.journal import Journal
from common.messages import SafetyState
from common.state.audit_writer import AuditWriter
from common.state.flight_writer import FlightWriter
from common.state.folder import AUDIT, FLIGHT, LATCHED, StateFolder
from common.state.latch import Latch


class StateJournal(Journal):
    """Audit log, flight records and the latch in a state folder.

    Raises:
        ConfigurationError: the audit log can not be opened.
    """

    def __init__(self, folder: StateFolder, clock: Clock, keep: int, wall: WallClock | None = None) -> None:
        wall = wall or WallClock()
        self._clock = clock
        self._latch = Latch(folder.path / LATCHED)
        self.latched: Mapping[str, str] = dict(self._latch.reasons)
        self._latch_problem: str | None = None
        self.rings: Rings = Rings()
        try:
            self._audit = AuditWriter(folder.path / AUDIT, wall, self._keep_latch, self._write_latch)
        except OSError as error:
            raise ConfigurationError(
                f"{folder.path / AUDIT}: {error.strerror}; expected an audit log that can be written"
            ) from error
        self._flight = FlightWriter(folder.path / FLIGHT, keep, self.rings, clock, wall, self.note)

    def start(self, facts: Mapping[str, str]) -> None:
        """Starts the threads; `facts` stand in the first entry and in each flight record."""
        now_ns = self._clock.now_ns()
        self._audit.start(now_ns)
        self._flight.facts = dict(facts)
        self._flight.start()
        self.note("start", now_ns, **facts)

    def note(self, event: str, now_ns: int, axis: str = "", /, **details: Detail) -> None:
        """See the port."""
        self._audit.note(event, now_ns, axis, details)

    def flight(self, axis: str, event: str, reason: str, now_ns: int) -> None:
        """See the port."""
        self._flight.ask(axis, event, reason, now_ns)

    def problem(self, now_ns: int) -> str | None:
        """See the port."""
        return self._audit.problem(now_ns) or self._latch_problem or self._flight.problem

    def _keep_latch(self, noted: Noted) -> None:
        """An axis that is stopped stays so over the end of the daemon; in the audit log's thread."""
        stopped = SafetyState.ESTOPPED.value
        if noted.event != SAFETY or stopped not in (noted.details["before"], noted.details["after"]):
            return
        latched = noted.details["after"] == stopped
        with self._latch_said(noted.axis):
            self._latch.keep(noted.axis, str(noted.details["reason"]) if latched else None)

    def _write_latch(self) -> None:
        """Again, for as long as it could not be; in the audit log's thread."""
        with self._latch_said():
            self._latch.write()

    @contextmanager
    def _latch_said(self, axis: str = "") -> Iterator[None]:
        """That the latch can not be written, or can be again, is a problem and an entry; each said once."""
        problem = None
        try:
            yield
        except OSError as error:
            problem = f"latch: {error.strerror or error}"
        before, self._latch_problem = self._latch_problem, problem
        if problem is not None and problem != before:
            self.note("latch_not_kept", self._clock.now_ns(), axis, what=problem)
        elif problem is None and before is not None:
            self.note("latch_written_again", self._clock.now_ns(), axis, what=before)

    def close(self, reason: str, **details: str | int) -> tuple[Link, str | None]:
        """The closing entry; the end of the chain, and what could not be written, if so."""
        self._flight.close()
        self.note("stop", self._clock.now_ns(), reason=reason, **details)
        problem = self._audit.close()
        return self._audit.end, problem or self._latch_problem or self._flight.problem
