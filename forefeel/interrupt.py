"""SIGINT, SIGTERM and SIGHUP alike end a command in order.

Their handler raises nothing, for it may run inside a callback of a library that swallows what is raised.
Where nothing has to be closed it ends the process in place (`ends_in_order`); in `heeded` the body looks
whether a signal came. Before and after both the system ends the process.
"""

import atexit
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import NoReturn

from forefeel.common.errors import RunError
from forefeel.terminal import flush, last_word

SIGNALS = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
_ONE_S = 0.5
"""Signals within it are one: a terminal that closes sends SIGHUP twice, and so do impatient fingers."""


class Stop:
    """Whether the command is to end; `heeded` gives it."""

    def __init__(self) -> None:
        self.heeded: list[Callable[[], object] | None] = []
        self.last: list[Callable[[], object]] = []
        self.texts: list[Callable[[], str]] = []
        self.begin()

    def begin(self) -> None:
        self.first_s: float | None = None
        self.seen = self.breaks = False

    def wanted(self) -> bool:
        """Whether a signal came; whoever asks ends in order."""
        self.seen = self.first_s is not None
        return self.seen

    def polls(self, duration_s: float | None, every_s: float = 0.0) -> Iterator[None]:
        """Yields every so often, until a signal came or the duration is over; 0: at once again."""
        start_s = time.monotonic()
        while not self.wanted() and (duration_s is None or time.monotonic() - start_s < duration_s):
            yield
            if every_s:
                time.sleep(every_s)

    def check(self) -> None:
        """Raises KeyboardInterrupt when a signal came: in a loop of ours, where that is safe."""
        if self.wanted():
            raise KeyboardInterrupt

    def handle(self, _number: int, _frame: FrameType | None) -> None:
        now_s, again = time.monotonic(), self.first_s is not None
        if self.first_s is not None and now_s - self.first_s < _ONE_S:
            return
        self.first_s = self.first_s or now_s
        tell = self.heeded[-1] if self.heeded else None
        self.seen = self.breaks or tell is not None
        if self.breaks:
            self.breaks = False
            raise KeyboardInterrupt
        if tell is not None:
            tell()
        elif again or not self.heeded:
            self.end()

    def end(self) -> None:
        """Takes away what is half made, says so and leaves; the rest of the main thread does not happen."""
        for number in SIGNALS:
            signal.signal(number, signal.SIG_DFL)
        text = self.texts[-1]() if self.texts else "interrupted"
        for act in reversed(self.last):
            with suppress(Exception):
                act()
        last_word(text)
        os._exit(1)


_stop = Stop()


@contextmanager
def heeded(tell: Callable[[], object] | None = None) -> Iterator[Stop]:
    """The body looks whether a signal came; a later one ends it at once.

    When it did not look, or writes what is to be there whole, the signal waits for the end of the body.

    Args:
        tell: called at each signal instead; no signal cuts such a body short. It is called wherever the main
            thread is, so it must not wait for anything.
    """
    with _handled():
        _stop.heeded.append(tell)
        try:
            yield _stop
        finally:
            _stop.heeded.pop()
        if _stop.first_s is not None and not _stop.seen and not _stop.heeded:
            _stop.end()


@contextmanager
def breakable(ended: str) -> Iterator[None]:
    """The first signal raises KeyboardInterrupt in the body: for devices and persons that are waited for in
    plain Python, where nothing swallows it. No later one cuts the end of the body short.

    Raises:
        RunError: a signal came; `ended` says what it ended.
    """
    with heeded(lambda: None):
        _stop.breaks = True
        try:
            yield
        except KeyboardInterrupt:
            raise RunError(ended) from None
        finally:
            _stop.breaks = False


@contextmanager
def at_last(act: Callable[[], object]) -> Iterator[None]:
    """Does `act` at the end of the body, whatever ends it; a signal in between does it twice."""
    _stop.last.append(act)
    try:
        yield
    finally:
        act()
        _stop.last.pop()


@contextmanager
def ends_in_order(what: str, folder: Path | None = None) -> Iterator[list[str]]:
    """A signal in the body ends it as a run that failed, in one line that says what is left.

    Args:
        what: what is interrupted, in words.
        folder: where the body writes. What it made of the path and left empty goes, however it ends.

    Gives a list for the names of the files that are there and whole.

    Raises:
        RunError: a signal came, and the body looked (`Stop.check`).
    """
    written: list[str] = []
    made = [] if folder is None else [path for path in (folder, *folder.parents) if not path.exists()]

    def left() -> str:
        where = f" in {folder}" if folder is not None else ""
        return f"{what} interrupted; " + (
            f"{', '.join(written)}{where}" if written else "nothing was written"
        )

    def remove_empty() -> None:
        for path in made:
            with suppress(OSError):  # not empty, or not made yet
                path.rmdir()

    with _handled(), at_last(remove_empty):
        _stop.texts.append(left)
        try:
            yield written
        except KeyboardInterrupt:
            raise RunError(left()) from None
        finally:
            _stop.texts.pop()


def leave(code: int) -> NoReturn:
    """Ends the process; once a signal came without taking Python apart, a second's work on a busy machine."""
    if _stop.first_s is not None:
        atexit._run_exitfuncs()
        flush()
        os._exit(code)
    sys.exit(code)


@contextmanager
def _handled() -> Iterator[None]:
    """Installs the handler; the outermost body begins without a signal. `nohup` is respected."""
    if signal.getsignal(signal.SIGINT) == _stop.handle:
        yield
        return
    _stop.begin()
    heard = [each for each in SIGNALS if each != signal.SIGHUP or signal.getsignal(each) != signal.SIG_IGN]
    before = {number: signal.signal(number, _stop.handle) for number in heard}
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)
