"""Runs one daemon in this process until it is told to stop, in order: stage at rest, devices and files
closed.
"""

import asyncio
import gc
import hashlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from secrets import randbits
from typing import TYPE_CHECKING, TypeVar

from forefeel.child_process import die_with_parent
from forefeel.common.config import dump_yaml
from forefeel.common.daemon import software_version
from forefeel.common.errors import ConfigurationError, EndpointError, NoRouterError
from forefeel.common.events.console import Notices, tell_notices
from forefeel.common.runtime.real import Host, RealRuntime
from forefeel.common.runtime.service_manager import ServiceManager, ServiceWatchdog
from forefeel.common.settings import DaemonSettings, LinkImpairment
from forefeel.common.state.event_log import StateEventSink
from forefeel.common.state.folder import StateFolder, state_path
from forefeel.common.transport.parallel import ParallelTransport
from forefeel.common.transport.security import Party
from forefeel.configured_devices import configured, import_drivers
from forefeel.control_socket import ControlSocket, MasterRequests, SlaveRequests
from forefeel.interrupt import signal_flag
from forefeel.master.session import SessionState
from forefeel.reachability import AnswerWatch, Probe, probe_of, silence_cause
from forefeel.terminal import say

if TYPE_CHECKING:
    from forefeel.master.axis import MasterAxis
    from forefeel.master.daemon import MasterDaemon
    from forefeel.master.settings import MasterSettings
    from forefeel.slave.axis import SlaveAxis
    from forefeel.slave.daemon import SlaveDaemon
    from forefeel.slave.settings import SlaveSettings

D = TypeVar("D", "SlaveDaemon", "MasterDaemon")
Connect = Callable[..., ParallelTransport]  # opens the transport, as `ParallelTransport.open`
_POLL_S = 0.05
_OPENING_S = 0.01  # between two looks at a transport or a session that is about to open
_ROUTER_S = 0.5  # between two attempts to reach the router
_NOTICES_NS = 100_000_000
_BELOW_THE_LOOP = 20  # of SCHED_FIFO's priorities
_REST_S = 2.0  # bounds the wait for the stage to rest
_FAREWELL_S = 0.3  # the master sends "deadman released" for this long, and the force fades, before it goes


def run_daemon(
    settings: "SlaveSettings | MasterSettings", duration_s: float | None = None, insecure: bool = False
) -> None:
    """Runs the slave or the master of these settings until a signal (SIGINT, SIGTERM, SIGHUP), the duration
    (a master's counts from the opened session), the end of a played motion, a fault, or its parent's end.
    Takes over the process: what is loaded now is never looked through for garbage. `insecure`: see
    `check_exposure`.

    Raises:
        InputError: no endpoint, one or a file that can not be used, or no slave or router that answers in
            time.
        RunError: a fault ended it.
    """
    if not (settings.transport.listen or settings.transport.connect):
        raise ConfigurationError("transport: no endpoint; expected one in listen or in connect")
    die_with_parent()
    gc.disable()  # what is loaded stays: to look for garbage in it took a tenth of the start
    # before real-time priority, at which half a second of imports would keep all others waiting
    import_module(f"forefeel.{settings.role}.daemon")  # each daemon loads only its own side
    import_drivers(settings)
    gc.freeze()
    gc.enable()
    if settings.role == "master":
        asyncio.run(master(settings, duration_s, insecure))
    else:
        asyncio.run(slave(settings, duration_s, insecure))


async def slave(
    settings: "SlaveSettings",
    duration_s: float | None,
    insecure: bool,
    host: Host | None = None,
    connect: Connect = ParallelTransport.open,
) -> None:
    """Runs a slave until it is told to end or `duration_s` is over, then brings the stage to rest and closes
    devices and files; returns at once when told to end before its transport is open. RunError: a fault ended
    it. NoRouterError: no router within `duration_s`. `connect` opens the transport.
    """
    from forefeel.slave.daemon import SlaveDaemon  # noqa: PLC0415 - each daemon loads only its own side

    with _daemon_process(settings, host, connect) as process:
        runtime = process.runtime
        transport = await process.open_transport(insecure, duration_s)
        if transport is None:
            return
        with process.closing(transport, SlaveDaemon) as daemon:
            watchdog = process.watch(daemon.axes)
            silence = partial(silence_cause, settings.transport, False, "")
            connection = process.answer_watch("a connection", silence)

            def look(now_ns: int) -> None:
                if not settings.transport.connect or (transport.peers() and not transport.hint):
                    connection.over()
                else:
                    connection.look(now_ns, transport.hint)

            requests = SlaveRequests(daemon, process.event_sink, runtime.clock)
            async with runtime, process.socket.serving(requests):
                process.say(f"{_described(settings)}; waiting for a master")
                await _until_end(runtime, duration_s, look)
                watchdog.stopping(_why(runtime))
                daemon.shut_down()
                await _rest(daemon)
        process.end = "stage at rest" if daemon.at_rest else "stage told to hold"
        process.finish()


async def master(
    settings: "MasterSettings",
    duration_s: float | None,
    insecure: bool,
    host: Host | None = None,
    connect: Connect = ParallelTransport.open,
) -> None:
    """Runs a master until it is told to end, `duration_s` after its sessions opened, or the end of a played
    motion; then releases the handle and closes it. EndpointError: no router or session within
    `peer_timeout_s` of the settings. ConfigurationError: the slave's settings differ. RunError: a fault ended
    it.
    """
    from forefeel.master.daemon import MasterDaemon  # noqa: PLC0415 - as above

    with _daemon_process(settings, host, connect) as process:
        runtime = process.runtime
        transport = await process.open_transport(insecure, settings.peer_timeout_s)
        if transport is None:
            return
        with process.closing(transport, MasterDaemon) as daemon:
            watchdog = process.watch(daemon.axes)
            process.say(f"{_described(settings)}; waiting for the slave")
            async with runtime, process.socket.serving(MasterRequests(daemon, runtime.clock)):
                sessions = SessionWatch(daemon.axes, settings, transport, process)
                await sessions.wait_until_open(settings.peer_timeout_s)
                if not runtime.stopping.is_set():
                    process.say(f"session open; loop: {runtime.scheduling}")
                await _until_end(runtime, duration_s, sessions.look, lambda: daemon.finished)
                watchdog.stopping(_why(runtime))
                daemon.shut_down()
                await asyncio.sleep(_FAREWELL_S)
        process.end = "handle released"
        process.finish()


@dataclass
class Process:
    """Resources of a daemon from its start to its end; `end`: text for its event log."""

    settings: DaemonSettings
    runtime: RealRuntime
    event_sink: StateEventSink
    socket: ControlSocket
    find_obstacles: Probe
    connect: Connect
    end: str = "ended"
    notices: Mapping[str, Notices] = field(default_factory=dict)

    def say(self, text: str) -> None:
        say(f"{self.settings.role}: {text}")

    def answer_watch(self, whom: str, silence: Callable[[], str]) -> AnswerWatch:
        """Makes a watch that says on the console why `whom` does not answer; `silence` gives the text where
        no endpoint is obstructed.
        """
        return AnswerWatch(
            self.find_obstacles,
            silence,
            lambda cause: self.say(f"waiting for {whom}: {cause}"),
            self.runtime.host,
        )

    async def open_transport(self, insecure: bool, timeout_s: float | None) -> ParallelTransport | None:
        """Opens the transport in a thread, for that may take ten seconds; again where no router answers. Says
        meanwhile why it waits; then says its notice and raises the priority of the threads. None: told to end
        before. NoRouterError: none within `timeout_s` (None: no limit); other errors of opening pass.
        """
        settings, runtime = self.settings, self.runtime
        watch = self.answer_watch("the router", lambda: silence_cause(settings.transport, False, ""))
        open_it = partial(
            self.connect,
            settings.transport,
            runtime.clock,
            runtime.fault,
            Party(self.settings.role, (settings.cell,)),
            insecure=insecure,
            real_stage=settings.real_stage,
        )
        start_ns = runtime.clock.now_ns()
        opening = runtime.host.in_thread(open_it, "zenoh open")
        while not runtime.stopping.is_set():
            now_ns = runtime.clock.now_ns()
            if opening.done():
                if not isinstance(opening.exception(), NoRouterError):
                    if opening.result().notice:
                        self.say(opening.result().notice)
                    self._take_priority()
                    return opening.result()
                await asyncio.sleep(_ROUTER_S)
                opening = runtime.host.in_thread(open_it, "zenoh open")
            if timeout_s is not None and now_ns - start_ns >= timeout_s * 1e9:
                opening.add_done_callback(_close_unused)
                cause = watch.cause(await asyncio.wrap_future(watch.probe()), now_ns)
                raise NoRouterError(f"no router within {timeout_s:g} s: {cause}")
            watch.look(now_ns)
            await asyncio.sleep(_OPENING_S)
        opening.add_done_callback(_close_unused)
        return None

    def _take_priority(self) -> None:
        """Raises the threads' priority and keeps them on a core (docs/decisions/0008), where the settings
        ask for a priority. Not before the transport is open, which takes a tenth of a second of computing:
        the threads of a cell that runs on this host would wait.
        """
        if priority := self.settings.realtime.priority:
            self.runtime.host.raise_threads(priority - _BELOW_THE_LOOP)
            self.runtime.host.keep_core(highest=self.settings.role == "slave")

    @contextmanager
    def closing(self, transport: ParallelTransport, kind: Callable[..., D]) -> Iterator[D]:
        """Makes the daemon of class `kind` on the transport and gives it to the block, at whose end it is
        closed, and with it the transport, whatever happens. Closes the transport if the making fails.
        """
        with ExitStack() as failed:
            failed.callback(transport.close)
            daemon = kind(self.settings, transport, self.runtime, lambda: randbits(62) | 1, self.event_sink)
            failed.pop_all()
        try:
            yield daemon
        finally:
            daemon.close(self.runtime.clock.now_ns())

    def watch(self, axes: "Sequence[SlaveAxis | MasterAxis]") -> ServiceWatchdog:
        """Registers the tasks that print the axes' notices and tell systemd status and liveness; sets
        `notices`; returns the one that tells systemd, to be informed when the daemon stops.
        """
        self.notices = {axis.name: axis.events.notices for axis in axes}
        self.runtime.task("notices", _NOTICES_NS, self._tell_notices)

        def status(now_ns: int) -> str:
            return "; ".join(f"axis {axis.name}: {axis.status(now_ns)}" for axis in axes)

        manager = ServiceManager(os.environ, os.getpid())
        watchdog = ServiceWatchdog(manager, lambda: self.runtime.ticks, status)
        self.runtime.task("service watchdog", watchdog.period_ns, watchdog.notify)
        return watchdog

    def _tell_notices(self, _now_ns: int = 0) -> None:
        tell_notices(self.settings.role, self.notices, say)

    def finish(self) -> None:
        """Says how the daemon ended. RunError: a fault ended it."""
        self._tell_notices()
        self.say(f"{self.end}, closed")
        self.runtime.raise_fault()


@contextmanager
def _daemon_process(settings: DaemonSettings, host: Host | None, connect: Connect) -> Iterator[Process]:
    """Prepares this process and thread for real time, then opens state folder, event log and control socket
    of a daemon for the length of a block; gives the Process, with which the block opens the network
    (`connect`) and the devices. A signal stops the runtime. The event log gets the start, and the end with
    its cause.

    The process is prepared before a device is opened, which would hear nothing of us meanwhile. The control
    socket is open before the network: a stop needs no connection.

    Raises:
        ConfigurationError: the folder is in use, or a file can not be used.
    """
    role = settings.role
    runtime = RealRuntime(settings.realtime.priority, host)
    runtime.host.prepare_process()
    runtime.host.prepare_thread(0)
    loop = asyncio.get_running_loop()
    with (
        signal_flag(lambda: loop.call_soon_threadsafe(runtime.stop)),
        StateFolder(state_path(settings, role, os.environ)) as folder,
    ):
        axes = [axis.name for axis in settings.axes]
        sink = StateEventSink(folder, runtime.clock, axes, settings.state.flight_records, runtime.host.worker)
        sink.start(_facts(settings))
        process, reason = None, ""
        try:
            with ControlSocket(folder.path, role) as control:
                other = {"slave": "master", "master": "slave"}[role]
                expected = "router" if settings.transport.mode == "client" else other
                find = probe_of(settings.transport, Party(role, (settings.cell,)), expected)
                process = Process(settings, runtime, sink, control, find, connect)
                yield process
        except BaseException as error:
            reason = f"; {type(error).__name__}: {error}"
            raise
        finally:
            sink.close(f"{process.end if process else 'not started'}{reason}"[:500])


class SessionWatch:
    """Watches the sessions of a master's axes; prints when one is lost or open again, and why."""

    def __init__(
        self,
        axes: "Sequence[MasterAxis]",
        settings: "MasterSettings",
        transport: ParallelTransport,
        process: Process,
    ) -> None:
        self._axes, self._settings, self._transport = axes, settings, transport
        self._process, self._runtime = process, process.runtime
        self._watch = process.answer_watch("the slave", self._silence_cause)
        self._open = self._lost = False

    def look(self, now_ns: int) -> bool:
        """True when every axis has its session. Prints when one is lost or all are open again, and every 5 s
        why the first is missing; sets the missing ones' `obstacle` to the cause that a probe found. To be
        called many times a second. ConfigurationError: the slave refuses, for the settings of both differ.
        """
        missing = self._missing()
        if not missing:
            if self._lost:
                self._process.say("session open again")
            self._open, self._lost = True, False
            self._watch.over()
            return True
        first = missing[0]
        if first.session.state is SessionState.MISMATCH:
            raise ConfigurationError(f"axis {first.name}: the slave refuses: {first.session.cause(now_ns)}")
        if self._open:
            self._process.say(f"axis {first.name}: {first.session.cause(now_ns)}; waiting for the slave")
            self._open, self._lost = False, True
        self._watch.look(now_ns, self._known(first, now_ns))
        for axis in missing:
            axis.session.obstacle = self._watch.last_cause
        return False

    async def wait_until_open(self, timeout_s: float | None) -> None:
        """Waits until every axis has its session, or the daemon is told to end; prints why not, as `look`.
        EndpointError: not within `timeout_s` (None: no limit). ConfigurationError: as `look`.
        """
        start_ns = self._runtime.clock.now_ns()
        while not self._runtime.stopping.is_set():
            now_ns = self._runtime.clock.now_ns()
            if self.look(now_ns):
                return
            if timeout_s is not None and now_ns - start_ns > timeout_s * 1e9:
                missing = self._missing()
                cause = self._known(missing[0], now_ns) if missing else ""
                if not cause:
                    cause = self._watch.cause(await asyncio.wrap_future(self._watch.probe()), now_ns)
                raise EndpointError(
                    f"no session with a slave within {timeout_s:g} s (peer_timeout_s): {cause}"
                )
            await asyncio.sleep(_OPENING_S)

    def _missing(self) -> "list[MasterAxis]":
        missing = [axis for axis in self._axes if axis.session.state is not SessionState.OPEN]
        return sorted(missing, key=lambda axis: axis.session.state is not SessionState.MISMATCH)

    def _known(self, axis: "MasterAxis", now_ns: int) -> str:
        """Cause why the axis has no session, if known without a probe: the transport's hint, the session's
        own where its slave is heard, or that nothing answers on a connection; else empty. A master that
        listens can not tell its peers.
        """
        if self._transport.hint:
            return self._transport.hint
        if axis.session.is_heard(now_ns):
            return f"axis {axis.name}: {axis.session.cause(now_ns)}"
        connected = self._transport.peers() and not self._settings.transport.listen
        return self._silence_cause() if connected else ""

    def _silence_cause(self) -> str:
        axes = ", ".join(axis.name for axis in self._missing())
        missing = f"no slave of cell {self._settings.cell}, axis {axes} answers there"
        return silence_cause(self._settings.transport, self._transport.peers() > 0, missing)


async def _until_end(
    runtime: RealRuntime,
    duration_s: float | None,
    look: Callable[[int], object],
    finished: Callable[[], bool] = lambda: False,
) -> None:
    """Waits until the daemon is to end: told to, `duration_s` from now over (None: no limit), or
    `finished()`. Calls `look` with the stamp every 50 ms meanwhile.
    """
    start_ns = runtime.clock.now_ns()
    while not runtime.stopping.is_set():
        now_ns = runtime.clock.now_ns()
        if finished() or (duration_s is not None and now_ns - start_ns >= duration_s * 1e9):
            return
        look(now_ns)
        await asyncio.sleep(_POLL_S)


async def _rest(daemon: "SlaveDaemon") -> None:
    for _ in range(int(_REST_S / _POLL_S)):
        if daemon.at_rest:
            break
        await asyncio.sleep(_POLL_S)
    await asyncio.sleep(_POLL_S)  # the last events go out


def _close_unused(opening: "Future[ParallelTransport]") -> None:
    if opening.exception() is None:
        opening.result().close()


def _described(settings: "SlaveSettings | MasterSettings") -> str:
    """One line for the console: axes with their limits, caveats, impairment, endpoints and certificates; what
    is empty is left out.
    """
    transport = settings.transport
    ways = {
        "axes": [axis.name + axis.limits.meaning for axis in settings.axes],
        "with": [f"{axis.name} {caveat}" for axis in settings.axes for caveat in axis.caveats],
        "impairment injected": ["into this end's messages"] * (settings.impairment != LinkImpairment()),
        "listening on": transport.listen,
        "connecting to": transport.connect,
        "certificates in": [str(transport.pki)] if transport.pki else [],
    }
    return "; ".join(f"{what} {', '.join(items)}" for what, items in ways.items() if items)


def _why(runtime: RealRuntime) -> str:
    return "stopping" if runtime.error is None else f"stopping, fault: {runtime.error}"


def _facts(settings: DaemonSettings) -> dict[str, str]:
    """Facts for the first line of the event log, by name: role, cell, version, drivers, a hash of the
    settings, endpoints.
    """
    return {
        "role": settings.role,
        "cell": settings.cell,
        "software": software_version(),
        "drivers": "; ".join(f"{device.name} {device.driver.origin}" for device in configured(settings)),
        "settings": hashlib.sha256(dump_yaml(settings).encode()).hexdigest()[:16],
        "listen": " ".join(settings.transport.listen),
        "connect": " ".join(settings.transport.connect),
    }
