"""Emergency stops, and faults of a motion, that outlive the daemon: a new start does not clear them."""

import json
import os
import threading
from collections.abc import Callable, Collection, Mapping
from pathlib import Path

from forefeel.common.events.sink import HALTED, Detail
from forefeel.common.messages import FOLLOWING, SafetyState
from forefeel.common.runtime.threads import Worker
from forefeel.common.state.folder import own_file, sync_folder

_BYTES = 16 * 1024
"""Size of the file, whatever it says: 60 axes with a reason of 256 characters each."""
_RETRY_S = 1.0  # between two attempts to write to a full disk
_MOVING = FOLLOWING | {SafetyState.STOPPING}
_ALL = ""
"""In place of an axis: every one."""


class Latch:
    """Keeps the stopped axes and their reasons in a file of its full size, which is overwritten in place.

    So a disk that is full later does not keep a stop out of it. Half of a new content behind half of the old
    one is no JSON, and what can not be read stops every axis. Any thread reports; the worker `latch` writes.

    Attributes:
        restored: by axis what was latched when it was opened; under the empty name what stops every axis.
        problem: why the file does not say what it should, if it does not.

    Raises:
        OSError: the file can not be made or written.
    """

    def __init__(
        self,
        path: Path,
        axes: Collection[str],
        new: bool,
        on_problem: Callable[[str | None, str | None], None],
        worker: type[Worker] = Worker,
    ) -> None:
        """`new`: no daemon has used the folder before, so that there is no file yet. `on_problem`: called in
        the thread with the problem before and after it changed.
        """
        self.problem: str | None = None
        self._on_problem, self._axes = on_problem, axes
        restored = latched(path) if new or path.exists() else {_ALL: "the file of what was latched is gone"}
        unknown = sorted(set(restored) - {_ALL, *axes})
        if unknown:
            restored = {_ALL: f"axis {unknown[0]!r} was latched, which is none of {', '.join(axes)}"}
        self.restored: Mapping[str, str] = restored
        self._wanted = restored
        self._written: Mapping[str, str] | None = None
        self._wanting = threading.Lock()
        self.worker = worker("latch", self._work)
        self._descriptor = own_file(path)
        try:
            self._write()
            sync_folder(path.parent)
        except BaseException:
            os.close(self._descriptor)
            raise

    def close(self) -> None:
        """Writes once more, if it can, ends the worker and closes the file; idempotent."""
        if self._descriptor >= 0:
            self.worker.close()
            os.close(self._descriptor)
            self._descriptor = -1

    def transition(self, axis: str, details: Mapping[str, Detail]) -> None:
        """Latches the axis, for the worker to write, at an emergency stop and at a fault that struck while
        the stage was moved; unlatches it when it leaves these states; else does nothing. `details`: before,
        after, reason. Any thread; waits for no disk.
        """
        before, after = SafetyState(str(details["before"])), SafetyState(str(details["after"]))
        if after is SafetyState.ESTOPPED or (after is SafetyState.FAULT and before in _MOVING):
            self._set_reason(axis, str(details["reason"]))
        elif before in HALTED and after not in HALTED:
            self._set_reason(axis, None)

    def is_persisted(self, axis: str, stopped: bool) -> bool:
        """True when the file says of the axis what it should, so that a new start finds the same. `stopped`:
        it is in an emergency stop, of which the transition may not have come here yet.
        """
        written, wanted = self._written, self._wanted.get(axis, self._wanted.get(_ALL))
        known = wanted is not None or not stopped
        return known and written is not None and written.get(axis, written.get(_ALL)) == wanted

    def _set_reason(self, axis: str, reason: str | None) -> None:
        """Sets the reason for which an axis is latched (None: removes it) and wakes the worker, which writes
        it. A reason for every axis first becomes one of each axis, so that the others keep it.
        """
        with self._wanting:
            every = self._wanted.get(_ALL)
            latched = self._wanted if every is None else dict.fromkeys(self._axes, every)
            others = {name: text for name, text in latched.items() if name != axis}
            self._wanted = others if reason is None else {**others, axis: reason}
        self.worker.wake()

    def _work(self, closing: bool) -> float | None:
        del closing
        self.write()
        return None if self.problem is None else _RETRY_S

    def write(self) -> None:
        """Writes the latched axes; sets `problem` (None: written) and calls `on_problem` if that changed."""
        before = self.problem
        try:
            self._write()
            self.problem = None
        except OSError as error:
            self.problem = f"latch: {error.strerror or error}"
        if self.problem != before:
            self._on_problem(before, self.problem)

    def _write(self) -> None:
        """Writes the latched axes into the open file, on the disk when it returns, unless it says so already.
        After an OSError the content counts as unknown, so that the next call writes again.
        """
        wanted = self._wanted
        if wanted == self._written:
            return
        self._written = None  # half-way it may say either
        _put(self._descriptor, wanted)
        self._written = wanted


def latched(path: Path) -> dict[str, str]:
    """Reads the latch file of a daemon: reasons by axis; empty where there is no file. A file that can not be
    read, or that no daemon wrote so, gives a reason under the empty name, which stops every axis.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        if list(document) != ["latched"]:
            raise ValueError
        return {str(axis): str(reason) for axis, reason in document["latched"].items()}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):
        return {_ALL: "what was latched can not be read"}


def _put(descriptor: int, latched: Mapping[str, str]) -> None:
    """Overwrites the whole file with the reasons by axis, on the disk when it returns; raises OSError. What
    is too long for it becomes one reason under the empty name, which stops every axis.
    """
    data = json.dumps({"latched": latched}).encode()
    if len(data) >= _BYTES:
        data = json.dumps({"latched": {_ALL: "more was latched than the file holds"}}).encode()
    data = data.ljust(_BYTES - 1) + b"\n"
    done = 0
    while done < len(data):
        done += os.pwrite(descriptor, data[done:], done)
    os.fsync(descriptor)
