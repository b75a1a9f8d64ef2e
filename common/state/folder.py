"""A daemon's state folder: where it is, and that only one daemon uses it."""

import fcntl
import os
import re
import stat
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Self

from forefeel.common.errors import ConfigurationError

if TYPE_CHECKING:  # a stop finds the folder before pydantic is imported
    from forefeel.common.settings import DaemonSettings

EVENTS, FLIGHT, SOCKET, LATCHED = "events.jsonl", "flight", "control.sock", "latched.json"
_LOCK = "lock"
_OTHERS_WRITE = 0o022  # mode bits S_IWGRP and S_IWOTH: group and others may write (stat(2))
_OWN = (_LOCK, EVENTS, FLIGHT, LATCHED, SOCKET)


def state_path(settings: "DaemonSettings", role: str, environment: Mapping[str, str]) -> Path:
    """The folder of a daemon with these settings, whether it exists or not."""
    return settings.state.directory or unnamed_path(settings.cell, role, environment)


def unnamed_path(cell: str, role: str, environment: Mapping[str, str]) -> Path:
    """The folder of a daemon whose settings name none."""
    base = environment.get("STATE_DIRECTORY", "").partition(":")[0]
    if not base:
        home = environment.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
        base = f"{home}/forefeel"
    return Path(base).absolute() / re.sub(r"[^A-Za-z0-9_.-]", "_", f"{cell}-{role}")


def holder(path: Path, locks: Path = Path("/proc/locks")) -> int | None:
    """Process number of the daemon that uses the folder now; None where none does, or it can not be seen. By
    the kernel's list of locks: to try the lock would keep a daemon out that starts meanwhile.
    """
    try:
        number = (path / _LOCK).stat().st_ino
        held = any(words.split()[5].endswith(f":{number}") for words in locks.read_text().splitlines())
        return int((path / _LOCK).read_text()) if held else None
    except (OSError, ValueError, IndexError):
        return None


def sync_folder(folder: Path) -> None:
    """Puts the names in a folder on the disk (fsync).

    Raises:
        OSError: it can not be.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def own_file(path: Path) -> int:
    """Opens a file for reading and writing, made with mode 0600 where it is missing; returns its descriptor.

    Raises:
        OSError: it can not be opened, or is a link.
    """
    flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
    return os.open(path, flags, 0o600)


def _require_own(folder: Path) -> None:
    """Checks that nobody else has a say in a folder.

    Raises:
        ConfigurationError: it is another user's or writable for others, or a daemon's file in it is a link or
            another user's.
    """
    status, user = folder.stat(), os.geteuid()
    if status.st_uid != user:
        raise ConfigurationError(
            f"state folder {folder}: of user {status.st_uid}; expected one of the daemon's own user {user}"
        )
    if status.st_mode & _OTHERS_WRITE:
        raise ConfigurationError(
            f"state folder {folder}: mode {status.st_mode & 0o777:04o}; "
            "expected one that others can not write"
        )
    for name in _OWN:
        with suppress(FileNotFoundError):
            entry = (folder / name).lstat()
            if stat.S_ISLNK(entry.st_mode) or entry.st_uid != user:
                what = "a link" if stat.S_ISLNK(entry.st_mode) else f"of user {entry.st_uid}"
                raise ConfigurationError(
                    f"state folder {folder}: {name} is {what}; expected the daemon's own file, or none"
                )


class StateFolder:
    """Locks a daemon's folder while it runs; makes it with mode 0700 where it is missing.

    It and what is in it belong to the daemon's user, and no name in it is a link: a daemon that runs as root
    would else write wherever somebody points.

    Raises:
        ConfigurationError: another daemon uses it, others may write to it, it is somebody else's, or it can
            not be used.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            path.mkdir(parents=True, exist_ok=True, mode=0o700)
            _require_own(path)
            (path / FLIGHT).mkdir(exist_ok=True, mode=0o700)
            self._lock = own_file(path / _LOCK)
        except OSError as error:
            raise ConfigurationError(
                f"state folder {path}: {error.strerror}; expected one that can be written (state.directory)"
            ) from error
        try:
            self._acquire_lock()
        except BaseException:
            os.close(self._lock)
            raise

    def _acquire_lock(self) -> None:
        """Locks the folder and writes this process's number into the lock file; raises ConfigurationError
        where another daemon has it locked.
        """
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            owner = os.pread(self._lock, 32, 0).decode("ascii", "replace").strip()
            raise ConfigurationError(
                f"state folder {self.path}: in use by another daemon (process {owner or 'unknown'}); "
                "expected one of its own (state.directory)"
            ) from error
        os.ftruncate(self._lock, 0)
        os.pwrite(self._lock, f"{os.getpid()}\n".encode(), 0)

    def close(self) -> None:
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
