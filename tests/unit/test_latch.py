"""The file of what is latched: its room is there beforehand, and it is on the disk when it says so."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from forefeel.common.state.folder import LATCHED
from forefeel.common.state.latch import Latch, latched
from tests.waiting import wait_until

STOPPED = {"before": "armed", "after": "estopped", "reason": "pressed"}
CLEARED = {"before": "estopped", "after": "idle", "reason": "cleared"}


def nothing_said(before: str | None, problem: str | None) -> None:
    raise AssertionError((before, problem))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / LATCHED


@pytest.fixture
def latch(path: Path) -> Iterator[Latch]:
    opened = Latch(path, ["a", "b"], True, nothing_said)
    opened.start()
    yield opened
    opened.close()


def test_its_room_is_allocated_from_the_start_and_a_stop_is_written_into_it(latch: Latch, path: Path) -> None:
    def taken() -> tuple[int, int, int]:
        found = path.stat()
        return found.st_ino, found.st_size, found.st_blocks

    before = taken()
    assert before[1] == 16 * 1024 <= 512 * before[2]
    latch.transition("a", STOPPED)
    wait_until(lambda: latch.kept("a"))
    assert latched(path) == {"a": "pressed"}
    assert taken() == before


def test_kept_means_on_the_disk(latch: Latch, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[dict[str, str]] = []
    real = os.fsync

    def fsync(descriptor: int) -> None:
        assert not latch.kept("a")
        synced.append(latched(path))
        real(descriptor)

    monkeypatch.setattr("forefeel.common.state.latch.os.fsync", fsync)
    latch.transition("a", STOPPED)
    wait_until(lambda: latch.kept("a"))
    latch.transition("a", CLEARED)
    wait_until(lambda: latch.kept("a"))
    assert synced == [{"a": "pressed"}, {}]


def test_each_axis_has_its_own_and_the_newest_counts(latch: Latch, path: Path) -> None:
    latch.transition("a", STOPPED)
    latch.transition("b", {**STOPPED, "reason": "follows"})
    latch.transition("a", CLEARED)
    wait_until(lambda: latch.kept("a") and latch.kept("b"))
    assert latched(path) == {"b": "follows"}


def test_what_does_not_fit_stops_every_axis(path: Path) -> None:
    axes = [f"axis{number}" for number in range(100)]
    latch = Latch(path, axes, True, nothing_said)
    latch.start()
    for axis in axes:
        latch.transition(axis, {**STOPPED, "reason": "\N{SNOWMAN}" * 256})
    latch.close()
    assert latched(path) == {"": "more was latched than the file holds"}
    assert path.stat().st_size == 16 * 1024
