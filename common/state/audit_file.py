"""The file of the audit log: what is in it stays, and there is always room for a last word.

Beyond its end a reserve is allocated (fallocate with FALLOC_FL_KEEP_SIZE), so that what has to be said when
the disk is full can still be written.
"""

import ctypes
import errno
import os
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import NamedTuple

from forefeel.common.events.audit import CONTINUED, ChainEnd, Detail, Entry, Noted, parse, seal
from forefeel.common.runtime.descriptors import DESCRIPTORS
from forefeel.common.state.folder import own_file, sync_folder

_KEEP_SIZE = 1  # FALLOC_FL_KEEP_SIZE of fallocate(2) (linux/falloc.h)
# bytes that stay allocated beyond the end; chosen, not measured: about a hundred entries on a full disk
_RESERVE_BYTES = 64 * 1024
# bytes of the reserve that may be used before it is renewed: a block of common file systems
_PAGE_BYTES = 4096
# bytes that are read in search of the last or first line; chosen, not measured: longer than any entry
_TAIL_BYTES = 256 * 1024
# bytes of a half-written line that the next entry quotes; chosen, not measured: more fills the log
_SHOWN_BYTES = 200
# bytes after which the log goes on in another file; chosen, not measured: larger is harder to handle,
# smaller makes more files
_LARGEST_BYTES = 16 * 1024 * 1024
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT)


class Recovery(NamedTuple):
    """What was found at the end of the file: bytes of a line without an end; a last line that is no entry."""

    torn: bytes
    damaged: str


class AuditFile:
    """One log, open for appending. For one thread.

    Attributes:
        last_event: of the entry that was found at the end; empty where there was none.
        recovery: what the opening had to mend; None when the log was whole.
        end: of the chain.
        largest: size in bytes beyond which it is set aside and the next goes on; none is ever removed. It
            grows on where there is no room for the next, and that is an entry.

    Raises:
        OSError: it can not be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.last_event = path, ""
        self.recovery: Recovery | None = None
        self.end = ChainEnd()
        self.largest = _LARGEST_BYTES
        self._part = path.with_name(f".{path.name}.part")
        self._grows = False
        self._open()
        try:
            self._mend()
        except BaseException:
            self.close()
            raise

    def _open(self) -> None:
        if self._part.exists():  # from a crash while a file was set aside
            if self.path.exists():
                self._part.unlink()
            else:
                self._part.rename(self.path)
        self._descriptor = own_file(self.path)
        self._size = os.fstat(self._descriptor).st_size
        self._reserved = 0
        sync_folder(self.path.parent)

    def _mend(self) -> None:
        """Cuts a half-written last line off, and finds the end of the chain."""
        start = max(0, self._size - _TAIL_BYTES)
        tail = os.pread(self._descriptor, self._size - start, start)
        whole = tail.rfind(b"\n") + 1
        torn, damaged = tail[whole:], ""
        if torn:
            self._size -= len(torn)
            os.ftruncate(self._descriptor, self._size)
        if whole:
            last = tail[tail.rfind(b"\n", 0, whole - 1) + 1 : whole - 1]
            try:
                entry = parse(last)
                self.end = ChainEnd(entry.number, entry.hash)
                self.last_event = entry.noted.event
            except ValueError as error:
                damaged = f"the last line {error}"
                self._set_aside(self._free_name("damaged"), b"")
        if torn or damaged:
            self.recovery = Recovery(torn[:_SHOWN_BYTES], damaged)

    def write(self, notes: Sequence[Noted]) -> None:
        """Appends all of them, on the disk when it returns; or none.

        Raises:
            OSError: not written; the log is as before.
        """
        if self._size <= self.largest:
            self._append(notes)
            return
        try:
            self._continue(notes)
            self._grows = False
        except OSError as error:
            if error.errno not in _NO_ROOM:
                raise
            # behind this file there is the reserve
            said = [] if self._grows else [_beside(notes[0], "not_set_aside", what=error.strerror)]
            self._append([*said, *notes])
            self._grows = True

    def _append(self, notes: Sequence[Noted]) -> None:
        data, end = _sealed(notes, self.end)
        try:
            _put(self._descriptor, data, self._size)
        except OSError:
            os.ftruncate(self._descriptor, self._size)
            self._reserved = 0  # it may have gone with it
            raise
        self._size += len(data)
        self.end = end

    def _continue(self, notes: Sequence[Noted]) -> None:
        """Goes on with them in the next file."""
        aside = self._free_name(f"{self.first_number():09d}")
        data, end = _sealed([_beside(notes[0], CONTINUED, file=aside.name), *notes], self.end)
        with DESCRIPTORS.reserve():
            self._set_aside(aside, data)
        self.end = end

    def reserve(self) -> bool:
        """Sees to it that the reserve is allocated, and that the disk is not full behind it.

        Returns:
            False where the file system can not allocate beyond the end.

        Raises:
            OSError: there is no room.
        """
        disk = os.fstatvfs(self._descriptor)
        free = disk.f_bfree if os.geteuid() == 0 else disk.f_bavail
        if free * disk.f_frsize < _RESERVE_BYTES:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if self._reserved - self._size >= _RESERVE_BYTES - _PAGE_BYTES:
            return True
        libc = ctypes.CDLL(None, use_errno=True)
        offset, length = ctypes.c_int64(self._size), ctypes.c_int64(_RESERVE_BYTES)
        if libc.fallocate64(self._descriptor, _KEEP_SIZE, offset, length) != 0:
            number = ctypes.get_errno()
            if number in (errno.EOPNOTSUPP, errno.ENOSYS):
                return False
            raise OSError(number, os.strerror(number))
        self._reserved = self._size + _RESERVE_BYTES
        return True

    def first_number(self) -> int:
        """The number of the file's first entry; 0 where it has none."""
        head = os.pread(self._descriptor, _TAIL_BYTES, 0).partition(b"\n")[0]
        try:
            found: Entry = parse(head)
        except ValueError:
            return 0
        return found.number

    def close(self) -> None:
        """Closes the file."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _free_name(self, name: str) -> Path:
        aside = self.path.with_name(f"{self.path.stem}-{name}{self.path.suffix}")
        count = 1
        while aside.exists():
            count += 1
            aside = self.path.with_name(f"{self.path.stem}-{name}-{count}{self.path.suffix}")
        return aside

    def _set_aside(self, aside: Path, data: bytes) -> None:
        """Renames the file, and goes on in a new one that holds the data; or all is as before.

        Raises:
            OSError: the new one can not be written.
        """
        descriptor = os.open(self._part, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        try:
            _put(descriptor, data, 0)
            self._take_place(aside)
        except BaseException:
            os.close(descriptor)
            with suppress(OSError):  # it goes with the next opening
                self._part.unlink(missing_ok=True)
            raise
        before, self._descriptor = self._descriptor, descriptor
        self._size, self._reserved = len(data), 0
        with suppress(OSError):  # what is in it was on the disk before
            os.close(before)

    def _take_place(self, aside: Path) -> None:
        with ExitStack() as undo:
            self.path.rename(aside)
            undo.callback(aside.rename, self.path)
            self._part.rename(self.path)
            undo.callback(self.path.rename, self._part)
            sync_folder(self.path.parent)
            undo.pop_all()


def _beside(noted: Noted, event: str, **details: Detail) -> Noted:
    """An entry of the log's own, of the same time."""
    return Noted(noted.utc, noted.monotonic_ns, event, "", details)


def _sealed(notes: Sequence[Noted], end: ChainEnd) -> tuple[bytes, ChainEnd]:
    """Their lines behind that end, and the end then."""
    lines = []
    for noted in notes:
        line, end = seal(noted, end)
        lines.append(line)
    return b"".join(lines), end


def _put(descriptor: int, data: bytes, offset: int) -> None:
    """All of it, on the disk when it returns."""
    done = 0
    while done < len(data):
        done += os.pwrite(descriptor, data[done:], offset + done)
    os.fdatasync(descriptor)
