"""The audit log's file when the next one can not be made: nothing is lost, and it goes on when it can."""

import errno
import os
from pathlib import Path

import pytest

from forefeel.common.events.audit import Entry, Noted, parse, verify
from forefeel.common.state.audit_file import AuditFile
from forefeel.common.state.folder import AUDIT


class Log:
    """A log that is set aside after each write, all files of which are one chain."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.path = folder, folder / AUDIT
        self.part = folder / f".{AUDIT}.part"
        self.file = AuditFile(self.path)
        self.file.largest = 0
        self.written = 0

    def write(self) -> None:
        self.file.write([Noted("2026", self.written, "refused", "a", {"number": self.written})])
        self.written += 1

    def asides(self) -> list[Path]:
        return sorted(self.folder.glob("audit-*.jsonl"))

    def entries(self, path: Path | None = None) -> list[Entry]:
        return [parse(line) for line in (path or self.path).read_bytes().splitlines()]

    def events(self, path: Path | None = None) -> list[str]:
        return [entry.noted.event for entry in self.entries(path)]

    def check(self) -> None:
        """Every entry once and in order, each file good by itself, the chain whole over all of them."""
        files = [*self.asides(), self.path]
        lines = [file.read_bytes().splitlines(keepends=True) for file in files]
        assert all(verify(each).intact for each in lines)
        verdict = verify(line for each in lines for line in each)
        assert verdict.intact and verdict.last is not None and verdict.last.hash == self.file.end.hash
        refused = [e for file in files for e in self.entries(file) if e.noted.event == "refused"]
        assert [e.noted.details["number"] for e in refused] == list(range(self.written))
        assert not self.part.exists()


@pytest.fixture
def log(tmp_path: Path) -> Log:
    log = Log(tmp_path)
    log.write()
    return log


def refusing_the_next(log: Log, number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Writes to the next file, not to this one, fail half-way."""
    real = os.pwrite

    def pwrite(descriptor: int, data: bytes, offset: int) -> int:
        if Path(f"/proc/self/fd/{descriptor}").readlink() == log.part:
            real(descriptor, data[: len(data) // 2], offset)
            raise OSError(number, os.strerror(number))
        return real(descriptor, data, offset)

    monkeypatch.setattr("forefeel.common.state.audit_file.os.pwrite", pwrite)


def test_a_next_file_that_can_not_be_opened_leaves_the_log_as_it_was(log: Log) -> None:
    log.part.mkdir()
    before, end = log.path.read_bytes(), log.file.end
    for _ in range(2):
        with pytest.raises(IsADirectoryError):
            log.write()
    assert (log.path.read_bytes(), log.file.end, log.asides()) == (before, end, [])
    assert log.file.first_number() == 1
    log.file.reserve()
    log.part.rmdir()
    log.write()
    assert log.events() == ["continued", "refused"]
    log.check()


def test_a_next_file_that_can_not_be_written_leaves_the_log_as_it_was(
    log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as broken, pytest.raises(OSError, match="Input/output"):
        refusing_the_next(log, errno.EIO, broken)
        log.write()
    log.check()
    log.write()
    assert log.events() == ["continued", "refused"], "what ties it to the file before is not lost"
    log.check()


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_without_room_for_the_next_this_one_grows_on_and_that_is_said_once(
    log: Log, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    with monkeypatch.context() as full:
        refusing_the_next(log, number, full)
        log.write()
        log.write()
    assert log.events() == ["refused", "not_set_aside", "refused", "refused"]
    log.check()
    log.write()
    assert log.events() == ["continued", "refused"] and len(log.asides()) == 1
    log.check()


def test_a_folder_that_can_not_be_synced_leaves_the_log_as_it_was(
    log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(_: Path) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with monkeypatch.context() as broken, pytest.raises(OSError, match="Input/output"):
        broken.setattr("forefeel.common.state.audit_file.sync_folder", fails)
        log.write()
    assert log.events() == ["refused"] and log.asides() == []
    log.check()
    log.write()
    log.check()


def test_a_crash_between_both_renames_loses_no_chain(log: Log) -> None:
    log.write()
    log.file.close()
    log.path.rename(log.part)
    again = AuditFile(log.path)
    assert again.end == log.file.end and again.recovery is None
    again.close()
    log.check()


def test_a_crash_before_the_renames_leaves_what_was_and_no_litter(log: Log) -> None:
    log.file.close()
    log.part.write_bytes(b"half")
    again = AuditFile(log.path)
    assert again.end == log.file.end
    again.close()
    log.check()


def test_no_descriptor_is_left_open(log: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    before = len(list(Path("/proc/self/fd").iterdir()))
    for _ in range(3):
        log.write()
    with monkeypatch.context() as broken, pytest.raises(OSError, match="Input/output"):
        refusing_the_next(log, errno.EIO, broken)
        log.write()
    assert len(list(Path("/proc/self/fd").iterdir())) == before
