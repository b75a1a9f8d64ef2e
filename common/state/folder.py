"""A daemon's state folder: where it is, and that only one daemon uses it."""

import fcntl
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Self

from common.errors import ConfigurationError

if TYPE_CHECKING:  # a stop finds the folder before pydantic is imported
    from common.settings import DaemonSettings

AUDIT, FLIGHT, SOCKET, LATCHED = "audit.jsonl", "flight", "control.sock", "latched.json"
_LOCK = "lock"
_OTHERS_WRITE = 0o022


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
    """The process of the daemon that uses the folder now; None where none does, or nobody may see it.

    By the kernel's own list: to try the lock would keep a daemon out that starts meanwhile.
    """
    try:
        number = (path / _LOCK).stat().st_ino
        held = any(words.split()[5].endswith(f":{number}") for words in locks.read_text().splitlines())
        return int((path / _LOCK).read_text()) if held else None
    except (OSError, ValueError, IndexError):
        return None


def sync_folder(folder: Path) -> None:
    """Which names there are in it, on the disk when it returns.

    Raises:
        OSError: it can not be.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


class StateFolder:
    """The folder while its daemon runs; made with mode 0700 where it is missing, and locked.

    Raises:
        ConfigurationError: another daemon uses it, others may write to it, or it can not be used.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            path.mkdir(parents=True, exist_ok=True, mode=0o700)
            (path / FLIGHT).mkdir(exist_ok=True, mode=0o700)
            mode = path.stat().st_mode
            self._lock = os.open(path / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise ConfigurationError(
                f"state folder {path}: {error.strerror}; expected one that can be written (state.directory)"
            ) from error
        try:
            if mode & _OTHERS_WRITE:
                raise ConfigurationError(
                    f"state folder {path}: mode {mode & 0o777:04o}; expected one that others can not write"
                )
            self._take()
        except BaseException:
            os.close(self._lock)
            raise

    def _take(self) -> None:
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
        """Gives it free; idempotent."""
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
