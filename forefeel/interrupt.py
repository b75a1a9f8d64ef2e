"""SIGINT, SIGTERM and SIGHUP alike end a command in order.

Their handler raises nothing, for it may run inside a callback of a library that swallows what is raised.
Where nothing has to be closed it ends the process in place (`ends_in_order`); in `signal_flag` the body looks
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
    """Signals that came, and what they end; `signal_flag` gives it."""

    def __init__(self) -> None:
        self.handlers: list[Callable[[], object] | None] = []
        self.last: list[Callable[[], object]] = []
        self.texts: list[Callable[[], str]] = []
        self.begin()

    def begin(self) -> None:
        self.first_s: float | None = None
        self.noticed = self.breaks = False

    def wanted(self) -> bool:
        """True once a signal came; who asks is taken to end in order."""
        self.noticed = self.first_s is not None
        return self.noticed

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
        """Handles a signal as the innermost body wants: raises KeyboardInterrupt in one of `breakable`, calls
        its `on_signal`, or only sets `first_s`, the flag. Ends the process without a body, or at a second
        signal in a body without `on_signal`. Ignores signals within 0.5 s after the first.
        """
        now_s, again = time.monotonic(), self.first_s is not None
        if self.first_s is not None and now_s - self.first_s < _ONE_S:
            return
        self.first_s = self.first_s or now_s
        on_signal = self.handlers[-1] if self.handlers else None
        self.noticed = self.breaks or on_signal is not None
        if self.breaks:
            self.breaks = False
            raise KeyboardInterrupt
        if on_signal is not None:
            on_signal()
        elif again or not self.handlers:
            self.end()

    def end(self) -> None:
        """Ends the process at once with exit code 1: does the acts of `at_last`, the newest first, whatever
        they raise, and prints the innermost text on what is left. Never returns; later signals kill.
        """
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
def signal_flag(on_signal: Callable[[], object] | None = None) -> Iterator[Stop]:
    """Gives `Stop`, whose flag the first signal in the body sets (`wanted`, `check`); a second one ends the
    process at once.

    A signal that the body did not ask for ends the process after the outermost body, whose files are whole.

    Args:
        on_signal: called at each signal instead; no signal cuts such a body short. It is called wherever the
            main thread is, so it must not wait for anything.
    """
    with _handler_installed():
        _stop.handlers.append(on_signal)
        try:
            yield _stop
        finally:
            _stop.handlers.pop()
        if _stop.first_s is not None and not _stop.noticed and not _stop.handlers:
            _stop.end()


@contextmanager
def breakable(ended: str) -> Iterator[None]:
    """Raises KeyboardInterrupt in the body at the first signal, and turns that into a RunError: for devices
    and persons that are waited for in plain Python, where nothing swallows it. No later signal cuts the end
    of the body short.

    Raises:
        RunError: a signal came; `ended` is its text.
    """
    with signal_flag(lambda: None):
        _stop.breaks = True
        try:
            yield
        except KeyboardInterrupt:
            raise RunError(ended) from None
        finally:
            _stop.breaks = False


@contextmanager
def at_last(act: Callable[[], object]) -> Iterator[None]:
    """Calls `act` at the end of the body, whatever ends it, also a signal that ends the process in place; one
    that comes during the call repeats it.
    """
    _stop.last.append(act)
    try:
        yield
    finally:
        act()
        _stop.last.pop()


@contextmanager
def ends_in_order(what: str, folder: Path | None = None) -> Iterator[list[str]]:
    """Ends a command at a signal in the body with one line that says which files are left: by RunError where
    the body asks (`Stop.check`), else in place with exit code 1.

    Args:
        what: what is interrupted, in words.
        folder: where the body writes. What it made of the path and left empty is removed, however it ends.

    Gives a list, to which the body adds the names of the files that are there and whole.

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

    with _handler_installed(), at_last(remove_empty):
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
def _handler_installed() -> Iterator[None]:
    """Installs `Stop.handle` for SIGINT, SIGTERM and SIGHUP (not where `nohup` has it ignored), clears the
    flag of earlier signals, and restores the former handlers at the end; within another body it does nothing.
    """
    if signal.getsignal(signal.SIGINT) == _stop.handle:
        yield
        return
    _stop.begin()
    handled = [n for n in SIGNALS if n != signal.SIGHUP or signal.getsignal(n) != signal.SIG_IGN]
    before = {number: signal.signal(number, _stop.handle) for number in handled}
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)
