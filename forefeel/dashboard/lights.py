"""How link, lease and safety stand: a light and a word for each. Pure: time is an argument."""

from forefeel.common.events.console import printable
from forefeel.common.events.text import is_long_round_trip, span
from forefeel.common.messages import SafetyState, SlaveState
from forefeel.common.topics import MASTER_STATE, SLAVE_STATE
from forefeel.dashboard.axis_view import AxisView
from forefeel.dashboard.levels import BAD, BUSY, GOOD, OFF, WARN, Level, Light

S = SafetyState
_SAFETY: dict[SafetyState, tuple[Level, str]] = {
    S.IDLE: (OFF, "waits for a master"),
    S.READY: (OFF, "holds; the deadman engages it"),
    S.ENGAGING: (BUSY, "aligns with the hand"),
    S.ARMED: (GOOD, "the stage follows the hand"),
    S.STOPPING: (WARN, "comes to rest"),
    S.FAULT: (BAD, "at rest until it is cleared at the slave"),
    S.ESTOPPED: (BAD, "at rest until it is cleared at the slave"),
}
_SHOWN = {S.ESTOPPED: "emergency stop"}
SILENT_NS = 2_000_000_000
"""A cell that says nothing for so long is silent."""


def lights(view: AxisView, now_ns: int) -> list[Light]:
    """Link, lease, safety and deadman of an axis."""
    return [_link(view, now_ns), _lease(view, now_ns), _safety(view, now_ns), _deadman(view, now_ns)]


def silent_s(heard_ns: int | None, now_ns: int, since_ns: int) -> float | None:
    """For how long nothing was heard, None while something is; `since_ns`: when one began to listen."""
    quiet_ns = now_ns - (since_ns if heard_ns is None else heard_ns)
    return quiet_ns * 1e-9 if quiet_ns > SILENT_NS else None


def _quiet(view: AxisView, topic: str, stale_s: float | None, now_ns: int) -> str:
    """What there is to say of an end that is not heard, or empty."""
    heard_ns, who = view.newest.heard_ns.get(topic), topic.partition("/")[0]
    if heard_ns is None:
        return f"no {who} heard yet"
    age_s = (now_ns - heard_ns) * 1e-9
    return f"{who} silent for {span(age_s)}" if age_s > (stale_s or 0.0) else ""


def _slave_quiet(view: AxisView, now_ns: int) -> str:
    return _quiet(view, SLAVE_STATE.name, SLAVE_STATE.stale_after_s, now_ns)


def _master_quiet(view: AxisView, now_ns: int) -> str:
    return _quiet(view, MASTER_STATE.name, MASTER_STATE.stale_after_s, now_ns)


def _link(view: AxisView, now_ns: int) -> Light:
    quiet = [text for text in (_master_quiet(view, now_ns), _slave_quiet(view, now_ns)) if text]
    if quiet:
        return Light("link", BAD, "silent", "; ".join(quiet))
    state = view.newest.master
    assert state is not None
    if state.indication == "no_session":
        return Light("link", BAD, "no link", printable(state.reason))
    if state.indication == "handle_fault":
        return Light("link", BAD, "handle fault", printable(state.reason))
    if is_long_round_trip(state.reason):
        return Light("link", WARN, "too slow", printable(state.reason))
    return Light("link", GOOD, "linked", "both ends heard")


def _lease(view: AxisView, now_ns: int) -> Light:
    slave, master = view.newest.slave, view.newest.master
    if slave is None or _slave_quiet(view, now_ns):
        return Light("lease", OFF, "unknown", "no slave")
    if not slave.session_id:
        return Light("lease", OFF, "free", "no master holds it")
    if master is None or _master_quiet(view, now_ns):
        return Light("lease", WARN, "held", "by a master that is not heard here")
    if slave.session_id != master.session_id:
        return Light("lease", WARN, "held by another", "the slave serves another session")
    return Light("lease", GOOD, "held", "by this master")


def _safety(view: AxisView, now_ns: int) -> Light:
    slave, quiet = view.newest.slave, _slave_quiet(view, now_ns)
    if slave is None:
        return Light("safety", OFF, "unknown", quiet)
    word = safety_word(slave)
    if quiet:
        return Light("safety", BAD, "unknown", f"{quiet}; was {word}")
    level, meaning = _SAFETY[slave.state]
    return Light("safety", level, word, f"{meaning} · {printable(slave.reason)}")


def safety_word(slave: SlaveState) -> str:
    return _SHOWN.get(slave.state, slave.state.value)


def _deadman(view: AxisView, now_ns: int) -> Light:
    master = view.newest.master
    if master is None or _master_quiet(view, now_ns):
        return Light("deadman", OFF, "unknown", "no master")
    if master.deadman:
        return Light("deadman", GOOD, "pressed", "may move")
    return Light("deadman", OFF, "released", "no motion")
