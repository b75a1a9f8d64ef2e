"""Several connections with mutual TLS between two ends: the streams take turns, the rules hold on each."""

import os
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest

from common.clock import MonotonicClock
from common.topics import COMMAND, FORCE, Qos
from common.transport.endpoints import shifted
from common.transport.port import Put
from common.transport.security import Party, PartyRole
from common.transport.settings import TransportSettings
from common.transport.strands import StrandedTransport
from tests.integration.test_zenoh_bus import wait_until
from tests.secured import CELL, make_pki, sessions

STRANDS = 3
COMMANDED, FORCED = COMMAND.key(CELL, "insertion"), FORCE.key(CELL, "insertion")


@pytest.fixture(scope="module")
def pki(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_pki(tmp_path_factory.mktemp("certificates") / "pki")


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def free_row(protocol: str) -> str:
    """An endpoint whose port and those after it are free."""
    while True:
        with ExitStack() as held:
            first = held.enter_context(socket.create_server(("127.0.0.1", 0))).getsockname()[1]
            try:
                for number in range(1, STRANDS):
                    held.enter_context(socket.create_server(("127.0.0.1", first + number)))
            except OSError:
                continue
        return f"{protocol}/127.0.0.1:{first}"


def opened(
    stack: ExitStack, pki: Path, role: PartyRole, strands: int = STRANDS, **ends: tuple[str, ...]
) -> StrandedTransport:
    settings = TransportSettings(**ends, pki=pki, strands=strands)
    faults: list[Exception] = []
    transport = StrandedTransport.open(settings, MonotonicClock(), faults.append, Party(role, (CELL,)))

    def close() -> None:
        transport.close()
        assert faults == []

    stack.callback(close)
    return transport


def heard_by(transport: StrandedTransport, key: str) -> list[bytes]:
    heard: list[bytes] = []
    transport.subscribe(key, lambda payload, _: heard.append(payload))
    return heard


def all_stand(transport: StrandedTransport, peers: int = 1) -> bool:
    return [strand.peers() for strand in transport._strands] == [peers] * STRANDS


def arrive_whole(put: Put, heard: list[bytes], count: int = 60) -> None:
    """Sends that many until all of them arrive, once each: streams may drop, and routes take a moment."""
    deadline_s = time.monotonic() + 8.0
    while True:
        heard.clear()
        sent = [os.urandom(8) for _ in range(count)]
        for payload in sent:
            put(payload)
            time.sleep(0.001)
        with suppress(AssertionError):
            wait_until(lambda: len(heard) >= count, 0.5)
        assert len(set(heard)) == len(heard)
        if set(heard) == set(sent):
            return
        assert time.monotonic() < deadline_s, f"{len(set(heard) & set(sent))} of {count} arrived"


def test_every_message_comes_once_and_a_connection_that_is_gone_is_left_out(
    stack: ExitStack, pki: Path
) -> None:
    endpoint = free_row("tls")
    slave = opened(stack, pki, "slave", listen=(endpoint,))
    master = opened(stack, pki, "master", connect=(endpoint,))
    heard, put = heard_by(slave, COMMANDED), master.publisher(COMMANDED, Qos.STREAM)
    by_strand = [heard_by(StrandedTransport([each]), COMMANDED) for each in slave._strands]
    wait_until(lambda: all_stand(master))
    arrive_whole(put, heard)
    wait_until(lambda: min(map(len, by_strand)) >= 20)
    assert master.amiss == ""
    slave._strands[1].close()
    wait_until(lambda: master._strands[1].peers() == 0)
    assert master.amiss.startswith("2 of 3 connections stand; expected the same transport.strands")
    before = len(by_strand[1])
    arrive_whole(put, heard)
    assert len(by_strand[1]) == before


@pytest.mark.soak
def test_an_end_with_a_single_connection_misses_nothing_and_is_told(stack: ExitStack, pki: Path) -> None:
    endpoint = free_row("tls")
    slave = opened(stack, pki, "slave", listen=(endpoint,))
    heard = heard_by(opened(stack, pki, "master", 1, connect=(endpoint,)), FORCED)
    put = slave.publisher(FORCED, Qos.STREAM)
    wait_until(lambda: slave.peers() == 1)
    arrive_whole(put, heard)
    assert slave.amiss.startswith("1 of 3 connections stand")


@pytest.mark.parametrize(
    "kind",
    [
        "tls",
        *(pytest.param(kind, marks=pytest.mark.soak) for kind in ("quic", "quic?mixed_rel=1", "quic?rel=0")),
    ],
)
def test_the_rules_hold_on_every_connection(stack: ExitStack, pki: Path, kind: str) -> None:
    """Of each kind that carries certificates: who has none is not let in, a viewer can not command."""
    protocol, mark, options = kind.partition("?")
    endpoint = free_row(protocol) + mark + options
    slave = opened(stack, pki, "slave", listen=(endpoint,))
    master = opened(stack, pki, "master", connect=(endpoint,))
    heard, put = heard_by(slave, COMMANDED), master.publisher(COMMANDED, Qos.STREAM)
    wait_until(lambda: all_stand(slave))
    net = stack.enter_context(sessions())
    places = [shifted(endpoint, number) for number in range(STRANDS)]
    strangers = [net.attacker(place, None, authority=pki / "ca.crt") for place in places]
    viewers = [net.attacker(place, pki, "viewer") for place in places]
    wait_until(lambda: all(viewer.info.transports() for viewer in viewers))
    for _ in range(20):
        for session in (*strangers, *viewers):
            session.put(COMMANDED, "forged")
            session.put("forefeel/**", "forged")
        time.sleep(0.005)
    assert [stranger.info.transports() for stranger in strangers] == [[]] * STRANDS
    wait_until(lambda: put(b"move") is None and len(heard) > STRANDS)
    assert set(heard) == {b"move"}
