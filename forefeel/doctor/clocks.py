"""How well are the clocks of both ends compared in the session that runs, and is this host's disciplined?"""

import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from forefeel.common.bus import Bus
from forefeel.common.clock import MonotonicClock
from forefeel.common.errors import ForefeelError
from forefeel.common.messages import MasterState, SlaveState
from forefeel.common.topics import MASTER_STATE, SLAVE_STATE
from forefeel.common.transport.security import Party
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_bus import ZenohTransport
from forefeel.doctor.findings import Finding

GROUP = "clock"
# ns, uncertainty of the offset; chosen, not measured: one and ten periods at 1 kHz
_GOOD_NS, _ACCEPTABLE_NS = 1_000_000, 10_000_000
_PATIENCE_S = 1.5  # s in which states are heard; chosen, not measured: the rarer ones come ten times a second
# s of offset from which the clock has not settled; chosen, not measured: larger calls a worse clock good
_FAR_S = 0.1
_TOOL_TIMEOUT_S = 2.0  # s for the tool's answer; chosen, not measured: it asks a daemon on this host


@dataclass(frozen=True, slots=True)
class Compared:
    """What one end says of the clocks. `session`: it holds one; None of both numbers: not compared."""

    end: str
    axis: str
    session: bool
    offset_ns: int | None
    bound_ns: int | None


@dataclass(frozen=True, slots=True)
class Discipline:
    """What keeps this host's clock: chrony or PTP; its offset now in s, and whether it follows a source."""

    tool: str
    offset_s: float
    follows: bool


def hear_states(
    transport: TransportSettings,
    party: Party | None,
    cell: str,
    axes: Sequence[str],
    patience_s: float = _PATIENCE_S,
) -> tuple[list[Compared], str]:
    """The newest state of each end and axis that is heard within that time, and why nothing could be."""
    newest: dict[tuple[str, str], Compared] = {}

    def hear(end: str, axis: str, state: SlaveState | MasterState, receive_ns: int) -> None:
        del receive_ns
        session = state.session_id != 0
        newest[end, axis] = Compared(end, axis, session, state.clock_offset_ns, state.clock_bound_ns)

    try:
        clock = MonotonicClock()
        zenoh = ZenohTransport.open(transport, clock, lambda _: None, party, insecure=True)
    except ForefeelError as error:
        return [], str(error)
    try:
        for axis in axes:
            bus = Bus(zenoh, cell, axis, clock)
            bus.subscribe(SLAVE_STATE, partial(hear, "slave", axis))
            bus.subscribe(MASTER_STATE, partial(hear, "master", axis))
        clock.sleep_until_ns(clock.now_ns() + round(patience_s * 1e9))
    finally:
        zenoh.close()
    return [newest[key] for key in sorted(newest)], ""


def judge_clocks(found: Sequence[Compared], error: str = "") -> list[Finding]:
    """By the bound of the offset: good below 1 ms, acceptable to 10 ms, above that poor; unknown is amber."""
    if not found:
        why = error or "no daemon of this cell is heard"
        advice = "start slave and master, then ask again"
        return [Finding(GROUP, "between the ends", "amber", f"unknown: {why}", advice)]
    return [_judge_one(each) for each in found]


def _judge_one(found: Compared) -> Finding:
    subject = f"{found.end}, axis {found.axis}"
    if found.offset_ns is None or found.bound_ns is None:
        if found.session:
            advice = "both ends of one release, and no program between them that drops heartbeats"
            return Finding(GROUP, subject, "red", "unknown in an open session: nothing arms", advice)
        return Finding(GROUP, subject, "amber", "unknown: no session", "start both ends, then ask again")
    words = f"offset {found.offset_ns * 1e-6:.3f} ms, known to {found.bound_ns * 1e-6:.3f} ms"
    if found.bound_ns < _GOOD_NS:
        return Finding(GROUP, subject, "green", f"{words}: good")
    if found.bound_ns <= _ACCEPTABLE_NS:
        return Finding(GROUP, subject, "green", f"{words}: acceptable")
    advice = "half the round trip; take the ages of forces as that uncertain, or use a shorter way"
    return Finding(GROUP, subject, "amber", f"{words}: poor", advice)


def ask_discipline() -> list[Discipline]:
    """chrony and ptp4l of this host, those that answer."""
    chrony = _answer(["chronyc", "-c", "tracking"])
    ptp = _answer(["pmc", "-u", "-b", "0", "GET TIME_STATUS_NP"])
    return [each for each in (parse_chrony(chrony), parse_ptp(ptp)) if each is not None]


def parse_chrony(text: str) -> Discipline | None:
    """Of `chronyc -c tracking`: reference, name, stratum, time, the clock's offset in s, ..., leap."""
    fields = text.strip().split(",")
    try:
        return Discipline("chrony", float(fields[4]), int(fields[2]) > 0 and fields[13] != "Not synchronised")
    except (IndexError, ValueError):
        return None


def parse_ptp(text: str) -> Discipline | None:
    """Of `pmc GET TIME_STATUS_NP`: `master_offset` in ns, `gmPresent`."""
    words = dict(line.split()[:2] for line in text.splitlines() if len(line.split()) >= 2)
    try:
        return Discipline("PTP", int(words["master_offset"]) * 1e-9, words.get("gmPresent") == "true")
    except (KeyError, ValueError):
        return None


def judge_discipline(found: Sequence[Discipline]) -> list[Finding]:
    """This host's clock of the day: it dates certificates and the event log, never a command."""
    if not found:
        what, advice = (
            "neither chrony nor PTP answers",
            "install chrony: certificates and the event log have dates",
        )
        return [Finding(GROUP, "this host", "amber", f"unknown: {what}", advice)]
    return [_judge_discipline(each) for each in found]


def _judge_discipline(found: Discipline) -> Finding:
    subject, words = f"this host, {found.tool}", f"offset {found.offset_s * 1e3:.3f} ms"
    if not found.follows:
        return Finding(
            GROUP, subject, "red", f"follows no source; {words}", "name a source that can be reached"
        )
    if abs(found.offset_s) > _FAR_S:
        return Finding(GROUP, subject, "amber", words, "wait until it has settled")
    return Finding(GROUP, subject, "green", words)


def _answer(command: list[str]) -> str:
    """What the tool prints; empty where there is none or it fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_TOOL_TIMEOUT_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout if done.returncode == 0 else ""
