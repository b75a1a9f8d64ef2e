"""The state folder, and the audit log in it: crashes, restarts, a full disk, a log that is too large."""

import errno
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from forefeel.common.clock import MonotonicClock, WallClock
from forefeel.common.config import checked
from forefeel.common.errors import ConfigurationError
from forefeel.common.events.audit import Entry, Noted, Verdict, parse, verify
from forefeel.common.settings import DaemonSettings
from forefeel.common.state.audit_file import AuditFile
from forefeel.common.state.audit_sink import StateAuditSink
from forefeel.common.state.audit_writer import AuditWriter
from forefeel.common.state.folder import AUDIT, LATCHED, StateFolder, holder, state_path
from forefeel.common.state.latch import latched
from tests.waiting import wait_until

CLOCK = MonotonicClock()


def verified(path: Path) -> Verdict:
    return verify(path.read_bytes().splitlines(keepends=True))


MOVED = ("engaging", "armed", "stopping")


def no_room(*_: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


class Daemon:
    """The state of a daemon, from start to end or to a crash."""

    def __init__(self, path: Path) -> None:
        self.folder = StateFolder(path)
        self.audit_sink = StateAuditSink(self.folder, CLOCK, ["a"], keep=3)
        self.audit_sink.start({"role": "slave"})
        self.log = path / AUDIT

    def note(self, event: str, /, **details: str) -> None:
        self.audit_sink.note(event, CLOCK.now_ns(), "a", **details)

    def transition(self, before: str, after: str, reason: str = "why") -> None:
        self.note("safety", before=before, event="e", after=after, reason=reason)

    def entries(self) -> list[Entry]:
        return [parse(line) for line in self.log.read_bytes().splitlines()]

    def events(self) -> list[str]:
        return [entry.noted.event for entry in self.entries()]

    def end(self) -> str | None:
        _, problem = self.audit_sink.close("asked to")
        self.folder.close()
        return problem


@pytest.fixture
def state(tmp_path: Path) -> Iterator[Callable[[], Daemon]]:
    started: list[Daemon] = []

    def start() -> Daemon:
        started.append(Daemon(tmp_path / "state"))
        return started[-1]

    yield start
    for daemon in started:
        daemon.end()


# --- the folder ---


def test_it_is_made_for_its_owner_alone_and_by_one_daemon_at_a_time(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "state"
    assert holder(path) is None
    with StateFolder(path):
        assert holder(path) == os.getpid()
        assert path.stat().st_mode & 0o777 == 0o700
        with pytest.raises(ConfigurationError, match=rf"in use by another daemon \(process {os.getpid()}\)"):
            StateFolder(path)
    StateFolder(path).close()
    assert holder(path) is None, "the file is still there, its lock is not"


def test_one_that_others_can_write_to_or_that_is_a_file_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    (tmp_path / "file").touch()
    for name, word in (("open", "mode 0777"), ("file", "File exists"), ("file/in", "Not a directory")):
        with pytest.raises(ConfigurationError, match=word) as caught:
            StateFolder(tmp_path / name)
        assert "\n" not in str(caught.value)


def test_where_it_is() -> None:
    settings = DaemonSettings(cell="lab")
    home = {"XDG_STATE_HOME": "/xdg"}
    assert state_path(settings, "slave", home) == Path("/xdg/forefeel/lab-slave")
    assert state_path(settings, "slave", {**home, "STATE_DIRECTORY": "/var/lib/a:/b"}) == Path(
        "/var/lib/a/lab-slave"
    )
    assert state_path(settings, "master", {}) == Path.home() / ".local/state/forefeel/lab-master"
    named = checked(DaemonSettings, {"state": {"directory": "st"}}, "x", directory=Path("/conf"))
    assert state_path(named, "slave", home) == Path("/conf/st")


# --- the audit log ---


def test_what_happened_is_chained_over_restarts(state: Callable[[], Daemon]) -> None:
    for _ in range(3):
        daemon = state()
        daemon.note("refused", name="late")
        assert daemon.end() is None
    assert daemon.events() == ["start", "refused", "stop"] * 3
    verdict = verified(daemon.log)
    assert verdict.intact and verdict.closed
    assert daemon.log.stat().st_mode & 0o777 == 0o600


def test_half_an_entry_of_a_crash_is_cut_off_and_said(state: Callable[[], Daemon]) -> None:
    daemon = state()
    daemon.end()
    whole = daemon.log.read_bytes()
    daemon.log.write_bytes(whole + whole[:50])
    again = state()
    again.end()
    assert again.events() == ["start", "stop", "log_recovered", "start", "stop"]
    assert whole[:50].decode() == again.entries()[2].noted.details["text"]
    assert verified(again.log).intact


def test_a_changed_last_entry_is_kept_aside_and_a_new_chain_begins(
    state: Callable[[], Daemon],
) -> None:
    daemon = state()
    daemon.end()
    daemon.log.write_bytes(daemon.log.read_bytes().replace(b"asked to", b"asked no"))
    again = state()
    again.end()
    assert again.events()[0] == "log_damaged"
    assert verified(again.log).intact
    assert b"asked no" in (again.log.parent / "audit-damaged.jsonl").read_bytes()


def test_a_log_that_is_too_large_is_set_aside_and_the_next_goes_on_with_the_chain(tmp_path: Path) -> None:
    path = tmp_path / AUDIT
    file = AuditFile(path)
    file.largest = 1000
    for number in range(8):
        file.write([Noted("2026", number, "refused", "a", {"text": "x" * 200})])
    end = file.end
    file.close()
    parts = [*sorted(tmp_path.glob("audit-*.jsonl")), path]
    assert len(parts) > 1
    verdicts = [verified(part) for part in parts]
    assert all(verdict.intact for verdict in verdicts)
    for before, after in pairwise(verdicts):
        assert before.last is not None and after.first is not None
        assert after.first.previous == before.last.hash
        assert after.first.noted.event == "continued"
    assert verdicts[-1].last is not None and verdicts[-1].last.hash == end.hash
    headless = path.read_bytes().splitlines(keepends=True)[1:]
    assert not verify(headless).intact


class FullDisk:
    """The file system says that it is full, of the reserve or of writing, too."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.full = self.reserve_gone = False
        self.inner = os.pwrite
        real = os.fstatvfs

        def fstatvfs(descriptor: int) -> os.statvfs_result:
            found = real(descriptor)
            return os.statvfs_result([*found[:3], 0, 0, *found[5:]]) if self.full else found

        monkeypatch.setattr("forefeel.common.state.audit_file.os.fstatvfs", fstatvfs)
        monkeypatch.setattr("forefeel.common.state.audit_file.os.pwrite", self.pwrite)

    def pwrite(self, descriptor: int, data: bytes, offset: int) -> int:
        if self.reserve_gone:
            self.inner(descriptor, data[: len(data) // 2], offset)  # as much as there is room for
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return self.inner(descriptor, data, offset)


def started(state: Callable[[], Daemon], monkeypatch: pytest.MonkeyPatch) -> tuple[FullDisk, Daemon]:
    """A disk that is not full yet, and a daemon on it that has written its first entry."""
    disk, daemon = FullDisk(monkeypatch), state()
    wait_until(lambda: daemon.events() == ["start"])
    return disk, daemon


def test_a_full_disk_is_a_problem_that_is_written_and_ends(
    state: Callable[[], Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    disk, daemon = started(state, monkeypatch)
    assert daemon.audit_sink.problem(CLOCK.now_ns()) is None
    disk.full = True
    daemon.note("refused", name="late")
    wait_until(lambda: daemon.audit_sink.problem(CLOCK.now_ns()))
    wait_until(lambda: len(daemon.events()) == 3)
    assert sorted(daemon.events()) == ["disk_full", "refused", "start"]
    daemon.transition("armed", "fault")
    disk.full = False
    daemon.note("refused", name="late")
    wait_until(lambda: daemon.audit_sink.problem(CLOCK.now_ns()) is None)
    assert daemon.end() is None
    assert set(daemon.events()[3:]) == {"safety", "refused", "log_written_again", "stop"}
    assert verified(daemon.log).intact


def test_what_can_not_be_written_waits_and_nothing_half_written_stays(
    state: Callable[[], Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    disk, daemon = started(state, monkeypatch)
    disk.reserve_gone = True
    daemon.note("refused", name="late")
    wait_until(lambda: daemon.audit_sink.problem(CLOCK.now_ns()))
    assert daemon.events() == ["start"]
    disk.reserve_gone = False
    daemon.note("refused", name="again")
    wait_until(lambda: daemon.audit_sink.problem(CLOCK.now_ns()) is None and len(daemon.events()) == 4)
    assert [e.noted.details.get("name") for e in daemon.entries()] == [None, None, "late", "again"]
    assert daemon.events()[1] == "log_written_again"
    assert verified(daemon.log).intact


def test_a_write_that_never_comes_back_is_a_problem(
    state: Callable[[], Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    stuck = threading.Event()
    daemon = state()
    wait_until(lambda: daemon.events() == ["start"])
    monkeypatch.setattr("forefeel.common.state.audit_file.os.fdatasync", lambda _: stuck.wait(10))
    daemon.note("refused", name="late")
    time.sleep(0.05)
    assert daemon.audit_sink.problem(CLOCK.now_ns()) is None
    assert "not come back" in (daemon.audit_sink.problem(CLOCK.now_ns() + 11_000_000_000) or "")
    stuck.set()


def test_many_more_entries_than_can_wait_are_counted_and_said(
    state: Callable[[], Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    disk, daemon = started(state, monkeypatch)
    disk.reserve_gone = True
    for number in range(4096 + 100):
        daemon.note("refused", name=str(number))
    disk.reserve_gone = False
    daemon.note("refused", name="last")
    assert daemon.end() is None
    lost = [e.noted.details["count"] for e in daemon.entries() if e.noted.event == "entries_lost"]
    kept = daemon.events().count("refused")
    assert sum(map(int, map(str, lost))) + kept == 4096 + 101
    assert daemon.events()[-1] == "stop"
    refused = [e.noted.details["name"] for e in daemon.entries() if e.noted.event == "refused"]
    assert refused[-1] == "last", "it is the oldest that are lost"


def test_nothing_follows_the_closing_entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The disk has room again between the closing entry and the end of the writer's thread."""
    disk, log = FullDisk(monkeypatch), tmp_path / AUDIT
    writer = AuditWriter(log, WallClock())
    writer.start(0)
    disk.full = True
    writer.note("refused", 0, "a", {})
    wait_until(lambda: b"disk_full" in log.read_bytes())
    writer.note("stop", 0, "", {})
    wait_until(lambda: b'"stop"' in log.read_bytes())
    disk.full = False
    assert writer.close() is None
    assert verified(log).closed


def test_what_is_noted_while_a_failed_batch_is_put_back_is_kept_or_counted(
    state: Callable[[], Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Many threads note for as long as the disk refuses every batch, more than can wait."""
    monkeypatch.setattr("forefeel.common.state.audit_writer._WAITING", 16)
    monkeypatch.setattr("forefeel.common.state.audit_writer._RETRY_S", 0.0)
    disk, daemon = started(state, monkeypatch)
    disk.reserve_gone = True
    usual_s = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)

    def note() -> None:
        for _ in range(500):
            daemon.note("refused")

    threads = [threading.Thread(target=note) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    sys.setswitchinterval(usual_s)
    disk.reserve_gone = False
    assert daemon.end() is None
    lost = [e.noted.details["count"] for e in daemon.entries() if e.noted.event == "entries_lost"]
    assert sum(map(int, map(str, lost))) + daemon.events().count("refused") == 4 * 500


# --- flight records ---


def test_a_recorder_that_has_ended_is_a_problem_to_the_end(
    state: Callable[[], Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise ValueError("no such number")

    monkeypatch.setattr("forefeel.common.state.flight_writer.RunWriter", broken)
    monkeypatch.setattr("forefeel.common.state.flight_writer.AFTER_NS", 0)
    daemon = state()
    daemon.audit_sink.flight("a", "fault", "x", CLOCK.now_ns())
    wait_until(lambda: "flight_failed" in daemon.events())
    assert "flight recorder: its thread has ended" in (daemon.audit_sink.problem(CLOCK.now_ns()) or "")
    assert "flight recorder: its thread has ended" in (daemon.end() or "")


def test_the_end_that_the_other_end_is_told_moves_with_news_only(state: Callable[[], Daemon]) -> None:
    daemon = state()
    wait_until(lambda: daemon.audit_sink.head().number == 1)
    daemon.note("peer_log", number="7", head="0")
    wait_until(lambda: daemon.events() == ["start", "peer_log"])
    assert daemon.audit_sink.head().number == 1, "two logs would note each other for ever"
    daemon.note("refused", name="late")
    wait_until(lambda: daemon.audit_sink.head().number == 3)
    assert daemon.audit_sink.head().hash == daemon.entries()[-1].hash
    daemon.end()
    assert state().audit_sink.head().number >= 4


# --- what is latched ---


def test_a_stop_and_a_fault_of_a_motion_outlive_the_daemon_until_they_are_cleared(
    state: Callable[[], Daemon],
) -> None:
    for before, after in (("armed", "estopped"), *((moved, "fault") for moved in MOVED)):
        daemon = state()
        assert daemon.audit_sink.latched == {}
        daemon.transition(before, after, "why it stands")
        daemon.end()
        again = state()
        assert again.audit_sink.latched == {"a": "why it stands"}
        again.transition(after, "idle")
        again.transition("ready", "fault", "of a stage that rests")
        again.end()
    assert state().audit_sink.latched == {}


def test_a_stop_that_could_not_be_latched_is_a_problem_until_it_is(
    state: Callable[[], Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("forefeel.common.state.latch._RETRY_S", 0.01)
    daemon = state()
    with monkeypatch.context() as broken:
        broken.setattr("forefeel.common.state.latch._put", no_room)
        daemon.transition("armed", "estopped", "nurse: pressed")
        assert not daemon.audit_sink.kept("a")
        wait_until(lambda: "latch_not_kept" in daemon.events())
        assert daemon.audit_sink.problem(CLOCK.now_ns()) == "latch: No space left on device"
    wait_until(lambda: "latch_written_again" in daemon.events())
    assert daemon.audit_sink.kept("a")
    assert daemon.audit_sink.problem(CLOCK.now_ns()) is None
    assert latched(daemon.log.parent / LATCHED) == {"a": "nurse: pressed"}, "as it is after a kill"
    assert daemon.end() is None
    start, *told, again, stop = daemon.events()
    assert (start, again, stop) == ("start", "latch_written_again", "stop")
    assert sorted(told) == ["latch_not_kept", "safety"], "the latch's thread waits for nobody"


def test_a_daemon_that_ends_with_a_stop_that_is_not_latched_says_so(
    state: Callable[[], Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    daemon = state()
    with monkeypatch.context() as broken:
        broken.setattr("forefeel.common.state.latch._put", no_room)
        daemon.transition("armed", "estopped", "nurse: pressed")
        assert daemon.end() == "latch: No space left on device"


UNREADABLE, GONE = "what was latched can not be read", "the file of what was latched is gone"


@pytest.mark.parametrize(
    ("content", "found"),
    [
        ("{", UNREADABLE),
        ("{}", UNREADABLE),
        ("", UNREADABLE),
        ("[]", UNREADABLE),
        ('{"a": "as the version before wrote it"}', UNREADABLE),
        ('{"latched": {"a": "nurse"}} {"latched"', UNREADABLE),
        ('{"latched": {"b": "nurse"}}', "axis 'b' was latched, which is none of a"),
        (None, GONE),
    ],
)
def test_a_latch_that_can_not_be_trusted_stops_every_axis_until_it_is_cleared(
    state: Callable[[], Daemon], content: str | None, found: str
) -> None:
    daemon = state()
    daemon.end()
    path = daemon.log.parent / LATCHED
    path.unlink()
    if content is not None:
        path.write_text(content)
    for _ in range(2):  # and a new start does not forget it
        again = state()
        assert again.audit_sink.latched == {"": found}
        again.end()
    last = state()
    last.transition("idle", "estopped", found)
    last.transition("estopped", "idle")
    last.end()
    assert state().audit_sink.latched == {}


@pytest.mark.parametrize("name", [AUDIT, LATCHED, "lock", "flight"])
@pytest.mark.parametrize("to", ["elsewhere", "nowhere"])
def test_a_link_in_the_folder_is_refused_and_nothing_is_written_through_it(
    tmp_path: Path, name: str, to: str
) -> None:
    folder = tmp_path / "state"
    folder.mkdir(mode=0o700)
    (tmp_path / "elsewhere").write_text("precious")
    (folder / name).symlink_to(tmp_path / to)
    with pytest.raises(ConfigurationError, match=f"{name} is a link") as caught:
        StateFolder(folder)
    assert "\n" not in str(caught.value)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["elsewhere", "state"]
    assert (tmp_path / "elsewhere").read_text() == "precious"


@pytest.mark.root
@pytest.mark.skipif(os.geteuid() != 0, reason="only root makes files of other users")
def test_what_is_another_user_s_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "state"
    folder.mkdir(mode=0o700)
    (folder / AUDIT).touch()
    os.chown(folder / AUDIT, 12345, 12345)
    with pytest.raises(ConfigurationError, match=f"{AUDIT} is of user 12345"):
        StateFolder(folder)
    os.chown(folder, 12345, 12345)
    with pytest.raises(ConfigurationError, match="of user 12345; expected one of the daemon's own user 0"):
        StateFolder(folder)
