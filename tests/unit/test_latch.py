"""The file of latched emergency stops: what it says after a write that failed, and that it is on the disk."""

import errno
import os
from pathlib import Path

import pytest

from common.state.folder import LATCHED
from common.state.latch import Latch


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / LATCHED


def in_the_way(path: Path) -> Path:
    """What lets no file be made: a folder under the name that it is written by."""
    return path.with_name(f".{path.name}.part")


def test_a_stop_that_could_not_be_written_is_held_and_written_with_the_next(path: Path) -> None:
    latch = Latch(path)
    in_the_way(path).mkdir()
    for _ in range(2):  # the second one is no news, and still not in the file
        with pytest.raises(IsADirectoryError):
            latch.keep("a", "pressed")
    assert latch.reasons == {"a": "pressed"} and not path.exists()
    in_the_way(path).rmdir()
    latch.keep("b", "follows")
    assert Latch(path).reasons == {"a": "pressed", "b": "follows"}


def test_it_is_written_again_without_news_and_only_where_it_has_to_be(path: Path) -> None:
    latch = Latch(path)
    in_the_way(path).mkdir()
    with pytest.raises(IsADirectoryError):
        latch.keep("a", "pressed")
    in_the_way(path).rmdir()
    latch.write()
    assert Latch(path).reasons == {"a": "pressed"}
    path.unlink()
    latch.write()
    assert not path.exists()


def test_a_stop_that_was_cleared_when_half_written_is_not_found_later(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    latch = Latch(path)

    def fails(_: Path) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with monkeypatch.context() as broken, pytest.raises(OSError, match="Input/output"):
        broken.setattr("common.state.latch.sync_folder", fails)
        latch.keep("a", "pressed")
    latch.keep("a", None)
    assert Latch(path).reasons == {}


def test_the_folder_is_on_the_disk_too_of_a_stop_and_of_a_clearing(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[tuple[str, bool]] = []
    real = os.fsync

    def fsync(descriptor: int) -> None:
        synced.append((Path(f"/proc/self/fd/{descriptor}").readlink().name, path.exists()))
        real(descriptor)

    monkeypatch.setattr("common.state.latch.os.fsync", fsync)
    latch = Latch(path)
    latch.keep("a", "pressed")
    assert synced == [(in_the_way(path).name, False), (path.parent.name, True)]
    latch.keep("a", None)
    assert synced[2:] == [(path.parent.name, False)]
