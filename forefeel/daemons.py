"""Runs one daemon in this process until it is told to stop, in order: stage at rest, devices and files
closed.
"""

import asyncio
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from secrets import randbits
from typing import TYPE_CHECKING

from forefeel.common.events.console import ConsoleNotifier
from forefeel.common.runtime.real import RealRuntime
from forefeel.common.runtime.realtime import prepare_process, prepare_thread
from forefeel.common.runtime.service_manager import ServiceManager, ServiceWatchdog
from forefeel.common.settings import DaemonSettings
from forefeel.devices.shared.stream import latency_warning
from forefeel.interrupt import Stop, heeded
from forefeel.local.daemon_state import daemon_state
from forefeel.local.handlers import MasterHandlers, SlaveHandlers
from forefeel.local.server import LocalServer
from forefeel.master.settings import MasterSettings
from forefeel.parent import die_with_parent
from forefeel.probe.configured import configured, import_drivers
from forefeel.session import (
    POLL_S,
    MasterSession,
    closed_on_failure,
    connecting,
    obstacles,
    open_session,
    opened,
)
from forefeel.slave.settings import SlaveSettings
from forefeel.terminal import say

if TYPE_CHECKING:
    from forefeel.master.axis import MasterAxis
    from forefeel.master.daemon import MasterDaemon
    from forefeel.slave.axis import SlaveAxis
    from forefeel.slave.daemon import SlaveDaemon

# ns between two looks for notices; chosen, not measured: the terminal shows them as much later
_NOTICES_NS = 100_000_000
_BELOW_THE_LOOP = 20  # of SCHED_FIFO's priorities
# s that an end waits for the stage to rest; chosen, not measured: shorter ends it during a slow stop
_REST_S = 2.0
_FAREWELL_S = 0.3  # the master says "deadman released" for this long, and the force fades, before it goes


def run_slave(settings: SlaveSettings, duration_s: float | None = None, insecure: bool = False) -> None:
    """Runs the slave until a signal (SIGINT, SIGTERM, SIGHUP), the duration or a fault. `insecure`: see
    `check_exposure`.

    Raises:
        InputError: an endpoint or a file can not be used. RunError: a fault ended it.
    """
    die_with_parent()
    asyncio.run(_slave(settings, duration_s, insecure))


def run_master(settings: MasterSettings, duration_s: float | None = None, insecure: bool = False) -> None:
    """Runs the master until a signal (SIGINT, SIGTERM, SIGHUP), the duration (from the opened session), the
    end of a played motion, or a fault. `insecure`: see `check_exposure`.

    Raises:
        InputError: an endpoint or a file can not be used, or no slave answers. RunError: a fault ended it.
    """
    die_with_parent()
    asyncio.run(_master(settings, duration_s, insecure))


async def _slave(settings: SlaveSettings, duration_s: float | None, insecure: bool) -> None:
    from forefeel.slave.daemon import SlaveDaemon  # noqa: PLC0415 - each daemon loads only its own side

    import_drivers(settings)  # before real-time priority
    with (
        _runtime(settings) as (runtime, stop),
        daemon_state(settings, "slave", runtime.clock) as state,
        LocalServer(state.path, "slave") as local,  # before the network: a stop needs no connection
    ):
        found = obstacles(settings, "slave")
        transport = await opened(settings, "slave", runtime, insecure, duration_s, found)
        if transport is None:
            return
        with closed_on_failure(transport):
            daemon = SlaveDaemon(settings, transport, runtime, _new_id, state.event_sink)
        with _closing(daemon, runtime):
            notifier = _notifier("slave", daemon.axes)
            runtime.task("notices", _NOTICES_NS, notifier.serve)
            warn_of_latency("slave", settings)
            watchdog = _service_watchdog(runtime, daemon.axes)
            handlers = SlaveHandlers(daemon, state.event_sink, runtime.clock)
            async with runtime, local.serving(handlers):
                say(f"slave: axes {_names(daemon.axes)}; {_endpoints(settings)}; waiting for a master")
                await _until(runtime, duration_s, connecting(settings, transport, found))
                watchdog.stopping(_why(runtime))
                daemon.shut_down()
                await _rest(daemon, stop)
        notifier.serve(runtime.clock.now_ns())
        end = "stage at rest" if daemon.at_rest else "stage told to hold"
        state.close(_ended(runtime, end))
        say(f"slave: {end}, closed")
        runtime.raise_fault()


async def _master(settings: MasterSettings, duration_s: float | None, insecure: bool) -> None:
    from forefeel.common.estimation.forecast import compile_kernels  # noqa: PLC0415 - the slave does without it
    from forefeel.master.daemon import MasterDaemon  # noqa: PLC0415

    import_drivers(settings)
    compile_kernels()  # before real-time priority: a second of it would stop every other process for 50 ms
    with (
        _runtime(settings) as (runtime, _),
        daemon_state(settings, "master", runtime.clock) as state,
        LocalServer(state.path, "master") as local,
    ):
        found = obstacles(settings, "master")
        transport = await opened(settings, "master", runtime, insecure, settings.peer_timeout_s, found)
        if transport is None:
            return
        with closed_on_failure(transport):
            daemon = MasterDaemon(settings, transport, runtime, _new_id, state.event_sink)
        with _closing(daemon, runtime):
            notifier = _notifier("master", daemon.axes)
            runtime.task("notices", _NOTICES_NS, notifier.serve)
            warn_of_latency("master", settings)
            watchdog = _service_watchdog(runtime, daemon.axes)
            say(f"master: axes {_names(daemon.axes)}; {_endpoints(settings)}; waiting for the slave")
            async with runtime, local.serving(MasterHandlers(daemon, runtime.clock)):
                session = MasterSession(daemon, settings, transport, found)
                await open_session(session, runtime, settings.peer_timeout_s)
                if not runtime.stopping.is_set():
                    say(f"master: session open; loop: {runtime.scheduling}")
                await _until(runtime, duration_s, session.look, lambda: daemon.finished)
                watchdog.stopping(_why(runtime))
                daemon.shut_down()
                await asyncio.sleep(_FAREWELL_S)
        notifier.serve(runtime.clock.now_ns())
        state.close(_ended(runtime, "handle released"))
        say("master: handle released, closed")
        runtime.raise_fault()


def _notifier(role: str, axes: "Sequence[SlaveAxis | MasterAxis]") -> ConsoleNotifier:
    return ConsoleNotifier(role, {axis.name: axis.events.notices for axis in axes}, say)


def warn_of_latency(role: str, settings: DaemonSettings) -> None:
    """A line for each serial adapter that delays every answer."""
    ports = dict.fromkeys(device.serial_port for device in configured(settings) if device.serial_port)
    for warning in filter(None, map(latency_warning, ports)):
        say(f"{role}: {warning}")


def _endpoints(settings: DaemonSettings) -> str:
    """Where it listens and connects, in words."""
    transport = settings.transport
    parts = [f"listening on {', '.join(transport.listen)}"] if transport.listen else []
    parts += [f"connecting to {', '.join(transport.connect)}"] if transport.connect else []
    if transport.pki is not None:
        parts[-1:] = [f"{parts[-1]} with the certificates in {transport.pki}"] if parts else []
    return " and ".join(parts) or "no endpoint configured"


@contextmanager
def _closing(daemon: "SlaveDaemon | MasterDaemon", runtime: RealRuntime) -> Iterator[None]:
    """Closes the daemon in the end, whatever happens: it is open from its composition on, not its run."""
    try:
        yield
    finally:
        daemon.close(runtime.clock.now_ns())


@contextmanager
def _runtime(settings: DaemonSettings) -> Iterator[tuple[RealRuntime, Stop]]:
    """A runtime that a signal stops, in a process whose every thread is ahead of the machine's other work,
    below the loop.

    Threads inherit it: those of Zenoh, the receivers, the timers (docs/decisions/0008). The process is
    settled before a device is opened: it would hear nothing of us meanwhile.
    """
    prepare_process()
    priority = settings.realtime.priority
    prepare_thread(priority - _BELOW_THE_LOOP if priority else 0)
    runtime = RealRuntime(priority)
    loop = asyncio.get_running_loop()
    with heeded(lambda: loop.call_soon_threadsafe(runtime.stop)) as stop:
        yield runtime, stop


def _service_watchdog(runtime: RealRuntime, axes: "Sequence[SlaveAxis | MasterAxis]") -> ServiceWatchdog:
    """Tells systemd, where it started this process, how the daemon does."""

    def status(now_ns: int) -> str:
        return "; ".join(f"axis {axis.name}: {axis.status(now_ns)}" for axis in axes)

    manager = ServiceManager(os.environ, os.getpid())
    watchdog = ServiceWatchdog(manager, lambda: runtime.ticks, status)
    runtime.task("service watchdog", watchdog.period_ns, watchdog.look)
    return watchdog


def _why(runtime: RealRuntime) -> str:
    return "stopping" if runtime.error is None else f"stopping, fault: {runtime.error}"


async def _until(
    runtime: RealRuntime,
    duration_s: float | None,
    look: Callable[[int], object],
    finished: Callable[[], bool] = lambda: False,
) -> None:
    """Returns when the daemon is to end: told to, the duration is over, or the motion that is played has
    ended. Calls `look` meanwhile.
    """
    start_ns = runtime.clock.now_ns()
    while not runtime.stopping.is_set():
        now_ns = runtime.clock.now_ns()
        if finished() or (duration_s is not None and now_ns - start_ns >= duration_s * 1e9):
            return
        look(now_ns)
        await asyncio.sleep(POLL_S)


def _ended(runtime: RealRuntime, how: str) -> str:
    """How the daemon ended, for its event log."""
    error = runtime.error
    return how if error is None else f"{how}; by a fault: {type(error).__name__}: {error}"[:500]


async def _rest(daemon: "SlaveDaemon", stop: Stop) -> None:
    """Until the stage is at rest; a second signal does not wait for it, the stage is told to hold by then."""
    for _ in range(int(_REST_S / POLL_S)):
        if daemon.at_rest or stop.again():
            break
        await asyncio.sleep(POLL_S)
    await asyncio.sleep(POLL_S)  # the last events go out


def _new_id() -> int:
    return randbits(62) | 1


def _names(axes: "list[SlaveAxis] | list[MasterAxis]") -> str:
    return ", ".join(axis.name for axis in axes)
