"""How a daemon comes to its network, and a master to its slave: visibly, and not for ever."""

import asyncio
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

from forefeel.common.errors import ConfigurationError, EndpointError, NoRouterError
from forefeel.common.runtime.real import RealRuntime
from forefeel.common.runtime.threads import in_thread
from forefeel.common.settings import DaemonSettings
from forefeel.common.topics import Role
from forefeel.common.transport.parallel import ParallelTransport
from forefeel.common.transport.security import Party
from forefeel.master.session import SessionState
from forefeel.master.settings import MasterSettings
from forefeel.terminal import say
from forefeel.waiting import Obstacles, Waiting, unheard

if TYPE_CHECKING:
    from forefeel.master.axis import MasterAxis
    from forefeel.master.daemon import MasterDaemon

# s between two looks while something is waited for; chosen, not measured: shorter costs processor time
POLL_S = 0.05
_ROUTER_S = 0.5  # s between two attempts to reach the router; chosen, not measured: longer connects later


def obstacles(settings: DaemonSettings, role: Role) -> Obstacles:
    """What may be in the way of a daemon's connections.

    Raises:
        ConfigurationError: its certificates can not be used.
    """
    client, other = settings.transport.mode == "client", "slave" if role == "master" else "master"
    return Obstacles(settings.transport, Party(role, (settings.cell,)), "router" if client else other)


async def opened(
    settings: DaemonSettings,
    role: Role,
    runtime: RealRuntime,
    insecure: bool,
    timeout_s: float | None,
    found: Obstacles,
) -> ParallelTransport | None:
    """The daemon's transport, once its router answers where it has one; None when told to end meanwhile.

    It is opened in a thread. That may take `transport.open_timeout_s`, and a signal is heard at once.
    """
    waiting = Waiting(
        found,
        lambda: unheard(settings.transport, False, ""),
        lambda cause: say(f"{role}: waiting for the router: {cause}"),
    )
    start_ns = runtime.clock.now_ns()
    opening = _opening(settings, role, runtime, insecure)
    while not runtime.stopping.is_set():
        if opening.done():
            if not isinstance(opening.exception(), NoRouterError):
                return _noticed(opening.result(), role)
            await asyncio.sleep(_ROUTER_S)
            opening = _opening(settings, role, runtime, insecure)
        now_ns = runtime.clock.now_ns()
        if timeout_s is not None and now_ns - start_ns >= timeout_s * 1e9:
            opening.add_done_callback(_close_unused)
            cause = await _cause(waiting, now_ns)
            raise NoRouterError(f"no router within {timeout_s:g} s: {cause}")
        waiting.look(now_ns)
        await asyncio.sleep(POLL_S)
    opening.add_done_callback(_close_unused)
    return None


def _opening(
    settings: DaemonSettings, role: Role, runtime: RealRuntime, insecure: bool
) -> Future[ParallelTransport]:
    open_it = partial(
        ParallelTransport.open,
        settings.transport,
        runtime.clock,
        runtime.fault,
        Party(role, (settings.cell,)),
        insecure=insecure,
        real_stage=settings.real_stage,
    )
    return in_thread(open_it, "zenoh open")


def _noticed(transport: ParallelTransport, role: Role) -> ParallelTransport:
    if transport.notice:
        say(f"{role}: {transport.notice}")
    return transport


def _close_unused(opening: Future[ParallelTransport]) -> None:
    if opening.exception() is None:
        opening.result().close()


async def _cause(waiting: Waiting, now_ns: int) -> str:
    return await asyncio.wrap_future(in_thread(partial(waiting.try_now, now_ns), "trial of endpoints"))


@contextmanager
def closed_on_failure(transport: ParallelTransport) -> Iterator[None]:
    """The daemon closes its transport; this does when the daemon can not be composed."""
    try:
        yield
    except BaseException:
        transport.close()
        raise


def connecting(
    settings: DaemonSettings, transport: ParallelTransport, found: Obstacles
) -> Callable[[int], None]:
    """What a slave that connects to somebody does many times a second: it says what is in the way while it
    has no connection.
    """
    waiting = Waiting(
        found,
        lambda: unheard(settings.transport, False, ""),
        lambda cause: say(f"slave: waiting for a connection: {cause}"),
    )

    def look(now_ns: int) -> None:
        if not settings.transport.connect or transport.peers():
            waiting.over()
        else:
            waiting.look(now_ns)

    return look


class MasterSession:
    """Whether every axis of a master has its session; says when one is lost, and what is in the way."""

    def __init__(
        self, daemon: "MasterDaemon", settings: MasterSettings, transport: ParallelTransport, found: Obstacles
    ) -> None:
        self._axes, self._settings, self._transport = daemon.axes, settings, transport
        self._waiting = Waiting(found, self._unheard, lambda it: say(f"master: waiting for the slave: {it}"))
        self._open = self._lost = False

    def look(self, now_ns: int) -> bool:
        """Whether every axis has its session; many times a second.

        Raises:
            ConfigurationError: the settings of both ends differ, which does not come right by waiting.
        """
        missing = self._missing()
        if not missing:
            if self._lost:
                say("master: session open again")
            self._open, self._lost = True, False
            self._waiting.over()
            return True
        first = missing[0]
        if first.session.state is SessionState.MISMATCH:
            raise ConfigurationError(f"axis {first.name}: the slave refuses: {first.session.cause(now_ns)}")
        if self._open:
            say(f"master: axis {first.name}: {first.session.cause(now_ns)}; waiting for the slave")
            self._open, self._lost = False, True
        self._waiting.look(now_ns, self._known(first, now_ns))
        for axis in missing:
            axis.session.obstacle = self._waiting.found
        return False

    async def cause(self, now_ns: int) -> str:
        """Why there is no session, in words."""
        missing = self._missing()
        known = self._known(missing[0], now_ns) if missing else ""
        return known or await _cause(self._waiting, now_ns)

    def _missing(self) -> "list[MasterAxis]":
        missing = [axis for axis in self._axes if axis.session.state is not SessionState.OPEN]
        return sorted(missing, key=lambda axis: axis.session.state is not SessionState.MISMATCH)

    def _known(self, axis: "MasterAxis", now_ns: int) -> str:
        """The cause where it is known without a trial. Whom a master that listens is connected to is not."""
        if self._transport.hint:
            return self._transport.hint
        if axis.session.heard(now_ns):
            return f"axis {axis.name}: {axis.session.cause(now_ns)}"
        connected = self._transport.peers() and not self._settings.transport.listen
        return self._unheard() if connected else ""

    def _unheard(self) -> str:
        axes = ", ".join(axis.name for axis in self._missing())
        missing = f"no slave of cell {self._settings.cell}, axis {axes} answers there"
        return unheard(self._settings.transport, self._transport.peers() > 0, missing)


async def open_session(session: MasterSession, runtime: RealRuntime, timeout_s: float | None) -> None:
    """Waits visibly until every axis has its session, or the daemon is told to end.

    Raises:
        EndpointError: not within `timeout_s`. ConfigurationError: the slave's settings differ.
    """
    start_ns = runtime.clock.now_ns()
    while not runtime.stopping.is_set():
        now_ns = runtime.clock.now_ns()
        if session.look(now_ns):
            return
        if timeout_s is not None and now_ns - start_ns > timeout_s * 1e9:
            cause = await session.cause(now_ns)
            raise EndpointError(f"no session with a slave within {timeout_s:g} s (peer_timeout_s): {cause}")
        await asyncio.sleep(POLL_S)
