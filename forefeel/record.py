"""`forefeel record`: a cell to a file until Ctrl-C."""

import time
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from common.errors import RunError
from common.topics import checked_segment
from common.transport.settings import TransportSettings
from forefeel.interrupt import interruptible
from forefeel.recorder import Recorder

_POLL_S = 0.1
_REMIND_S = 5.0


def run_record(out: Path, cell: str, connect: tuple[str, ...], duration_s: float | None) -> None:
    """Records until SIGINT, SIGTERM or the duration; says while nobody is heard, and what was missed.

    Raises:
        InputError: the file, an endpoint or the cell's name can not be used; nothing was written.
        RunError: recording failed, or nothing was recorded; then there is no file.
    """
    checked_segment(cell, "--cell")
    recorder = Recorder(out, cell, TransportSettings(connect=connect), {"run": {"cell": cell}})
    console, where = Console(stderr=True, highlight=False, markup=False, soft_wrap=True), ", ".join(connect)
    console.print(f"recording cell {cell} to {out}; Ctrl-C ends")
    with interruptible() as ignore_signals:
        try:
            _wait(recorder, duration_s, lambda s: console.print(f"nobody heard yet at {where} ({s:.0f} s)"))
        except KeyboardInterrupt:
            pass
        finally:
            ignore_signals()
            recorder.close()
    if not recorder.written:
        out.unlink()
        raise RunError(f"{out}: nothing was recorded, nobody of cell {cell} was heard at {where}")
    console.print(f"{out}: closed, {recorder.summary}")


def _wait(recorder: Recorder, duration_s: float | None, remind: Callable[[float], None]) -> None:
    start_s = reminded_s = time.monotonic()
    while duration_s is None or time.monotonic() - start_s < duration_s:
        recorder.check()
        if not recorder.newest and time.monotonic() - reminded_s >= _REMIND_S:
            reminded_s = time.monotonic()
            remind(reminded_s - start_s)
        time.sleep(_POLL_S)
