"""The audit log: entries that are chained by their hashes, and the port that takes them.

One line of canonical JSON each: keys sorted, no blanks, ASCII. `hash` is the SHA-256 (FIPS 180-4) of the
line without it; `previous` is the hash of the entry before, so that no entry can be changed, taken out, put
in or moved without breaking the chain. What a chain can not show is a tail that was cut off: compare with a
hash that was noted elsewhere: in the log of the other end (`PEER_LOG`), or by whoever keeps what a daemon
says when it starts and ends.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from forefeel.common.flight import Rings
from forefeel.common.messages import FOLLOWING, Handshake, SafetyState

GENESIS = "0" * 64
"""`previous` of the first entry there is."""

CLOSING = "stop"
"""The event of an entry after which a daemon writes no more."""

CONTINUED = "continued"
"""The event of the first entry of a file that goes on with the chain of another."""

SAFETY = "safety"
"""The event of an entry that is a transition of the slave's safety state machine."""

PEER_LOG = "peer_log"
"""The event of an entry that holds the end of the other end's log."""

HALTED = frozenset({SafetyState.FAULT, SafetyState.ESTOPPED})
UNASKED = frozenset({"watchdog", "session_lost", "misaligned", "round_trip"})
"""Events that end a motion without the person's wish."""

REFUSALS = frozenset({"session", "sequence", "late", "future", "range", "alignment", "round_trip"})
"""Rules by which a command is refused; the others change a motion, and stand in the recording."""

Detail = str | int | float | bool | None | list[str] | dict[str, str]
_KEYS = frozenset({"number", "utc", "monotonic_ns", "event", "axis", "details", "previous", "hash"})
_HEX = frozenset("0123456789abcdef")


class Noted(NamedTuple):
    """What happened: wall clock (ISO 8601, UTC), monotonic stamp of the host, event, axis or empty."""

    utc: str
    monotonic_ns: int
    event: str
    axis: str
    details: Mapping[str, Detail]


class Entry(NamedTuple):
    """One entry as it stands in a log; numbers count from 1 over all files of a log."""

    number: int
    noted: Noted
    previous: str
    hash: str


class ChainEnd(NamedTuple):
    """The end of a chain, to which the next entry is tied."""

    number: int = 0
    hash: str = GENESIS


class Flaw(NamedTuple):
    """The first line (from 1) that is not as it was written, and what is wrong with it."""

    line: int
    what: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """What `verify` found.

    Attributes:
        entries: the good ones, up to the flaw.
        first, last: the first and the last of them.
        flaw: None when every entry is as it was written.
        torn: bytes of a last line without an end: its writer was killed, or writes just now.
        head_at: number of the entry that has the hash that was asked for.
    """

    entries: int
    first: Entry | None
    last: Entry | None
    flaw: Flaw | None
    torn: int = 0
    head_at: int | None = None

    @property
    def closed(self) -> bool:
        """Whether it ends as a daemon ends it; else a daemon runs, was killed, or the tail was cut off."""
        return not self.torn and self.last is not None and self.last.noted.event == CLOSING

    @property
    def intact(self) -> bool:
        """Whether no entry is broken."""
        return self.flaw is None


def seal(noted: Noted, after: ChainEnd) -> tuple[bytes, ChainEnd]:
    """The line of the next entry with its end, and the chain's new end."""
    fields = {**noted._asdict(), "number": after.number + 1, "previous": after.hash}
    digest = hashlib.sha256(_canonical(fields)).hexdigest()
    return _canonical({**fields, "hash": digest}) + b"\n", ChainEnd(after.number + 1, digest)


def parse(line: bytes) -> Entry:
    """The entry of a line; its place in the chain is not looked at.

    Raises:
        ValueError: no entry, or one whose content does not have its hash.
    """
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise ValueError("is not JSON") from error
    if not isinstance(fields, dict) or set(fields) != _KEYS:
        raise ValueError("is not an entry")
    digest = fields.pop("hash")
    if _canonical({**fields, "hash": digest}) != line:
        raise ValueError("is not written as the log writes it")
    if hashlib.sha256(_canonical(fields)).hexdigest() != digest:
        raise ValueError("does not have the content that its hash was made of")
    number, previous = fields.pop("number"), fields.pop("previous")
    if not isinstance(number, int) or not isinstance(fields["details"], dict):
        raise ValueError("is not an entry")
    return Entry(number, Noted(**fields), previous, digest)


def verify(lines: Iterable[bytes], head: str | None = None) -> Verdict:
    """Walks a log's lines, each with its end, and stops at the first that is not as it was written.

    Args:
        lines: of a file opened in binary mode.
        head: a hash that was noted before; an entry must have it.
    """
    first: Entry | None = None
    last: Entry | None = None
    head_at: int | None = None
    count = 0
    for at, line in enumerate(lines, 1):
        if not line.endswith(b"\n"):
            return Verdict(count, first, last, None, len(line), head_at)
        try:
            entry = parse(line[:-1])
            _require_tied(entry, last)
        except ValueError as error:
            return Verdict(count, first, last, Flaw(at, str(error)), 0, head_at)
        first, last, count = first or entry, entry, count + 1
        if entry.hash == head:
            head_at = entry.number
    return Verdict(count, first, last, None, 0, head_at)


def is_hash(text: str) -> bool:
    """Whether it has the shape of an entry's hash."""
    return len(text) == len(GENESIS) and set(text) <= _HEX


def worth_a_record(before: SafetyState, event: str, after: SafetyState) -> bool:
    """Whether a flight record is kept of a transition: whatever halts, or ends a motion unasked."""
    return after in HALTED or (before in FOLLOWING and event in UNASKED)


def peer(handshake: Handshake) -> dict[str, Detail]:
    """Who the other end is, for an entry about a session."""
    return {
        "session": handshake.session_id,
        "peer": handshake.instance_id,
        "software": handshake.software,
        "settings": handshake.settings_hash,
        "drivers": dict(handshake.drivers),
    }


class AuditSink:
    """The audit log and the flight recorder as loops see them: no call blocks, any thread may call.

    This one keeps nothing, for simulations in virtual time; `forefeel.common.state` has the one that does.

    Attributes:
        rings: what the flight recorder holds in memory; None where there is none.
        latched: axes whose emergency stop, or fault of a motion, outlived the daemon before, with its reason.
    """

    rings: Rings | None = None
    latched: Mapping[str, str] = {}

    def note(self, event: str, now_ns: int, axis: str = "", /, **details: Detail) -> None:
        """One entry of the audit log, with the wall clock of now."""

    def flight(self, axis: str, event: str, reason: str, now_ns: int) -> None:
        """Asks for a record of what led to this and of half a second after it."""

    def thread_fault(self, axis: str, error: BaseException, now_ns: int) -> None:
        """A thread of the daemon has failed; `axis` names the flight record."""
        reason = f"{type(error).__name__}: {error}"[:200]
        self.note("thread_fault", now_ns, reason=reason)
        self.flight(axis, "thread_fault", reason, now_ns)

    def head(self) -> ChainEnd | None:
        """The end of the audit log, for the log of the other end; None where there is no log."""
        return None

    def kept(self, axis: str) -> bool:
        """Whether what is latched of the axis would be found by a new start: it is on the disk."""
        del axis
        return True

    def problem(self, now_ns: int) -> str | None:
        """Why something that has to be kept can not be written, if it can not."""
        del now_ns
        return None


NULL_AUDIT_SINK = AuditSink()


def _require_tied(entry: Entry, last: Entry | None) -> None:
    if last is None:
        begins = entry.number == 1 and entry.previous == GENESIS
        if not begins and entry.noted.event != CONTINUED:
            raise ValueError(f"is entry {entry.number}: those before it are missing")
    elif entry.previous != last.hash or entry.number != last.number + 1:
        raise ValueError(f"(number {entry.number}) does not follow entry {last.number}")


def _canonical(fields: Mapping[str, object]) -> bytes:
    return json.dumps(fields, sort_keys=True, separators=(",", ":"), ensure_ascii=True).encode()
