"""Writes the audit log in a thread of its own: loops only append to a queue."""

import threading
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from forefeel.common.clock import WallClock
from forefeel.common.events.audit import CLOSING, PEER_LOG, ChainEnd, Detail, Noted
from forefeel.common.state.audit_file import AuditFile

# entries that wait for the disk; chosen, not measured: more bridge a longer stall and take memory
_WAITING = 4096
# s between two attempts to write; chosen, not measured: shorter loads a full disk, longer resumes later
_RETRY_S = 1.0
# ns after which a write that has not returned is a problem; chosen, not measured: shorter takes a slow
# disk for a stuck one
_STUCK_NS = 10_000_000_000


class AuditWriter:
    """The log of one daemon. Any thread notes; the thread `audit` writes, each batch with one fdatasync.

    A log that can not be written is a `problem`, and the slave makes a fault of it. What waits meanwhile is
    written when it can be again; of more than 4096 entries the oldest are lost, counted and said.

    Attributes:
        head: the end of the chain on the disk after the last entry that is not about the other end's log. Two
            logs that note each other's ends come to rest.

    Raises:
        OSError: the file can not be opened.
    """

    def __init__(self, path: Path, wall: WallClock) -> None:
        self._wall = wall
        self._file = AuditFile(path)
        self.head = self._file.end
        self._waiting: deque[Noted] = deque(maxlen=_WAITING)
        self._lost = 0
        self._counting = threading.Lock()  # held for less than it takes to copy what waits
        self._problem: str | None = None
        self._busy_since_ns: int | None = None
        self._newest_ns = 0
        self._wake = threading.Event()
        self._closing = False
        self._reserve_said = False
        self._closed = False  # the closing entry is written: nothing may follow it
        self._thread = threading.Thread(target=self._run, name="audit", daemon=True)

    def start(self, now_ns: int) -> None:
        """Starts the thread; its first words are what the opening had to mend."""
        found = self._file.recovery
        if found is not None and found.torn:
            text = found.torn.decode("utf-8", "replace")
            what = "a half-written last line was cut off"
            self.note("log_recovered", now_ns, "", {"what": what, "text": text})
        if found is not None and found.damaged:
            what = f"{found.damaged}; set aside, a new chain begins"
            self.note("log_damaged", now_ns, "", {"what": what})
        if self._file.last_event not in ("", CLOSING):
            what = "no closing entry: the daemon before was killed, or its machine stopped"
            self.note("previous_not_closed", now_ns, "", {"what": what})
        self._thread.start()

    def note(self, event: str, now_ns: int, axis: str, details: Mapping[str, Detail]) -> None:
        """One entry; waits for no disk."""
        noted = Noted(self._wall.utc(), now_ns, event, axis, details)
        with self._counting:
            self._lost += len(self._waiting) == _WAITING
            self._waiting.append(noted)
        self._wake.set()

    def problem(self, now_ns: int) -> str | None:
        """Why the log can not be written now."""
        if self._problem is not None:
            return self._problem
        since_ns = self._busy_since_ns
        if since_ns is not None and now_ns - since_ns > _STUCK_NS:
            return "audit log: a write has not come back for 10 s"
        return None

    @property
    def end(self) -> ChainEnd:
        """Of the chain as it is on the disk."""
        return self._file.end

    def close(self) -> str | None:
        """Writes what waits and ends the thread; why something could not be written. Idempotent."""
        self._closing = True
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()
        self._file.close()
        return self._problem

    def _run(self) -> None:
        try:
            self._write_until_closed()
        except Exception as error:  # noqa: BLE001 - the edge of the thread: nothing is written any more
            self._problem = f"audit log: its thread has ended: {type(error).__name__}: {error}"

    def _write_until_closed(self) -> None:
        while True:
            self._wake.wait(_RETRY_S)
            self._wake.clear()
            closing = self._closing  # before the last batch is taken
            self._write()
            if closing:
                return

    def _write(self) -> None:
        if self._problem is not None:
            self._try_again()
        with self._counting:
            batch = list(self._waiting)
            self._waiting.clear()
        self._busy_since_ns = batch[-1].monotonic_ns if batch else None
        try:
            self._append(batch)
            if self._problem is None and not self._closing:
                self._check_room()
        finally:
            self._busy_since_ns = None

    def _append(self, batch: list[Noted]) -> None:
        if not batch:
            return
        self._newest_ns = batch[-1].monotonic_ns
        lost = self._lost
        losses = [self._said("entries_lost", count=lost)] if lost else []
        try:
            self._file.write([*losses, *batch])
            if any(noted.event != PEER_LOG for noted in batch):
                self.head = self._file.end
            self._closed = batch[-1].event == CLOSING
            with self._counting:
                self._lost -= lost
        except OSError as error:
            self._problem = f"audit log: {error.strerror or error}"
            self._put_back(batch)

    def _put_back(self, batch: list[Noted]) -> None:
        """To the front of what waits; the oldest are lost where there are too many."""
        with self._counting:
            over = max(0, len(batch) + len(self._waiting) - _WAITING)
            self._lost += over
            self._waiting.extendleft(reversed(batch[over:]))

    def _check_room(self) -> None:
        """Keeps the reserve; a disk that has no room for it is full, and that is written into the reserve."""
        try:
            if not self._file.reserve() and not self._reserve_said:
                what = "the file system can not allocate beyond an end"
                self._say("no_reserve", what)
            self._reserve_said = True
        except OSError as error:
            self._problem = f"audit log: {error.strerror or error}"
            with suppress(OSError):
                self._say("disk_full", self._problem)

    def _try_again(self) -> None:
        with suppress(OSError):
            self._file.reserve()
            self._say("log_written_again", self._problem)
            self._problem = None

    def _say(self, event: str, what: str | None) -> None:
        """An entry of the log's own.

        Raises:
            OSError: not written.
        """
        if not self._closed:
            self._file.write([self._said(event, what=what)])

    def _said(self, event: str, **details: Detail) -> Noted:
        return Noted(self._wall.utc(), self._newest_ns, event, "", details)
