"""The state folder of a daemon: whose it is, the event log, and the latch that outlives the daemon."""

import errno
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from forefeel.common.clock import MonotonicClock
from forefeel.common.config import checked
from forefeel.common.errors import ConfigurationError
from forefeel.common.state.event_log import EventLog, StateEventSink
from forefeel.common.state.folder import EVENTS, LATCHED, StateFolder, holder, state_path
from forefeel.common.state.latch import Latch, latched
from forefeel.slave.settings import SlaveSettings
from tests.stepped import SteppedWorker

STOPPED = {"before": "armed", "after": "estopped", "reason": "pressed"}
CLEARED = {"before": "estopped", "after": "idle", "reason": "cleared"}


def no_room(*_: object) -> int:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_bytes().splitlines()]


# --- the folder ---


def test_folder_is_for_its_owner_and_one_daemon(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "state"
    assert holder(path) is None
    with StateFolder(path):
        assert holder(path) == os.getpid()
        assert path.stat().st_mode & 0o777 == 0o700
        with pytest.raises(ConfigurationError, match=rf"process {os.getpid()}\b"):
            StateFolder(path)
    StateFolder(path).close()
    assert holder(path) is None, "the file is still there, its lock is not"


def test_folder_that_others_can_write_is_refused(tmp_path: Path) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    (tmp_path / "file").touch()
    for name in ("open", "file", "file/in"):
        with pytest.raises(ConfigurationError) as caught:
            StateFolder(tmp_path / name)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", [EVENTS, LATCHED, "lock", "flight"])
@pytest.mark.parametrize("to", ["elsewhere", "nowhere"])
def test_link_in_folder_is_refused(tmp_path: Path, name: str, to: str) -> None:
    folder = tmp_path / "state"
    folder.mkdir(mode=0o700)
    (tmp_path / "elsewhere").write_text("precious")
    (folder / name).symlink_to(tmp_path / to)
    with pytest.raises(ConfigurationError, match=name):
        StateFolder(folder)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["elsewhere", "state"]
    assert (tmp_path / "elsewhere").read_text() == "precious"


@pytest.mark.root
@pytest.mark.skipif(os.geteuid() != 0, reason="only root makes files of other users")
def test_folder_of_another_user_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "state"
    folder.mkdir(mode=0o700)
    (folder / EVENTS).touch()
    for path in folder / EVENTS, folder:
        os.chown(path, 12345, 12345)
        with pytest.raises(ConfigurationError, match="of user 12345"):
            StateFolder(folder)


def test_state_path_follows_settings_and_environment() -> None:
    settings = SlaveSettings(cell="lab")
    home = {"XDG_STATE_HOME": "/xdg"}
    assert state_path(settings, "slave", home) == Path("/xdg/forefeel/lab-slave")
    assert state_path(settings, "slave", {**home, "STATE_DIRECTORY": "/var/lib/a:/b"}) == Path(
        "/var/lib/a/lab-slave"
    )
    assert state_path(settings, "master", {}) == Path.home() / ".local/state/forefeel/lab-master"
    named = checked(SlaveSettings, {"state": {"directory": "st"}}, "x", directory=Path("/conf"))
    assert state_path(named, "slave", home) == Path("/conf/st")


# --- the event log ---


@pytest.fixture(name="log")
def event_log(tmp_path: Path) -> Iterator[EventLog]:
    log = EventLog(tmp_path / EVENTS, SteppedWorker)
    yield log
    log.close()


def test_log_appends_one_line_per_event(log: EventLog, tmp_path: Path) -> None:
    log.note("emergency_stop", 5, "a", {"by": "nurse", "reason": "kinked\nhose"})
    log.write()
    again = EventLog(tmp_path / EVENTS, SteppedWorker)
    again.note("stop", 6, "", {})
    again.close()
    first, second = lines(tmp_path / EVENTS)
    assert (first["event"], first["axis"], first["monotonic_ns"]) == ("emergency_stop", "a", 5)
    assert first["details"] == {"by": "nurse", "reason": "kinked\nhose"}
    assert second["event"] == "stop"
    assert (tmp_path / EVENTS).stat().st_mode & 0o777 == 0o600


def test_log_on_full_disk_counts_lost(log: EventLog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = os.pwrite

    def half(descriptor: int, data: bytes, offset: int) -> int:
        real(descriptor, data[: len(data) // 2], offset)
        return no_room()

    log.note("first", 1, "", {})
    log.write()
    with monkeypatch.context() as full:
        full.setattr("forefeel.common.state.event_log.os.pwrite", half)
        for _ in range(3):
            log.note("refused", 2, "", {})
            log.write()
    assert log.lost == 3
    log.note("last", 3, "", {})
    log.write()
    found = lines(tmp_path / EVENTS)
    assert [each["event"] for each in found] == ["first", "lines_lost", "last"]
    assert found[1]["details"] == {"count": 3}


def test_log_queue_overflow_loses_oldest(log: EventLog, tmp_path: Path) -> None:
    for number in range(4096 + 100):
        log.note("refused", number, "", {})
    log.write()
    lost, first, *_, last = lines(tmp_path / EVENTS)
    assert (log.lost, lost["details"]) == (100, {"count": 100})
    assert (first["monotonic_ns"], last["monotonic_ns"]) == (100, 4195)


def test_log_rotates_by_size(log: EventLog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("forefeel.common.state.event_log._LARGEST_BYTES", 200)
    for number in range(9):
        log.note("refused", number, "", {})
        log.write()
    files = [tmp_path / "events.1.jsonl", tmp_path / EVENTS]
    stamps = [each["monotonic_ns"] for path in files for each in lines(path)]
    assert stamps == list(range(stamps[0], 9))
    assert sorted(tmp_path.iterdir()) == sorted(files)


# --- the latch ---


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / LATCHED


def test_latch_writes_the_newest_of_each_axis_into_room_allocated_at_start(latch: Latch, path: Path) -> None:
    before = path.stat()
    assert before.st_size == 16 * 1024 <= 512 * before.st_blocks
    latch.transition("a", STOPPED)
    latch.transition("b", {**STOPPED, "reason": "follows"})
    latch.transition("a", CLEARED)
    latch.write()
    assert latched(path) == {"b": "follows"}
    after = path.stat()
    assert (after.st_ino, after.st_size, after.st_blocks) == (before.st_ino, before.st_size, before.st_blocks)


@pytest.fixture
def latch(path: Path) -> Iterator[Latch]:
    opened = Latch(path, ["a", "b"], True, lambda *_: None, SteppedWorker)
    yield opened
    opened.close()


def test_latch_is_kept_once_on_disk(latch: Latch, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[dict[str, str]] = []
    real = os.fsync

    def fsync(descriptor: int) -> None:
        assert not latch.is_persisted("a", False)
        synced.append(latched(path))
        real(descriptor)

    monkeypatch.setattr("forefeel.common.state.latch.os.fsync", fsync)
    assert not latch.is_persisted("a", True), "its transition comes later than its state"
    for transition in STOPPED, CLEARED:
        latch.transition("a", transition)
        latch.write()
        assert latch.is_persisted("a", transition is STOPPED)
    assert synced == [{"a": "pressed"}, {}]


@contextmanager
def daemon(folder: Path) -> Iterator[StateEventSink]:
    """The event sink of a daemon, its threads not started."""
    with StateFolder(folder) as opened:
        sink = StateEventSink(opened, MonotonicClock(), ["a"], 3, SteppedWorker)
        yield sink
        sink.close("ended")


def moved(sink: StateEventSink, before: str, after: str, reason: str = "why") -> None:
    sink.note("safety", 1, "a", before=before, event="e", after=after, reason=reason)


def test_what_stops_every_axis_stays_with_those_that_have_not_reported(path: Path) -> None:
    path.write_text("{}")
    latch = Latch(path, ["a", "b"], False, lambda *_: None, SteppedWorker)
    latch.transition("a", CLEARED)
    latch.close()
    assert list(latched(path)) == ["b"]


def test_latch_overflow_stops_every_axis(path: Path) -> None:
    axes = [f"axis{number}" for number in range(100)]
    latch = Latch(path, axes, True, lambda *_: None, SteppedWorker)
    for axis in axes:
        latch.transition(axis, {**STOPPED, "reason": "\N{SNOWMAN}" * 256})
    latch.close()
    assert list(latched(path)) == [""]
    assert path.stat().st_size == 16 * 1024


def test_latch_without_room_is_a_problem(latch: Latch, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str | None] = []
    monkeypatch.setattr(latch, "_on_problem", lambda _, problem: told.append(problem))
    with monkeypatch.context() as full:
        full.setattr("forefeel.common.state.latch._put", no_room)
        latch.transition("a", STOPPED)
        latch.write()
        latch.write()
        assert not latch.is_persisted("a", True)
    latch.write()
    assert latch.is_persisted("a", True)
    assert latched(path) == {"a": "pressed"}, "as it is after a kill"
    assert [problem is None for problem in told] == [False, True]


# --- both, over starts of a daemon ---


@pytest.mark.parametrize(
    ("before", "after"),
    [("armed", "estopped"), ("engaging", "fault"), ("armed", "fault"), ("stopping", "fault")],
)
def test_stop_and_fault_in_motion_outlive_daemon(tmp_path: Path, before: str, after: str) -> None:
    with daemon(tmp_path) as first:
        assert first.latched == {}
        moved(first, before, after, "why it stands")
    with daemon(tmp_path) as again:
        assert again.latched == {"a": "why it stands"}
        moved(again, after, "idle")
        moved(again, "ready", "fault", "of a stage at rest")
    with daemon(tmp_path) as last:
        assert last.latched == {}
    events = [each["event"] for each in lines(tmp_path / EVENTS)]
    assert events == ["safety", "stop", "safety", "safety", "stop", "stop"]


@pytest.mark.parametrize(
    "content",
    [
        "{", "{}", "", "[]", "\x00", "[" * 16_000, '{"latched": 1}', '{"a": "without its key"}',
        '{"latched": {"a": "nurse"}} {"latched"', '{"latched": {"b": "nurse"}}', None,
    ],
)  # fmt: skip
def test_untrusted_latch_stops_every_axis_until_cleared(tmp_path: Path, content: str | None) -> None:
    with daemon(tmp_path):
        pass
    (tmp_path / LATCHED).unlink()
    if content is not None:
        (tmp_path / LATCHED).write_text(content)
    for _ in range(2):  # and a new start does not forget it
        with daemon(tmp_path) as again:
            assert list(again.latched) == [""]
    with daemon(tmp_path) as last:
        moved(last, "idle", "estopped")
        moved(last, "estopped", "idle")
    with daemon(tmp_path) as cleared:
        assert cleared.latched == {}
