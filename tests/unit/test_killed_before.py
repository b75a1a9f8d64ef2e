"""A daemon that was killed has no closing entry; the next one says so."""

from pathlib import Path

from forefeel.common.clock import MonotonicClock
from forefeel.common.events.audit import parse, verify
from forefeel.common.state.audit_sink import StateAuditSink
from forefeel.common.state.folder import AUDIT, StateFolder


def daemon(folder: Path, killed: bool = False) -> list[str]:
    """One daemon's life; the events of the log then."""
    with StateFolder(folder) as state:
        audit_sink = StateAuditSink(state, MonotonicClock(), ["a"], keep=1)
        audit_sink.start({"role": "slave"})
        if not killed:
            audit_sink.close("ended")
        else:
            before = (folder / AUDIT).read_bytes
            audit_sink.note("refused", 1, name="late")
            while b"refused" not in before():
                pass
            whole = before()
            audit_sink.close("ended")
            (folder / AUDIT).write_bytes(whole)  # as a kill leaves it
    with (folder / AUDIT).open("rb") as lines:
        assert verify(lines).intact
    return [parse(line).noted.event for line in (folder / AUDIT).read_bytes().splitlines()]


def test_the_next_one_says_that_the_one_before_was_killed(tmp_path: Path) -> None:
    assert daemon(tmp_path / "state") == ["start", "stop"]
    assert daemon(tmp_path / "state", killed=True) == ["start", "stop", "start", "refused"]
    after = ["start", "stop", "start", "refused", "previous_not_closed", "start", "stop"]
    assert daemon(tmp_path / "state") == after
    assert daemon(tmp_path / "state") == [*after, "start", "stop"]
