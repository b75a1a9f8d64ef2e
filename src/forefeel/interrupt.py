"""SIGINT, SIGTERM and SIGHUP alike end a command in order: one flag, and one stack of clean-ups.

The handler raises nothing, for it may run inside a callback of a library that swallows what is raised. Where
nothing has to be closed it ends the process in place (`ends_in_order`), else the body looks at the flag
(`signal_flag`). Before and after both the system ends the process.
"""

import atexit
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NoReturn

from forefeel.common.errors import RunError
from forefeel.terminal import flush, last_word

SIGNALS = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
_ONE_S = 0.5  # signals within it are one: a terminal that closes sends two, and so do impatient fingers


class Stop:
    """Flag that the first signal sets, and the acts before the process ends; `signal_flag` gives it."""

    def __init__(self) -> None:
        self.cleanups: list[Callable[[], str | None]] = []
        self.on_signal: Callable[[], object] | None = self.end
        self.first_s: float | None = None
        self.noticed = False

    def wanted(self) -> bool:
        """True once a signal came; who asks is taken to end in order."""
        self.noticed = self.first_s is not None
        return self.noticed

    def check(self) -> None:
        """Raises KeyboardInterrupt when a signal came: in a loop of ours, where that is safe."""
        if self.wanted():
            raise KeyboardInterrupt

    def polls(self, duration_s: float | None, every_s: float = 0.0) -> Iterator[None]:
        """Yields every `every_s` until a signal came or the duration is over (None: no limit)."""
        start_s = time.monotonic()
        while not self.wanted() and (duration_s is None or time.monotonic() - start_s < duration_s):
            yield
            if every_s:
                time.sleep(every_s)

    def handle(self, *_: object) -> None:
        """Sets the flag and calls `on_signal`; without one a second signal ends the process. Ignores one
        within 0.5 s after the first.
        """
        now_s, again = time.monotonic(), self.first_s is not None
        if self.first_s is None:
            self.first_s = now_s
        elif now_s - self.first_s < _ONE_S:
            return
        if self.on_signal is not None:
            self.noticed = True
            self.on_signal()
        elif again:
            self.end()

    def end(self) -> None:
        """Ends the process at once with exit code 1, after the clean-ups, the newest first, whatever they
        raise; prints the first text that one returns. Never returns; later signals kill.
        """
        for number in SIGNALS:
            signal.signal(number, signal.SIG_DFL)
        texts: list[str | None] = []
        for act in reversed(self.cleanups):
            with suppress(Exception):
                texts.append(act())
        last_word(next(filter(None, texts), "interrupted"))
        os._exit(1)


_stop = Stop()


@contextmanager
def signal_flag(on_signal: Callable[[], object] | None = None) -> Iterator[Stop]:
    """Gives `Stop`, whose flag the first signal in the body sets; a second one ends the process at once. If
    the body never asks for the flag, a signal ends the process after the outermost body, with its files
    whole.

    Args:
        on_signal: called at each signal instead; no signal cuts such a body short. It is called wherever the
            main thread is, so it must not wait for anything.
    """
    if signal.getsignal(signal.SIGINT) != _stop.handle:
        _stop.first_s, _stop.noticed = None, False
    outer, _stop.on_signal = _stop.on_signal, on_signal
    numbers = [n for n in SIGNALS if n != signal.SIGHUP or signal.getsignal(n) != signal.SIG_IGN]  # `nohup`
    before = {number: signal.signal(number, _stop.handle) for number in numbers}
    try:
        yield _stop
    finally:
        _stop.on_signal = outer
        for number, handler in before.items():
            signal.signal(number, handler)
    if _stop.first_s is not None and not _stop.noticed and outer == _stop.end:
        _stop.end()


def break_off() -> NoReturn:
    """Raises KeyboardInterrupt, as `on_signal` of a body that waits for devices and persons in plain Python,
    where nothing swallows it. No later signal cuts the end of that body short.
    """
    _stop.on_signal = lambda: None
    raise KeyboardInterrupt


@contextmanager
def at_last(act: Callable[[], str | None]) -> Iterator[None]:
    """Calls `act` at the end of the body, whatever ends it, also a signal that ends the process in place, for
    which `act` may return the last words; one that comes during the call repeats it.
    """
    _stop.cleanups.append(act)
    try:
        yield
    finally:
        act()
        _stop.cleanups.pop()


@contextmanager
def ends_in_order(what: str, folder: Path | None = None) -> Iterator[list[str]]:
    """Ends a command at a signal in the body with one line that says which files are left: in place with exit
    code 1, or by RunError after a KeyboardInterrupt (`Stop.check`, `break_off`). Gives a list, to which the
    body adds the names of the files that are there and whole.

    Args:
        what: what is interrupted, in words.
        folder: where the body writes. What it made of the path and left empty is removed, however it ends.

    Raises:
        RunError: a signal came, and the body raised KeyboardInterrupt.
    """
    written: list[str] = []
    made = [path for path in (folder, *folder.parents) if not path.exists()] if folder else []

    def clean_up() -> str:
        for path in made:
            with suppress(OSError):  # not empty, or not made yet
                path.rmdir()
        where = f" in {folder}" if folder else ""
        return f"{what} interrupted; " + (", ".join(written) + where if written else "nothing was written")

    with signal_flag(_stop.end), at_last(clean_up):
        try:
            yield written
        except KeyboardInterrupt:
            raise RunError(clean_up()) from None


def leave(code: int) -> NoReturn:
    """Ends the process; once a signal came without taking Python apart, a second's work on a busy machine."""
    if _stop.first_s is not None:
        atexit._run_exitfuncs()
        flush()
        os._exit(code)
    sys.exit(code)
