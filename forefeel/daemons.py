"""Runs one daemon in this process until it is told to stop, in order: stage at rest, devices and files
closed.
"""

import asyncio
import ctypes
import os
import signal
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from secrets import randbits
from typing import TYPE_CHECKING

from common.errors import ConfigurationError, EndpointError, RunError
from common.notices import Notices, RateLimit
from common.runtime.real import RealRuntime
from common.runtime.realtime import prepare_process, prepare_thread
from common.settings import DaemonSettings
from common.transport.zenoh_bus import ZenohTransport
from master.session import Link
from master.settings import MasterSettings
from slave.settings import SlaveSettings

if TYPE_CHECKING:
    from master.axis import MasterAxis
    from master.daemon import MasterDaemon
    from slave.axis import SlaveAxis
    from slave.daemon import SlaveDaemon

_POLL_S = 0.05
_SPEAK_NS = 100_000_000
_BELOW_THE_LOOP = 20  # of SCHED_FIFO's priorities
_REST_S = 2.0
_FAREWELL_S = 0.3  # the master says "deadman released" for this long, and the force fades, before it goes
_REMIND_S = 5.0
_PR_SET_PDEATHSIG = 1


def say(text: str) -> None:
    """One line to the person at the terminal or to the journal."""
    print(text, file=sys.stderr, flush=True)


class _Speaker:
    """Says what the axes of a daemon have to tell; a terminal that is gone stops nothing."""

    def __init__(self, role: str, notices: Mapping[str, Notices]) -> None:
        self._role = role
        self._notices = notices
        self._limit = RateLimit()

    def speak(self, now_ns: int) -> None:
        """What came since the last call; about ten times a second."""
        for name, notices in self._notices.items():
            for text in self._limit.passed(notices.drain(), now_ns):
                with suppress(OSError):
                    say(f"{self._role}: axis {name}: {text}")


def run_slave(settings: SlaveSettings, duration_s: float | None = None) -> None:
    """Runs the slave until SIGINT, SIGTERM, the duration or a fault.

    Raises:
        InputError: an endpoint or a file can not be used. RunError: a fault ended it.
    """
    die_with_parent()
    asyncio.run(_slave(settings, duration_s))


def run_master(settings: MasterSettings, duration_s: float | None = None) -> None:
    """Runs the master until SIGINT, SIGTERM, the duration (from the opened session), the end of a played
    motion, or a fault.

    Raises:
        InputError: an endpoint or a file can not be used, or no slave answers. RunError: a fault ended it.
    """
    die_with_parent()
    asyncio.run(_master(settings, duration_s))


async def _slave(settings: SlaveSettings, duration_s: float | None) -> None:
    from slave.daemon import SlaveDaemon  # noqa: PLC0415 - each daemon loads only its own side

    runtime = _runtime(settings)
    with _opened(settings, runtime) as transport:
        daemon = SlaveDaemon(settings, transport, runtime, _new_id)
    speaker = _Speaker("slave", {axis.name: axis.notices for axis in daemon.axes})
    runtime.task("notices", _SPEAK_NS, speaker.speak)
    say(f"slave: axes {_names(daemon.axes)}; {_endpoints(settings)}; waiting for a master")
    async with runtime:
        await _until(runtime, duration_s)
        daemon.shut_down()
        await _rest(daemon)
    daemon.close(runtime.clock.now_ns())
    speaker.speak(runtime.clock.now_ns())
    say(f"slave: {'stage at rest' if daemon.at_rest else 'stage told to hold'}, closed")
    runtime.raise_fault()


async def _master(settings: MasterSettings, duration_s: float | None) -> None:
    from master.daemon import MasterDaemon  # noqa: PLC0415 - the slave does without its compiled predictor

    runtime = _runtime(settings)
    with _opened(settings, runtime) as transport:
        daemon = MasterDaemon(settings, transport, runtime, _new_id)
    speaker = _Speaker("master", {axis.name: axis.events.notices for axis in daemon.axes})
    runtime.task("notices", _SPEAK_NS, speaker.speak)
    say(f"master: axes {_names(daemon.axes)}; {_endpoints(settings)}; waiting for the slave")
    try:
        async with runtime:
            await _session(daemon, runtime, settings.peer_timeout_s, settings.transport.connect)
            if not runtime.stopping.is_set():
                say(f"master: session open; loop: {runtime.scheduling}")
            await _until(runtime, duration_s, daemon)
            daemon.shut_down()
            await asyncio.sleep(_FAREWELL_S)
    finally:
        daemon.close(runtime.clock.now_ns())
    speaker.speak(runtime.clock.now_ns())
    say("master: handle released, closed")
    runtime.raise_fault()


@contextmanager
def _opened(settings: DaemonSettings, runtime: RealRuntime) -> Iterator[ZenohTransport]:
    """The daemon's transport, which the daemon closes; closed here when the daemon can not be composed."""
    transport = ZenohTransport.open(settings.transport, runtime.clock, runtime.fault)
    try:
        yield transport
    except BaseException:
        transport.close()
        raise


def _runtime(settings: DaemonSettings) -> RealRuntime:
    """A runtime in a process whose every thread is ahead of the machine's other work, below the loop.

    Threads inherit it: those of Zenoh, the receivers, the timers (docs/decisions/0008). The process is
    settled before a device is opened: it would hear nothing of us meanwhile.
    """
    prepare_process()
    priority = settings.realtime.priority
    prepare_thread(max(1, priority - _BELOW_THE_LOOP) if priority else 0)
    runtime = RealRuntime(priority)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, runtime.stop)
    return runtime


async def _session(
    daemon: "MasterDaemon", runtime: RealRuntime, timeout_s: float | None, connect: tuple[str, ...]
) -> None:
    """Waits visibly until every axis has its session."""
    start_ns, reminded_s = runtime.clock.now_ns(), 0.0
    while not runtime.stopping.is_set():
        waiting = [axis for axis in daemon.axes if axis.session.link is not Link.OPEN]
        if not waiting:
            return
        axis, waited_s = waiting[0], (runtime.clock.now_ns() - start_ns) * 1e-9
        where = ", ".join(connect) or "our own endpoint"
        _refuse_mismatch(waiting)
        if timeout_s is not None and waited_s > timeout_s:
            word = axis.session.reason if axis.session.heard_ns else "no answer"
            raise EndpointError(
                f"{where}: no session with a slave within {timeout_s:g} s ({word}); "
                f"expected a running slave of the same cell (peer_timeout_s)"
            )
        if waited_s - reminded_s >= _REMIND_S:
            reminded_s = waited_s
            say(f"master: waiting for the slave at {where}: {axis.session.reason} ({waited_s:.0f} s)")
        await asyncio.sleep(_POLL_S)


async def _until(
    runtime: RealRuntime, duration_s: float | None, daemon: "MasterDaemon | None" = None
) -> None:
    """Returns when the daemon is to end: told to, the duration is over, or the motion that is played has
    ended.
    """
    start_ns, linked = runtime.clock.now_ns(), True
    while not runtime.stopping.is_set():
        if duration_s is not None and runtime.clock.now_ns() - start_ns >= duration_s * 1e9:
            return
        if daemon is not None:
            if daemon.finished:
                return
            linked = _show_link(daemon, linked)
        await asyncio.sleep(_POLL_S)


def _show_link(daemon: "MasterDaemon", linked: bool) -> bool:
    """Says when a session was lost and when all are open again; whether they are."""
    waiting = [axis for axis in daemon.axes if axis.session.link is not Link.OPEN]
    _refuse_mismatch(waiting)
    if waiting and linked:
        say(f"master: axis {waiting[0].name}: {waiting[0].session.reason}; waiting for the slave")
    elif not waiting and not linked:
        say("master: session open again")
    return not waiting


def _refuse_mismatch(waiting: "list[MasterAxis]") -> None:
    """Settings that differ do not come right by waiting."""
    for axis in waiting:
        if axis.session.link is Link.MISMATCH:
            raise ConfigurationError(f"axis {axis.name}: the slave refuses: {axis.session.reason}")


async def _rest(daemon: "SlaveDaemon") -> None:
    for _ in range(int(_REST_S / _POLL_S)):
        if daemon.at_rest:
            break
        await asyncio.sleep(_POLL_S)
    await asyncio.sleep(_POLL_S)  # the last events go out


def _new_id() -> int:
    return randbits(62) | 1


def _names(axes: "list[SlaveAxis] | list[MasterAxis]") -> str:
    return ", ".join(axis.name for axis in axes)


def _endpoints(settings: DaemonSettings) -> str:
    transport = settings.transport
    parts = [f"listening on {', '.join(transport.listen)}"] if transport.listen else []
    parts += [f"connecting to {', '.join(transport.connect)}"] if transport.connect else []
    return " and ".join(parts) or "no endpoint configured"


def die_with_parent() -> None:
    """A daemon that a loopback started does not outlive it, however that ends."""
    parent = os.environ.get("FOREFEEL_PARENT")
    if parent is None:
        return
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != int(parent):  # it ended before we asked for the signal
        raise RunError("the loopback that started this daemon has ended")
