"""`forefeel record`: a cell to a file until Ctrl-C."""

import time
from contextlib import closing
from pathlib import Path

from forefeel.common.clock import MonotonicClock
from forefeel.common.errors import RunError
from forefeel.common.runtime.service_manager import service_watchdog
from forefeel.common.transport.endpoints import address
from forefeel.common.transport.security import Party
from forefeel.interrupt import Stop, at_last, ends_in_order, heeded
from forefeel.network_settings import ObserverSettings
from forefeel.reachability import AnswerWatch, Obstacles, unheard
from forefeel.recorder import Recorder
from forefeel.terminal import say

_POLL_S = 0.1  # s between two looks for an end; chosen, not measured: a signal is heeded as late


def run_record(
    out: Path, settings: ObserverSettings, duration_s: float | None, insecure: bool = False
) -> None:
    """Records until SIGINT, SIGTERM, SIGHUP or the duration; says while nobody is heard, and what was missed.

    Raises:
        InputError: the file, an endpoint or a certificate can not be used; nothing was written.
        RunError: recording failed, or nothing was recorded; then there is no file.
    """
    cell = settings.cell
    party = Party(settings.role, (cell,))
    where = ", ".join(map(address, settings.transport.connect + settings.transport.listen))
    recorder: Recorder | None = None
    there = out.exists()

    def drop_empty() -> None:
        if not there and not (recorder and recorder.written):
            out.unlink(missing_ok=True)

    with ends_in_order("recording"), at_last(drop_empty):
        recorder = Recorder(out, cell, settings.transport, {"run": {"cell": cell}}, party, insecure)
        with heeded() as stop, closing(recorder):
            if recorder.notice:
                say(recorder.notice)
            say(f"recording cell {cell} to {out}; Ctrl-C ends")
            _wait(recorder, settings, duration_s, stop)
    if not recorder.written:
        raise RunError(f"{out}: nothing was recorded, nobody of cell {cell} was heard at {where}")
    say(f"{out}: closed, {recorder.summary}")


def _wait(recorder: Recorder, settings: ObserverSettings, duration_s: float | None, stop: Stop) -> None:
    transport, cell = settings.transport, settings.cell

    def nobody() -> str:
        return unheard(transport, recorder.connected, f"nobody of cell {cell} is heard there")

    other = "router" if transport.mode == "client" else "daemon"
    obstacles = Obstacles(transport, Party(settings.role, (cell,)), other)
    waiting = AnswerWatch(obstacles, nobody, lambda cause: say(f"nobody heard yet: {cause}"))
    clock, start_s = MonotonicClock(), time.monotonic()
    attend = service_watchdog(
        lambda: "recording" if recorder.newest else f"nobody heard yet: {waiting.found}",
        lambda: recorder.rounds,
    )
    while not stop.wanted() and (duration_s is None or time.monotonic() - start_s < duration_s):
        recorder.check()
        attend()
        if recorder.newest:
            waiting.over()
        else:
            sure = recorder.connected and not transport.listen
            waiting.look(clock.now_ns(), recorder.hint or (nobody() if sure else ""))
        time.sleep(_POLL_S)
