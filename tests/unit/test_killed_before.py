"""A daemon that was killed has no closing entry; the next one says so."""

from pathlib import Path

from forefeel.common.audit import parse, verify
from forefeel.common.clock import MonotonicClock
from forefeel.common.state.folder import AUDIT, StateFolder
from forefeel.common.state.journal import StateJournal


def daemon(folder: Path, killed: bool = False) -> list[str]:
    """One daemon's life; the events of the log then."""
    with StateFolder(folder) as state:
        journal = StateJournal(state, MonotonicClock(), ["a"], keep=1)
        journal.start({"role": "slave"})
        if not killed:
            journal.close("ended")
        else:
            before = (folder / AUDIT).read_bytes
            journal.note("refused", 1, name="late")
            while b"refused" not in before():
                pass
            whole = before()
            journal.close("ended")
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
