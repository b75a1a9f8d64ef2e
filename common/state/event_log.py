"""events.jsonl, one JSON line per safety event, and the event sink of a daemon that has a state folder."""

import json
import os
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from forefeel.common.clock import Clock, utc_text
from forefeel.common.errors import ConfigurationError
from forefeel.common.events.sink import SAFETY, Detail, EventSink
from forefeel.common.flight import Rings
from forefeel.common.runtime.threads import Worker
from forefeel.common.slots import BoundedQueue
from forefeel.common.state.flight_writer import FlightWriter
from forefeel.common.state.folder import EVENTS, FLIGHT, LATCHED, StateFolder, own_file
from forefeel.common.state.latch import Latch

_WAITING = 4096  # lines that wait for the disk; beyond it the oldest are lost
_LARGEST_BYTES = 16 * 1024 * 1024
"""Beyond it the file becomes events.1.jsonl, in place of the one before."""


class _Line(NamedTuple):
    """Wall clock (ISO 8601, UTC), monotonic stamp of the host, event, axis or empty."""

    utc: str
    monotonic_ns: int
    event: str
    axis: str
    details: Mapping[str, Detail]


class EventLog:
    """Appends events to a file, in the worker `events`; callers only append to a queue.

    Lines that can not be written (a full disk) are lost and counted; the next line that can be written is an
    event `lines_lost` with their number.

    Raises:
        OSError: the file can not be opened.
    """

    def __init__(self, path: Path, worker: type[Worker] = Worker) -> None:
        self._path = path
        self._descriptor = own_file(path)
        self._size = os.lseek(self._descriptor, 0, os.SEEK_END)
        self._waiting: BoundedQueue[_Line] = BoundedQueue(_WAITING)
        self._failed = self._reported = 0
        self.worker = worker("events", self._work)

    @property
    def lost(self) -> int:
        return self._failed + self._waiting.dropped

    def note(self, event: str, now_ns: int, axis: str, details: Mapping[str, Detail]) -> None:
        """Queues one event; `now_ns` is the host's monotonic stamp."""
        self._waiting.put(_Line(utc_text(), now_ns, event, axis, details))
        self.worker.wake()

    def write(self) -> None:
        """Appends the queued lines to the file, before them a `lines_lost` event if lines were lost; does
        nothing with an empty queue. Lines that can not be written count as lost.
        """
        lines, lost = self._waiting.drain(), self.lost
        if not lines:
            return
        missing = {"count": lost - self._reported}
        losses = [lines[0]._replace(event="lines_lost", axis="", details=missing)] if missing["count"] else []
        try:
            self._append(
                b"".join(json.dumps(line._asdict(), default=str).encode() + b"\n" for line in losses + lines)
            )
            self._reported = lost
        except OSError:
            self._failed += len(lines)

    def close(self) -> None:
        self.worker.close()
        os.close(self._descriptor)

    def _work(self, closing: bool) -> None:
        del closing
        self.write()

    def _append(self, data: bytes) -> None:
        """Appends to the file, on the disk when it returns; a file over 16 MiB first gives way to a new one.
        Raises OSError where that fails, with nothing of `data` left in the file.
        """
        if self._size > _LARGEST_BYTES:
            self._rotate()
        try:
            done = 0
            while done < len(data):
                done += os.pwrite(self._descriptor, data[done:], self._size + done)
            os.fdatasync(self._descriptor)
        except OSError:
            os.ftruncate(self._descriptor, self._size)
            raise
        self._size += len(data)

    def _rotate(self) -> None:
        with suppress(FileNotFoundError):  # an attempt before this one had no room for the new file
            self._path.replace(self._path.with_suffix(f".1{self._path.suffix}"))
        before, self._descriptor, self._size = self._descriptor, own_file(self._path), 0
        os.close(before)


class StateEventSink(EventSink):
    """Event log, flight records and latch in a state folder.

    Raises:
        ConfigurationError: the event log or the latch can not be opened.
    """

    def __init__(
        self,
        folder: StateFolder,
        clock: Clock,
        axes: Collection[str],
        keep: int,
        worker: type[Worker] = Worker,
    ) -> None:
        self._clock = clock
        self.rings: Rings = Rings()
        events, latch = folder.path / EVENTS, folder.path / LATCHED
        try:
            self._latch = Latch(latch, axes, not events.exists(), self._latch_changed, worker)
            try:
                self._log = EventLog(events, worker)
            except OSError:
                self._latch.close()
                raise
        except OSError as error:
            raise ConfigurationError(
                f"{folder.path}: {error.strerror}; expected a state folder that can be written"
            ) from error
        self.latched = self._latch.restored
        self._flight = FlightWriter(folder.path / FLIGHT, keep, self.rings, clock, self.note, worker)

    def start(self, facts: Mapping[str, str]) -> None:
        """Starts the threads; `facts` stand in the first event and in each flight record."""
        self._flight.facts = dict(facts)
        for writer in self._log, self._latch, self._flight:
            writer.worker.start()
        self.note("start", self._clock.now_ns(), **facts)

    @property
    def problem(self) -> str | None:
        return self._latch.problem

    @property
    def lost(self) -> int:
        return self._log.lost

    def note(self, event: str, now_ns: int, axis: str = "", /, **details: Detail) -> None:
        """Queues an event for the log; a safety transition also for the latch."""
        if event == SAFETY:
            self._latch.transition(axis, details)
        self._log.note(event, now_ns, axis, details)

    def is_persisted(self, axis: str, stopped: bool) -> bool:
        return self._latch.is_persisted(axis, stopped)

    def flight(self, axis: str, event: str, reason: str, now_ns: int) -> None:
        self._flight.ask(axis, event, reason, now_ns)

    def _latch_changed(self, before: str | None, problem: str | None) -> None:
        event = "latch_written_again" if problem is None else "latch_not_kept"
        self.note(event, self._clock.now_ns(), what=problem or before)

    def close(self, reason: str) -> None:
        self._flight.close()
        self._latch.close()
        self.note("stop", self._clock.now_ns(), reason=reason)
        self._log.close()
