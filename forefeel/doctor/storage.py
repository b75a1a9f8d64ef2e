"""Is there room for recordings and the event log, is it quick enough, and who may read it?"""

import os
import shutil
import stat
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from forefeel.doctor.findings import Finding, Level

GROUP = "storage"
# bytes that are written to measure the speed; chosen, not measured: fewer measure the delay of one write,
# more take longer
_BYTES = 8_000_000
_MB = 1e6  # bytes in a megabyte (SI)
_PLENTY_MB, _LEAST_MB = 2000.0, 200.0  # a recording takes about 1 GB an hour
_QUICK_MB_S, _SLOW_MB_S = 5.0, 1.0  # and 0.3 MB/s


@dataclass(frozen=True, slots=True)
class Folder:
    """A state folder. `exists`: else the figures are those of the nearest folder around it. `mode`: its
    permissions, None without it; `write_mb_s` None: it can not be written.
    """

    path: Path
    exists: bool
    writable: bool
    mode: int | None
    free_mb: float
    write_mb_s: float | None


def examine_folder(path: Path, size: int = _BYTES) -> Folder:
    """Writes a file of `size` bytes to the disk and takes it away again."""
    place = path
    while not place.is_dir() and place != place.parent:
        place = place.parent
    exists, writable = place == path, os.access(place, os.W_OK | os.X_OK)
    mode = stat.S_IMODE(path.stat().st_mode) if exists else None
    free_mb = shutil.disk_usage(place).free / _MB
    speed = _write_speed(place, size) if writable and free_mb * _MB > 2 * size else None
    return Folder(path, exists, writable, mode, free_mb, speed)


def _write_speed(folder: Path, size: int) -> float | None:
    try:
        with tempfile.NamedTemporaryFile(dir=folder, prefix=".forefeel-doctor-") as file:
            start_s = time.monotonic()
            file.write(os.urandom(size))
            file.flush()
            os.fsync(file.fileno())
            return size / _MB / max(1e-9, time.monotonic() - start_s)
    except OSError:
        return None


def judge_folder(folder: Folder) -> list[Finding]:
    """Access, permissions, room, speed."""
    name = str(folder.path)
    findings = [_access(folder, name)]
    level = _level(folder.free_mb, _PLENTY_MB, _LEAST_MB)
    advice = "" if level == "green" else "make room: an hour of recording takes about 1 GB"
    findings.append(Finding(GROUP, "free space", level, f"{folder.free_mb / 1000:.1f} GB at {name}", advice))
    if folder.write_mb_s is not None:
        level = _level(folder.write_mb_s, _QUICK_MB_S, _SLOW_MB_S)
        advice = "" if level == "green" else "keep the state on a local disk: the recorder writes 0.3 MB/s"
        findings.append(
            Finding(GROUP, "write speed", level, f"{folder.write_mb_s:.0f} MB/s to the disk", advice)
        )
    return findings


def _access(folder: Folder, name: str) -> Finding:
    if not folder.writable:
        advice = "give it to the user that runs the daemon (systemd: StateDirectory)"
        return Finding(GROUP, "state folder", "red", f"{name}: can not be written by this user", advice)
    if folder.mode is None:
        return Finding(GROUP, "state folder", "green", f"{name}: made at the first start")
    if folder.mode & 0o022:
        found = f"{name}: mode {folder.mode:04o}, others may write the event log"
        return Finding(GROUP, "state folder", "red", found, f"chmod 700 {name}")
    if folder.mode & 0o077:
        found = f"{name}: mode {folder.mode:04o}, others may read it"
        return Finding(GROUP, "state folder", "amber", found, f"chmod 700 {name}")
    return Finding(GROUP, "state folder", "green", f"{name}: mode {folder.mode:04o}")


def _level(value: float, good: float, least: float) -> Level:
    return "green" if value >= good else "amber" if value >= least else "red"
