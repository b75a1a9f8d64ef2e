"""Status lights of link, lease, safety, deadman and force. Pure: time is an argument."""

from typing import Any, NamedTuple

from forefeel.common.events.console import printable
from forefeel.common.events.text import REFUSED, WARNINGS, is_long_round_trip, quantity, span
from forefeel.common.messages import SafetyState, SlaveState
from forefeel.common.topics import MASTER_STATE, SLAVE_STATE, Topic
from forefeel.dashboard.axis_view import AxisView
from forefeel.dashboard.event_log import Level

S = SafetyState
_SAFETY: dict[SafetyState, tuple[Level, str]] = {
    S.IDLE: ("off", "waits for a master"),
    S.READY: ("off", "holds; the deadman engages it"),
    S.ENGAGING: ("busy", "aligns with the hand"),
    S.ARMED: ("good", "the stage follows the hand"),
    S.STOPPING: ("busy", "comes to rest"),
    S.FAULT: ("bad", "at rest until it is cleared at the slave"),
    S.ESTOPPED: ("bad", "at rest until it is cleared at the slave"),
}
_SHOWN = {S.ESTOPPED: "emergency stop"}


class Light(NamedTuple):
    """One thing that is watched: what it is, how it stands, in a word and in a sentence."""

    name: str
    level: Level
    word: str
    more: str = ""


def lights(view: AxisView, now_ns: int) -> list[Light]:
    every = [_link(view, now_ns), _lease(view, now_ns), _safety(view, now_ns), _deadman(view, now_ns)]
    return [*every, _force(view, now_ns)]


def _quiet(view: AxisView, state: Topic[Any], now_ns: int) -> str:
    """Sentence on an end whose state was never received, or is stale; empty for one that is heard."""
    heard_ns = view.newest.heard_ns.get(state.name)
    if heard_ns is None:
        return f"no {state.publisher} heard yet"
    age_s = (now_ns - heard_ns) * 1e-9
    return f"{state.publisher} silent for {span(age_s)}" if age_s > (state.stale_after_s or 0.0) else ""


def _link(view: AxisView, now_ns: int) -> Light:
    """Light of the link: `off` until both ends were heard and had a session, `warn` where the slave refuses
    one or the round trip is long, `bad` where a link is lost or the handle has failed, else `good`.
    """
    quiet = {state: text for state in (MASTER_STATE, SLAVE_STATE) if (text := _quiet(view, state, now_ns))}
    if quiet:
        lost = any(state.name in view.newest.heard_ns for state in quiet)
        level: Level = "bad" if lost else "off"
        return Light("link", level, "silent" if lost else "waits", "; ".join(quiet.values()))
    state = view.newest.master
    assert state is not None
    if state.indication == "no_session":
        level = "bad" if view.had_session else "warn" if state.reason.startswith(REFUSED) else "off"
        return Light("link", level, "no link", printable(state.reason))
    if state.indication == "handle_fault":
        return Light("link", "bad", "handle fault", printable(state.reason))
    if is_long_round_trip(state.reason):
        return Light("link", "warn", "too slow", printable(state.reason))
    return Light("link", "good", "linked", "both ends heard")


def _lease(view: AxisView, now_ns: int) -> Light:
    """Light of the lease: `off` where no master holds it, or slave or master are silent; `warn` where the
    slave serves another session than this master's, else `good`.
    """
    slave, master = view.newest.slave, view.newest.master
    if slave is None or _quiet(view, SLAVE_STATE, now_ns):
        return Light("lease", "off", "unknown", "no slave")
    if not slave.session_id:
        return Light("lease", "off", "free", "no master holds it")
    if master is None or _quiet(view, MASTER_STATE, now_ns):
        return Light("lease", "off", "held", "by a master that is not heard here")
    if slave.session_id != master.session_id:
        return Light("lease", "warn", "held by another", "the slave serves another session")
    return Light("lease", "good", "held", "by this master")


def _safety(view: AxisView, now_ns: int) -> Light:
    """Light of the slave's safety state, with its meaning and reason, in READY also the caveats; `off` before
    the first state, `bad` once that is stale.
    """
    slave, quiet = view.newest.slave, _quiet(view, SLAVE_STATE, now_ns)
    if slave is None:
        return Light("safety", "off", "unknown", quiet)
    word = safety_word(slave)
    if quiet:
        return Light("safety", "bad", "unknown", f"{quiet}; was {word}")
    level, meaning = _SAFETY[slave.state]
    caveats = slave.caveats if slave.state is S.READY else ()  # before it is armed
    return Light("safety", level, word, " · ".join((meaning, *map(printable, (*caveats, slave.reason)))))


def safety_word(slave: SlaveState) -> str:
    return _SHOWN.get(slave.state, slave.state.value)


def _deadman(view: AxisView, now_ns: int) -> Light:
    """Light of the deadman: `good` while pressed, else `off`: released, or unknown, without a master."""
    master = view.newest.master
    if master is None or _quiet(view, MASTER_STATE, now_ns):
        return Light("deadman", "off", "unknown", "no master")
    if master.deadman:
        return Light("deadman", "good", "pressed", "may move")
    return Light("deadman", "off", "released", "no motion")


def _force(view: AxisView, now_ns: int) -> Light:
    """Light of the force: `off` without a slave, `bad` above its limit, else `good`. Below the limit a `warn`
    light of the instrument replaces it while that is near its load, or once it slipped through the jaws.
    """
    slave = view.newest.slave
    if slave is None or _quiet(view, SLAVE_STATE, now_ns):
        return Light("force", "off", "unknown", "no slave")
    if slave.over_limit:
        return Light("force", "bad", "above limit")
    if slave.near_load:
        return Light("instrument", "warn", "near its load", WARNINGS.get(slave.near_load, ""))
    if slave.slipped_since_ns is not None:
        lost = f"about {quantity(slave.slipped_m, 'm')} lost, " if slave.slipped_m else ""
        since_s = max(0, slave.stamp_ns - slave.slipped_since_ns) * 1e-9
        return Light("instrument", "warn", "slipped", f"{lost}first {span(since_s)} ago")
    return Light("force", "good", "within limit")
