"""Writes flight records: at a fault the last 2 s of every stream and half a second after, as MCAP."""

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError

from forefeel.common.clock import Clock, utc_text
from forefeel.common.events.sink import Detail
from forefeel.common.flight import AFTER_NS, BEFORE_NS, CycleRow, FlightRing, Rings, Row
from forefeel.common.messages import ControlCycle
from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.common.runtime.threads import Worker

_AT_MOST_EVERY_NS = 1_000_000_000  # so that a flood of faults does not fill the disk
_BLOCK_ROWS = 32  # rows that are written without a pause, in less than a millisecond
_PAUSE_S = 0.0015
"""After each block of less than a millisecond: drivers wait for the same interpreter and processor, and
somebody may have armed again by then.
"""

Note = Callable[..., None]


class _Request(NamedTuple):
    axis: str
    event: str
    reason: str
    stamp_ns: int
    utc: str


class FlightWriter:
    """Writes flight records, one a second at most, and keeps the newest ones in a folder.

    Any thread asks; the worker `flight` waits, encodes and writes. A record is there whole or not at all.

    Attributes:
        facts: stand in each record.
    """

    def __init__(
        self,
        folder: Path,
        keep: int,
        rings: Rings,
        clock: Clock,
        note: Note,
        worker: type[Worker] = Worker,
    ) -> None:
        self._folder, self._keep, self._rings = folder, keep, rings
        self._clock, self._note = clock, note
        self.facts: dict[str, str] = {}
        self._requests: deque[_Request] = deque()
        self._accepted_ns: int | None = None
        self.worker = worker("flight", self.write)
        for part in folder.glob(".*.part"):  # of a daemon that was killed
            with suppress(OSError):
                part.unlink()

    def ask(self, axis: str, event: str, reason: str, now_ns: int) -> None:
        """Queues a flight record for the worker; never blocks. Drops one within 1 s of the last accepted."""
        accepted_ns = self._accepted_ns
        if accepted_ns is not None and now_ns - accepted_ns < _AT_MOST_EVERY_NS:
            return
        self._accepted_ns = now_ns
        self._requests.append(_Request(axis, event, reason, now_ns, utc_text()))
        self.worker.wake()

    def close(self) -> None:
        self.worker.close()

    def write(self, closing: bool) -> float | None:
        """Writes the requested records, each once half a second has passed since its event, or all with
        `closing`. Returns the seconds until the next one is due, None where none is left.
        """
        while self._requests:
            request = self._requests[0]
            left_ns = request.stamp_ns + AFTER_NS - self._clock.now_ns()
            if left_ns > 0 and not closing:
                return left_ns * 1e-9
            self._record(request)
            self._requests.popleft()
        return None

    def _record(self, request: _Request) -> None:
        """Writes one record and removes the oldest beyond `keep`; an error while writing leaves no file.
        Either result is logged, none raised.
        """
        name = f"{request.utc.replace(':', '').replace('-', '')}-{request.axis}-{request.event}.mcap"
        part = self._folder / f".{name}.part"
        first_ns, last_ns = request.stamp_ns - BEFORE_NS, request.stamp_ns + AFTER_NS
        rings = [(ring, ring.between(first_ns, last_ns)) for ring in self._rings.all()]
        details: dict[str, Detail] = {"file": name}
        try:
            details |= self._write(part, request, rings)
            part.replace(self._folder / name)
        except Exception as error:  # noqa: BLE001 - a record that fails costs no other
            with suppress(OSError):
                part.unlink(missing_ok=True)
            self._note("flight_failed", self._clock.now_ns(), request.axis, file=name, what=str(error)[:200])
            return
        self._note("flight_record", self._clock.now_ns(), request.axis, **details)
        for old in sorted(self._folder.glob("*.mcap"))[: -self._keep]:
            with suppress(OSError):
                old.unlink()

    def _write(
        self, part: Path, request: _Request, rings: list[tuple[FlightRing, list[Row]]]
    ) -> dict[str, Detail]:
        """Writes rows and metadata to a new MCAP file; returns counts of written and malformed messages."""
        with RunWriter(part, mode=0o600) as writer:
            asked = {name: str(value) for name, value in request._asdict().items()}
            writer.add_metadata("flight", {**self.facts, **asked})
            for ring, rows in rings:
                self._write_ring(writer, ring, rows)
            return {"messages": writer.written, "malformed": writer.malformed}

    def _write_ring(self, writer: RunWriter, ring: FlightRing, rows: list[Row]) -> None:
        """Writes a ring's rows, with pauses for other threads; counts invalid cycles as malformed."""
        for number, row in enumerate(rows):
            if number % _BLOCK_ROWS == _BLOCK_ROWS - 1:
                self.worker.pause(_PAUSE_S)
            if not isinstance(row, CycleRow):
                writer.write(ring.key, row[1], row[0])
                continue
            try:
                cycle = ControlCycle(sequence=number, **row._asdict())
                writer.write_message(ring.key, cycle, row.stamp_ns)
            except ValidationError:  # a number that is none: the rows around it say more than no file
                writer.malformed += 1
