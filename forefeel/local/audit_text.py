"""An audit log for people: the verdict on it, and its entries in words."""

from itertools import islice
from pathlib import Path
from typing import Any

from forefeel.common.errors import ConfigurationError
from forefeel.common.events.audit import PEER_LOG, ChainEnd, Entry, Flaw, Verdict, parse, verify
from forefeel.common.events.console import printable


def read_verdict(path: Path, head: str | None = None) -> Verdict:
    """What the chain in that file says.

    Raises:
        ConfigurationError: the file can not be read.
    """
    try:
        with path.open("rb") as lines:
            return verify(lines, head)
    except OSError as error:
        raise ConfigurationError(f"{path}: {error.strerror}; expected an audit log") from error


def heads_noted_in(path: Path) -> list[ChainEnd]:
    """Where the log of the other end ended each time, by that log's own entries.

    Raises:
        ConfigurationError: the file can not be read.
    """
    details = [entry.noted.details for entry in read_entries(path)[0] if entry.noted.event == PEER_LOG]
    return [ChainEnd(int(str(each["number"])), str(each["head"])) for each in details]


def missing_heads(path: Path, noted: list[ChainEnd]) -> list[ChainEnd]:
    """Those of the heads that the log does not have, or has with another hash: its end was cut off, or it was
    removed and begun anew. Those before its first entry are of an earlier file of the same log.

    Raises:
        ConfigurationError: the file can not be read.
    """
    entries = read_entries(path)[0]
    first = entries[0].number if entries else 1
    own = {(entry.number, entry.hash) for entry in entries}
    return [head for head in noted if head.number >= first and tuple(head) not in own]


def read_entries(path: Path) -> tuple[list[Entry], Flaw | None]:
    """The good entries, and the first line that is not.

    Raises:
        ConfigurationError: the file can not be read.
    """
    verdict = read_verdict(path)
    with path.open("rb") as lines:
        return [parse(line[:-1]) for line in islice(lines, verdict.entries)], verdict.flaw


def describe(verdict: Verdict, head: str | None) -> list[str]:
    """The verdict, a line for each thing."""
    first, last, said = verdict.first, verdict.last, []
    if first is None or last is None:
        said.append("no entry")
    else:
        numbers, times = f"{first.number} to {last.number}", f"{first.noted.utc} to {last.noted.utc}"
        said.append(f"{verdict.entries} entries, {numbers}, {times}")
        said.append(f"head {last.hash}")
        if first.number > 1:
            said.append(f"continues another file: verify that one with --head {first.previous}")
    if verdict.flaw is not None:
        said.append(f"NOT INTACT: line {verdict.flaw.line} {verdict.flaw.what}")
    else:
        said.append("intact")
    if head is not None:
        found = verdict.head_at
        missing = "NOT FOUND: no entry has that hash; cut off, or another log"
        said.append(missing if found is None else f"that hash is entry {found}")
    if not verdict.closed:
        said.append(_open_end(verdict))
    return said


def describe_heads(noted: list[ChainEnd], missing: list[ChainEnd]) -> list[str]:
    """Which of the noted heads are here, a line for each thing."""
    if not missing:
        return [f"the other end noted {len(noted)} heads: all of this file's are here"]
    number, digest = missing[-1]
    return [
        f"NOT COMPLETE: the other end noted {len(missing)} heads that are not here, the last one of entry "
        f"{number}, {digest}: the end was cut off, or the log was removed and begun anew"
    ]


def verdict_json(verdict: Verdict) -> dict[str, Any]:
    """The verdict as plain data."""
    last = verdict.last
    return {
        "entries": verdict.entries,
        "first": verdict.first.number if verdict.first else None,
        "last": last.number if last else None,
        "head": last.hash if last else None,
        "flaw": verdict.flaw._asdict() if verdict.flaw else None,
        "torn_bytes": verdict.torn,
        "closed": verdict.closed,
        "head_at": verdict.head_at,
    }


def entry_text(entry: Entry) -> str:
    """One entry on one line."""
    noted = entry.noted
    details = ", ".join(f"{name} {value}" for name, value in noted.details.items() if value != "")
    axis = f" axis {noted.axis}:" if noted.axis else ""
    text = f"{entry.number:6d} {noted.utc} {noted.event}:{axis} {details}"
    return printable(text)


def _open_end(verdict: Verdict) -> str:
    torn = f" (its last {verdict.torn} bytes are half an entry)" if verdict.torn else ""
    return (
        f"the log does not end with a closing entry{torn}: its daemon runs, was killed, or its end was cut; "
        "a chain alone can not tell, compare the head with one that was noted elsewhere"
    )
