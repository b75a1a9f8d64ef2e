"""`forefeel record`: a cell to a file until Ctrl-C."""

import time
from collections.abc import Callable
from pathlib import Path

from common.errors import RunError
from common.runtime.service_manager import attended
from common.transport.security import Party
from forefeel.interrupt import interruptible
from forefeel.network_settings import ObserverSettings
from forefeel.recorder import Recorder
from forefeel.strand_watch import PERIOD_NS, StrandWatch
from forefeel.terminal import say

_POLL_S = 0.1
_REMIND_S = 5.0


def run_record(
    out: Path, settings: ObserverSettings, duration_s: float | None, insecure: bool = False
) -> None:
    """Records until SIGINT, SIGTERM or the duration; says while nobody is heard, and what was missed.

    Raises:
        InputError: the file, an endpoint or a certificate can not be used; nothing was written.
        RunError: recording failed, or nothing was recorded; then there is no file.
    """
    cell = settings.cell
    party = Party(settings.role, (cell,))
    recorder = Recorder(out, cell, settings.transport, {"run": {"cell": cell}}, party, insecure)
    where = ", ".join(settings.transport.connect + settings.transport.listen)
    if recorder.notice:
        say(recorder.notice)
    say(f"recording cell {cell} to {out}; Ctrl-C ends")
    with interruptible() as ignore_signals:
        try:
            strands = StrandWatch(recorder, say)
            _wait(recorder, duration_s, lambda s: say(_nobody(recorder, where, s)), strands)
        except KeyboardInterrupt:
            pass
        finally:
            ignore_signals()
            recorder.close()
    if not recorder.written:
        out.unlink()
        raise RunError(f"{out}: nothing was recorded, nobody of cell {cell} was heard at {where}")
    say(f"{out}: closed, {recorder.summary}")


def _nobody(recorder: Recorder, where: str, waited_s: float) -> str:
    hint = recorder.hint
    return f"nobody heard yet at {where}{hint and f': {hint}'} ({waited_s:.0f} s)"


def _wait(
    recorder: Recorder, duration_s: float | None, remind: Callable[[float], None], strands: StrandWatch
) -> None:
    start_s = reminded_s = looked_s = time.monotonic()
    attend = attended(lambda: "recording" if recorder.newest else "nobody heard yet", lambda: recorder.rounds)
    while duration_s is None or time.monotonic() - start_s < duration_s:
        recorder.check()
        attend()
        if not recorder.newest and time.monotonic() - reminded_s >= _REMIND_S:
            reminded_s = time.monotonic()
            remind(reminded_s - start_s)
        if time.monotonic() - looked_s >= PERIOD_NS * 1e-9:
            looked_s = time.monotonic()
            strands.look(0)
        time.sleep(_POLL_S)
