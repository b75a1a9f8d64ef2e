"""How a daemon comes to its network, and a master to its slave: visibly, and not for ever."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from common.errors import ConfigurationError, EndpointError, NoRouterError
from common.runtime.real import RealRuntime
from common.settings import DaemonSettings
from common.topics import Role
from common.transport.security import Party
from common.transport.strands import StrandedTransport
from forefeel.strand_watch import PERIOD_NS, StrandWatch
from forefeel.terminal import say
from master.session import Link
from master.settings import MasterSettings

if TYPE_CHECKING:
    from master.axis import MasterAxis
    from master.daemon import MasterDaemon

POLL_S = 0.05
_REMIND_S = 5.0
_ROUTER_S = 0.5


async def opened(
    settings: DaemonSettings, role: Role, runtime: RealRuntime, insecure: bool, timeout_s: float | None
) -> StrandedTransport | None:
    """The daemon's transport, once its router answers where it has one; None when told to end meanwhile."""
    start_ns, reminded_s = runtime.clock.now_ns(), -_REMIND_S
    while not runtime.stopping.is_set():
        try:
            return _open(settings, role, runtime, insecure)
        except NoRouterError as error:
            waited_s = (runtime.clock.now_ns() - start_ns) * 1e-9
            if timeout_s is not None and waited_s >= timeout_s:
                raise
            if waited_s - reminded_s >= _REMIND_S:
                reminded_s = waited_s
                say(f"{role}: waiting for the router: {error} ({waited_s:.0f} s)")
        await asyncio.sleep(_ROUTER_S)
    return None


def _open(settings: DaemonSettings, role: Role, runtime: RealRuntime, insecure: bool) -> StrandedTransport:
    transport = StrandedTransport.open(
        settings.transport,
        runtime.clock,
        runtime.fault,
        Party(role, (settings.cell,)),
        insecure=insecure,
        real_stage=settings.real_stage,
    )
    if transport.notice:
        say(f"{role}: {transport.notice}")
    return transport


def watch_strands(runtime: RealRuntime, role: Role, transport: StrandedTransport) -> None:
    """Says when a connection of several is missing, and when all are there again."""
    watch = StrandWatch(transport, lambda line: say(f"{role}: {line}"))
    runtime.task("strands", PERIOD_NS, watch.look)


@contextmanager
def closed_on_failure(transport: StrandedTransport) -> Iterator[None]:
    """The daemon closes its transport; this does when the daemon can not be composed."""
    try:
        yield
    except BaseException:
        transport.close()
        raise


async def open_session(
    daemon: "MasterDaemon", runtime: RealRuntime, settings: MasterSettings, transport: StrandedTransport
) -> None:
    """Waits visibly until every axis has its session."""
    timeout_s, connect = settings.peer_timeout_s, settings.transport.connect
    start_ns, reminded_s = runtime.clock.now_ns(), 0.0
    while not runtime.stopping.is_set():
        waiting = [axis for axis in daemon.axes if axis.session.link is not Link.OPEN]
        if not waiting:
            return
        axis, waited_s = waiting[0], (runtime.clock.now_ns() - start_ns) * 1e-9
        where = ", ".join(connect) or "our own endpoint"
        _refuse_mismatch(waiting)
        if timeout_s is not None and waited_s > timeout_s:
            word = axis.session.reason if axis.session.heard_ns else transport.hint or "no answer"
            raise EndpointError(
                f"{where}: no session with a slave within {timeout_s:g} s ({word}); "
                f"expected a running slave of the same cell (peer_timeout_s)"
            )
        if waited_s - reminded_s >= _REMIND_S:
            reminded_s = waited_s
            why = transport.hint or axis.session.reason
            say(f"master: waiting for the slave at {where}: {why} ({waited_s:.0f} s)")
        await asyncio.sleep(POLL_S)


def show_link(daemon: "MasterDaemon", linked: bool) -> bool:
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
