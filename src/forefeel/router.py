"""`forefeel router`: the cells of a laboratory through one Zenoh router, each kept to itself."""

from itertools import count

import zenoh

from forefeel.child_process import die_with_parent
from forefeel.common.runtime.real import HOST
from forefeel.common.runtime.realtime import raise_descriptor_limit
from forefeel.common.runtime.service_manager import service_watchdog
from forefeel.common.transport.security import Party
from forefeel.common.transport.zenoh_bus import open_session
from forefeel.interrupt import signal_flag
from forefeel.network_settings import RouterSettings
from forefeel.terminal import say

_POLL_S = 0.2
_PRIORITY = 30
"""Of SCHED_FIFO where it is granted, as the daemons' own transports: a command waits for no other program."""
_MOST_EVENTS = 1024  # of links that wait for a look


def run_router(settings: RouterSettings, duration_s: float | None = None, insecure: bool = False) -> None:
    """Runs a Zenoh router, at real-time priority where it is granted, until SIGINT, SIGTERM, SIGHUP or the
    duration; prints who is connected, who comes and who goes, and attends systemd's watchdog.

    Raises:
        InputError: an endpoint or a certificate can not be used.
    """
    die_with_parent()
    raise_descriptor_limit()
    HOST.prepare_thread(_PRIORITY)  # Zenoh's threads inherit it
    party = Party("router", settings.cells)
    session, notice = open_session(settings.transport, "router", party, insecure=insecure, real_stage=False)
    with signal_flag() as stop:
        with session:
            _greet(settings, notice)
            channel: zenoh.handlers.RingChannel[zenoh.LinkEvent] = zenoh.handlers.RingChannel(_MOST_EVENTS)
            looks = count(1)
            attend = service_watchdog(lambda: "routing", lambda: next(looks))
            with session.info.declare_link_events_listener(channel, history=True) as links:
                for _ in stop.polls(duration_s, _POLL_S):
                    while (event := links.handler.try_recv()) is not None:
                        came = event.kind == zenoh.SampleKind.PUT
                        who = event.link.auth_identifier or "someone without certificate"
                        where = event.link.dst.partition("/")[2]
                        say(f"router: {who} {'came from' if came else 'left'} {where}")
                    attend()
        say("router: closed")


def _greet(settings: RouterSettings, notice: str) -> None:
    """Prints the notice, if any, endpoints, certificates, cells, and what the daemons need to set."""
    if notice:
        say(f"router: {notice}")
    transport = settings.transport
    how = f"with the certificates in {transport.pki}" if transport.pki else "without certificates"
    say(f"router: listening on {', '.join(transport.listen)} {how}; cells {', '.join(settings.cells)}")
    say("router: slave and master need transport.mode: client and this host in transport.connect")
