"""Several connections with mutual TLS to one port: the streams take turns, the rules hold on each of them."""

import os
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import pytest
import zenoh

from forefeel.common.clock import MonotonicClock
from forefeel.common.topics import COMMAND, EMERGENCY_STOP, FORCE, SAFETY_EVENT, Qos, numbered
from forefeel.common.transport.parallel import ParallelTransport
from forefeel.common.transport.port import Put
from forefeel.common.transport.security import Party, PartyRole
from forefeel.common.transport.settings import TransportSettings
from tests.process.test_zenoh_bus import put_each
from tests.secured import CELL, Secured, free_endpoint, make_pki, sessions
from tests.waiting import PATIENCE_S, wait_until

CONNECTIONS = 3
COMMANDED, FORCED, STOPPED, SAFETY = (
    topic.key(CELL, "insertion") for topic in (COMMAND, FORCE, EMERGENCY_STOP, SAFETY_EVENT)
)
ROUTED = {"through a router": True, "directly": False}


@pytest.fixture(scope="module")
def pki(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_pki(tmp_path_factory.mktemp("certificates") / "pki")


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def net() -> Iterator[Secured]:
    with sessions() as opened:
        yield opened


def opened(
    stack: ExitStack,
    pki: Path,
    role: PartyRole,
    connections: int = CONNECTIONS,
    **ends: Any,  # noqa: ANN401 - endpoints and mode, as in the YAML file
) -> ParallelTransport:
    settings = TransportSettings.model_validate({**ends, "pki": pki, "connections": connections})
    faults: list[Exception] = []
    transport = ParallelTransport.open(settings, MonotonicClock(), faults.append, Party(role, (CELL,)))

    def close() -> None:
        transport.close()
        assert faults == []

    stack.callback(close)
    return transport


def heard_by(subscribe: Callable[[str, Callable[[bytes, int], None]], None], key: str) -> list[bytes]:
    heard: list[bytes] = []
    subscribe(key, lambda payload, _: heard.append(payload))
    return heard


def arrive_once(put: Put, *heard: list[bytes], count: int = 60) -> None:
    """Sends that many until all of them arrive, once each: streams may drop, and routes take a moment."""
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        for each in heard:
            each.clear()
        sent = [os.urandom(8) for _ in range(count)]
        for payload in sent:
            put(payload)
            time.sleep(0.001)
        with suppress(AssertionError):
            wait_until(lambda: all(len(each) >= count for each in heard), 0.5)
        found = [Counter(each) for each in heard]
        assert all(max(each.values(), default=1) == 1 for each in found), "one came twice"
        if all(each == Counter(sent) for each in found):
            return
        assert time.monotonic() < deadline_s, [sum(map(each.__getitem__, sent)) for each in found]


@pytest.mark.parametrize("routed", ROUTED.values(), ids=ROUTED)
def test_every_message_comes_once_to_the_other_end_and_to_who_watches(
    stack: ExitStack, net: Secured, pki: Path, routed: bool
) -> None:
    """The slave has one port or connects to a router, as the master does, over several connections."""
    endpoint = free_endpoint()
    ends: dict[PartyRole, dict[str, Any]] = {
        "slave": {"listen": (endpoint,)},
        "master": {"connect": (endpoint,)},
    }
    if routed:
        net.router(pki, endpoint, [CELL])
        ends = {role: {"mode": "client", "connect": (endpoint,)} for role in ends}
    slave, master = (opened(stack, pki, role, **own) for role, own in ends.items())
    recorder = net.open(pki, "recorder", connect=(endpoint,), mode="client" if routed else "peer")
    watched: dict[str, list[bytes]] = {FORCED: [], COMMANDED: []}
    recorder.subscribe_all(f"forefeel/{CELL}", lambda key, payload, _: watched[key].append(payload))
    forced, commanded = heard_by(master.subscribe, FORCED), heard_by(slave.subscribe, COMMANDED)
    arrive_once(slave.publisher(FORCED, Qos.STREAM), forced, watched[FORCED])
    observers = [commanded, watched[COMMANDED]] if routed else [commanded]  # nobody connects to this master
    arrive_once(master.publisher(COMMANDED, Qos.STREAM), *observers)


def test_a_master_that_listens_too_is_heard_by_who_connects_to_it(
    stack: ExitStack, net: Secured, pki: Path
) -> None:
    at_slave, at_master = free_endpoint(), free_endpoint()
    slave = opened(stack, pki, "slave", listen=(at_slave,))
    master = opened(stack, pki, "master", connect=(at_slave,), listen=(at_master,))
    watched: list[bytes] = []
    recorder = net.open(pki, "recorder", connect=(at_slave, at_master))
    recorder.subscribe_all(f"forefeel/{CELL}", lambda _key, payload, _ns: watched.append(payload))
    arrive_once(master.publisher(COMMANDED, Qos.STREAM), heard_by(slave.subscribe, COMMANDED), watched)


def test_a_connection_that_is_gone_loses_its_turns(stack: ExitStack, pki: Path) -> None:
    endpoint = free_endpoint()
    slave = opened(stack, pki, "slave", listen=(endpoint,))
    master = opened(stack, pki, "master", connect=(endpoint,))
    forced, commanded = heard_by(master.subscribe, FORCED), heard_by(slave.subscribe, COMMANDED)
    by_number = [heard_by(each.subscribe, numbered(n, FORCED)) for n, each in enumerate(master._connecting)]
    force, command = slave.publisher(FORCED, Qos.STREAM), master.publisher(COMMANDED, Qos.STREAM)
    arrive_once(force, forced)
    wait_until(lambda: force(b"turn") is None and all(by_number))
    master._connecting[1].close()
    arrive_once(force, forced)
    arrive_once(command, commanded)


def test_an_end_with_a_single_connection_and_a_viewer_are_heard(
    stack: ExitStack, net: Secured, pki: Path
) -> None:
    """A viewer stops a slave that has several connections, and one that has a single one."""
    endpoint = free_endpoint()
    slave = opened(stack, pki, "slave", listen=(endpoint,))
    master = opened(stack, pki, "master", 1, connect=(endpoint,))
    viewer = net.open(pki, "viewer", connect=(endpoint,))
    stopped = heard_by(slave.subscribe, STOPPED)
    arrive_once(slave.publisher(FORCED, Qos.STREAM), heard_by(master.subscribe, FORCED))
    arrive_once(viewer.publisher(STOPPED, Qos.EVENT), stopped)
    arrive_once(master.publisher(STOPPED, Qos.EVENT), stopped)


def test_events_that_are_needed_in_order_keep_it(stack: ExitStack, pki: Path) -> None:
    endpoint = free_endpoint()
    slave = opened(stack, pki, "slave", listen=(endpoint,))
    master = opened(stack, pki, "master", connect=(endpoint,))
    heard, put = heard_by(master.subscribe, SAFETY), slave.publisher(SAFETY, Qos.EVENT)
    wait_until(lambda: put(b"first") is None and bool(heard))

    def numbers() -> list[int]:
        return [int(each) for each in list(heard) if each != b"first"]

    put_each(lambda number: put(b"%d" % number), 300, lambda: len(numbers()))
    assert numbers() == list(range(300))


@pytest.mark.parametrize(
    "kind",
    [
        "tls",
        *(pytest.param(kind, marks=pytest.mark.soak) for kind in ("quic", "quic?mixed_rel=1", "quic?rel=0")),
    ],
)
def test_the_rules_hold_on_every_connection(stack: ExitStack, net: Secured, pki: Path, kind: str) -> None:
    """Of each kind that carries certificates: who has none is not let in, a viewer can neither command nor
    hear the numbered keys.
    """
    protocol, mark, options = kind.partition("?")
    endpoint = free_endpoint(protocol) + mark + options
    slave = opened(stack, pki, "slave", listen=(endpoint,))
    master = opened(stack, pki, "master", connect=(endpoint,))
    commanded, forced = heard_by(slave.subscribe, COMMANDED), heard_by(master.subscribe, FORCED)
    command, force = master.publisher(COMMANDED, Qos.STREAM), slave.publisher(FORCED, Qos.STREAM)
    stranger, viewer = net.attacker(endpoint, None, authority=pki / "ca.crt"), net.attacker(endpoint, pki)
    overheard: list[object] = []
    viewer.declare_subscriber("connection/**", overheard.append, allowed_origin=zenoh.Locality.REMOTE)
    wait_until(lambda: bool(viewer.info.transports()))
    for _ in range(20):
        for session in (stranger, viewer):
            for key in (COMMANDED, "forefeel/**", numbered(0, COMMANDED), numbered(0, FORCED), "**"):
                session.put(key, "forged")
        time.sleep(0.005)
    assert stranger.info.transports() == []
    wait_until(
        lambda: command(b"move") is None and force(b"push") is None and len(commanded) > 3 < len(forced)
    )
    assert (set(commanded), set(forced), overheard) == ({b"move"}, {b"push"}, [])
