"""SIGINT and SIGTERM alike end a run, and neither disturbs its orderly end."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

from common.errors import RunError

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_Handler = Callable[[int, FrameType | None], None]


@contextmanager
def interruptible() -> Iterator[Callable[[], None]]:
    """The first signal raises KeyboardInterrupt in the body, later ones do nothing.

    Gives a function after which none does anything: call it where the orderly end begins.
    """

    def ignore() -> None:
        for number in _SIGNALS:
            signal.signal(number, signal.SIG_IGN)

    def interrupt(number: int, frame: FrameType | None) -> None:
        del number, frame
        ignore()
        raise KeyboardInterrupt

    with _handled(interrupt):
        yield ignore


@contextmanager
def postponed() -> Iterator[None]:
    """A signal in the body waits for its end: what is written there is written whole."""
    came: list[int] = []
    with _handled(lambda number, _frame: came.append(number)):
        yield
    if came:
        signal.raise_signal(came[0])


@contextmanager
def ends_in_order(what: str, folder: Path) -> Iterator[list[str]]:
    """A signal in the body ends it as a run that failed, in one line that says what is left.

    Args:
        what: what is interrupted, in words.
        folder: where the body writes. When the body made it and left nothing in it, it goes, too.

    Gives a list for the names of the files that are there and whole.

    Raises:
        RunError: a signal came.
    """
    written: list[str] = []
    was_there = folder.exists()
    with interruptible():
        try:
            yield written
        except KeyboardInterrupt:
            if not was_there:
                with suppress(OSError):  # not empty, or not made yet
                    folder.rmdir()
            left = f"{', '.join(written)} in {folder}" if written else "nothing was written"
            raise RunError(f"{what} interrupted; {left}") from None


@contextmanager
def _handled(handler: _Handler) -> Iterator[None]:
    before = {number: signal.signal(number, handler) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)
