"""The transport over real Zenoh, on loopback TCP."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path

import pytest

from forefeel.common.clock import MonotonicClock
from forefeel.common.errors import ConfigurationError, EndpointError
from forefeel.common.topics import Qos
from forefeel.common.transport.impaired import ImpairedTransport
from forefeel.common.transport.impairment import Impairment
from forefeel.common.transport.settings import ImpairmentSettings, TransportSettings
from forefeel.common.transport.timers import TimerThread
from forefeel.common.transport.zenoh_bus import ZenohTransport
from tests.waiting import PATIENCE_S, wait_until
from tests.witness import Witness

KEY = "forefeel/cell/insertion/master/command"
OTHER = "forefeel/cell/insertion/slave/force"
CLOCK = MonotonicClock()
AT_ONCE = 8
"""Events on the way. A sender waits for nobody: what fits no queue while a thread stands still is lost.
A stream may lose any of its messages, so what needs some of a stream repeats it: `put_until`."""


class Net:
    """Opens sessions and closes those that are still open at the end; gathers what handlers raised."""

    def __init__(self) -> None:
        self.port = free_port()
        self.endpoint = f"tcp/127.0.0.1:{self.port}"
        self.faults: list[Exception] = []
        self._opened: list[ZenohTransport] = []

    def open(self, **settings: object) -> ZenohTransport:
        transport = ZenohTransport.open(
            TransportSettings.model_validate(settings), CLOCK, self.faults.append, insecure=True
        )
        self._opened.append(transport)
        return transport

    def listener(self) -> ZenohTransport:
        return self.open(listen=[self.endpoint])

    def connector(self) -> ZenohTransport:
        return self.open(connect=[self.endpoint])

    def close(self) -> None:
        for transport in self._opened:
            transport.close()


@pytest.fixture
def net() -> Iterator[Net]:
    net = Net()
    before = threading.active_count()
    yield net
    net.close()
    assert threading.active_count() == before


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def put_until(put: Callable[[bytes], None], condition: Callable[[], object]) -> None:
    """Repeats a payload, as every stream does, until it got through: declarations travel too."""

    def attempt() -> object:
        put(b"probe")
        return condition()

    wait_until(attempt)


def put_each(put: Callable[[int], None], count: int, arrived: Callable[[], int]) -> None:
    """All numbers below `count` as events, and waits until they have come."""
    for number in range(count):
        wait_until(lambda: arrived() > number - AT_ONCE)  # noqa: B023 - called at once
        put(number)
    wait_until(lambda: arrived() >= count)


def test_delivers_in_order_to_others_and_never_to_itself(net: Net) -> None:
    first, second = net.listener(), net.connector()
    got: list[tuple[bytes, int]] = []
    own: list[bytes] = []
    first.subscribe(KEY, lambda payload, stamp: got.append((payload, stamp)))
    second.subscribe(KEY, lambda payload, _: own.append(payload))
    put = second.publisher(KEY, Qos.EVENT)
    put_until(put, lambda: got)
    before = CLOCK.now_ns()

    def numbers() -> list[int]:
        return [int(payload) for payload, _ in list(got) if payload != b"probe"]

    put_each(lambda number: put(b"%d" % number), 200, lambda: len(numbers()))
    assert numbers() == list(range(200))
    del got[: next(i for i, (payload, _) in enumerate(got) if payload == b"0")]
    assert all(before <= a <= b <= CLOCK.now_ns() for (_, a), (_, b) in pairwise(got))
    assert own == []
    assert (first.peers(), second.peers()) == (1, 1)


@pytest.mark.parametrize("qos", Qos)
def test_every_quality_of_service_delivers(net: Net, qos: Qos) -> None:
    first, second = net.listener(), net.connector()
    got: list[bytes] = []
    first.subscribe(KEY, lambda payload, _: got.append(payload))
    put_until(second.publisher(KEY, qos), lambda: got)


def test_subscribe_all_gives_the_key(net: Net) -> None:
    first, second = net.listener(), net.connector()
    got: set[tuple[str, bytes]] = set()
    first.subscribe_all("forefeel/cell", lambda key, payload, _: got.add((key, payload)))
    second.publisher("forefeel/other/insertion/slave/force", Qos.STREAM)(b"not below the prefix")
    for key in (KEY, OTHER):
        put_until(second.publisher(key, Qos.STREAM), lambda key=key: (key, b"probe") in got)  # type: ignore[misc]
    assert got == {(KEY, b"probe"), (OTHER, b"probe")}


def test_a_late_peer_is_waited_for_and_then_heard(net: Net, witness: Witness) -> None:
    begin = time.monotonic()
    early = net.connector()
    put = early.publisher(KEY, Qos.STREAM)
    took_s = time.monotonic() - begin
    with witness.timely(0.2):
        assert took_s < 0.3
    assert early.peers() == 0
    put(b"nobody there")
    time.sleep(0.3)
    late = net.listener()
    got: list[bytes] = []
    late.subscribe(KEY, lambda payload, _: got.append(payload))
    put_until(put, lambda: got)
    assert early.peers() == 1


def test_a_handler_that_stands_still_does_not_hold_up_the_commands(net: Net, witness: Witness) -> None:
    """With Zenoh's own callbacks the commands stand still once the other one has 256 samples waiting."""
    slave, master = net.listener(), net.connector()
    entered, released = threading.Event(), threading.Event()
    commands: list[int] = []

    def stand_still(_payload: bytes, _stamp: int) -> None:
        entered.set()
        released.wait(PATIENCE_S)

    slave.subscribe(OTHER, stand_still)
    slave.subscribe(KEY, lambda payload, stamp: commands.append(stamp - int(payload)))
    put_force, put_command = master.publisher(OTHER, Qos.STREAM), master.publisher(KEY, Qos.STREAM)
    put_until(put_force, entered.is_set)

    def put(payload: bytes) -> None:
        put_force(payload)
        put_command(b"%d" % CLOCK.now_ns())

    put_until(put, lambda: len(commands) >= 300)
    released.set()
    with witness.timely(0.005):
        assert sorted(commands)[len(commands) // 2] < 5_000_000


def test_an_exception_of_a_handler_reaches_the_fault_path_and_delivery_goes_on(net: Net) -> None:
    first, second = net.listener(), net.connector()
    got: list[bytes] = []

    def fail_once(payload: bytes, _: int) -> None:
        got.append(payload)
        if len(got) == 1:
            raise RuntimeError("the handler failed")

    first.subscribe(KEY, fail_once)
    put_until(second.publisher(KEY, Qos.STREAM), lambda: len(got) > 2)
    assert [str(fault) for fault in net.faults] == ["the handler failed"]
    assert first.handler_faults == 1


def test_nothing_is_delivered_after_close_and_no_thread_is_left(net: Net) -> None:
    before = set(threading.enumerate())
    first, second = net.listener(), net.connector()
    got: list[bytes] = []
    first.subscribe(KEY, lambda payload, _: got.append(payload))
    first.subscribe_all("forefeel", lambda *_: None)
    put = second.publisher(KEY, Qos.STREAM)
    put_until(put, lambda: got)
    first.close()
    first.close()
    seen = len(got)
    put(b"to a closed session")
    time.sleep(0.05)
    assert len(got) == seen
    assert first.peers() == 0
    wait_until(lambda: second.peers() == 0)
    second.close()
    put(b"from a closed session")
    assert set(threading.enumerate()) == before


def test_a_taken_endpoint_is_named(net: Net) -> None:
    net.listener()
    with pytest.raises(EndpointError) as caught:
        net.open(listen=[f"tcp/127.0.0.1:{free_port()}", net.endpoint])
    assert str(caught.value) == (
        f"endpoint '{net.endpoint}': taken by another program; end that one or listen on another port"
    )


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"listen": ["tcp/127.0.0.1"]}, "endpoint 'tcp/127.0.0.1': expected protocol/host:port"),
        ({"connect": ["tcp/127.0.0.1:http"]}, "endpoint 'tcp/127.0.0.1:http': expected protocol/host:port"),
        ({"connect": ["tcp/no-such-host.invalid:7447"]}, "host 'no-such-host.invalid' does not resolve"),
        ({"listen": ["tcp/192.0.2.1:7447"]}, "endpoint 'tcp/192.0.2.1:7447': no address of this host"),
        ({"mode": "client", "connect": ["tcp/127.0.0.1:1"]}, "endpoint 'tcp/127.0.0.1:1': no router answers"),
        (
            {"listen": ["tls/127.0.0.1:7447"]},
            "endpoint 'tls/127.0.0.1:7447': .*Missing TLS private key; check cert",
        ),
    ],
)
def test_endpoints_that_can_not_work_are_refused_in_one_line(
    net: Net, settings: object, message: str
) -> None:
    with pytest.raises(EndpointError, match=message) as caught:
        net.open(**TransportSettings.model_validate(settings).model_dump())
    assert "\n" not in str(caught.value)


def test_a_zenoh_file_is_the_base_of_the_configuration(net: Net, tmp_path: Path) -> None:
    good, bad = tmp_path / "good.json5", tmp_path / "bad.json5"
    good.write_text(
        "{ listen: { endpoints: ['tcp/127.0.0.1:1'] }, transport: { link: { protocols: ['udp'] } } }"
    )
    bad.write_text("{ transprot: {} }")
    with pytest.raises(ConfigurationError, match=r"bad\.json5: .*unknown field `transprot`"):
        net.open(listen=[net.endpoint], zenoh_file=bad)
    with pytest.raises(ConfigurationError, match=r"missing\.json5: No such file"):
        net.open(listen=[net.endpoint], zenoh_file=tmp_path / "missing.json5")
    with pytest.raises(EndpointError, match=f"endpoint '{net.endpoint}'"):  # the file allows UDP only
        net.open(listen=[net.endpoint], zenoh_file=good)


PEER = """
import sys, time
from forefeel.common.clock import MonotonicClock
from forefeel.common.topics import Qos
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_bus import ZenohTransport

transport = ZenohTransport.open(TransportSettings(listen=(sys.argv[1],)), MonotonicClock(), print)
transport.subscribe_all("forefeel", lambda *_: None)
put = transport.publisher(sys.argv[2], Qos.STREAM)
while True:
    put(sys.argv[3].encode())
    time.sleep(0.002)
"""


@contextmanager
def peer(net: Net, payload: str) -> Iterator["subprocess.Popen[bytes]"]:
    """Another process that listens and puts `payload` all the time; killed at the end."""
    with subprocess.Popen([sys.executable, "-c", PEER, net.endpoint, KEY, payload]) as process:
        try:
            yield process
        finally:
            process.kill()


def test_a_peer_that_is_killed_and_started_again_is_heard_again(net: Net, witness: Witness) -> None:
    transport = net.connector()
    got: list[bytes] = []
    transport.subscribe(KEY, lambda payload, _: got.append(payload))
    with peer(net, "first"):
        wait_until(lambda: b"first" in got)
    took_s = wait_until(lambda: transport.peers() == 0)
    with witness.timely(0.9):
        assert took_s < 1.0
    with peer(net, "second"):
        wait_until(lambda: b"second" in got)


@pytest.mark.parametrize("qos", [Qos.STREAM, pytest.param(Qos.EVENT, marks=pytest.mark.soak)])
def test_no_put_waits_for_a_frozen_peer_and_its_link_is_given_up(
    net: Net, qos: Qos, witness: Witness
) -> None:
    transport = net.connector()
    received: list[bytes] = []
    transport.subscribe(KEY, lambda payload, _: received.append(payload))
    put = transport.publisher(OTHER, qos)
    with peer(net, "x") as process:
        wait_until(lambda: received)
        put(b"the peer's subscription is known by now")
        process.send_signal(signal.SIGSTOP)
        slowest_s = 0.0
        deadline = time.monotonic() + 1.5
        while time.monotonic() < deadline:
            begin = time.monotonic()
            put(bytes(16_000))  # fills every buffer on the way
            slowest_s = max(slowest_s, time.monotonic() - begin)
            time.sleep(0.0005)
        took_s = wait_until(lambda: transport.peers() == 0)
    with witness.timely(0.05):
        assert slowest_s < 0.05
    with witness.timely(1.0):
        assert took_s < TransportSettings().lease_s


def test_an_impaired_transport_delays_and_loses_as_it_was_asked(net: Net, witness: Witness) -> None:
    timers = TimerThread(CLOCK, net.faults.append)
    timers.start()
    asked = ImpairmentSettings(delay_s=0.05, jitter_s=0.01, loss=0.2)
    receiver = ImpairedTransport(net.listener(), timers, CLOCK, Impairment(asked, seed=5), None)
    sender = net.connector()
    delays_ns: list[int] = []
    receiver.subscribe(KEY, lambda payload, stamp: delays_ns.append(stamp - int(payload)))
    put = sender.publisher(KEY, Qos.STREAM)
    put_until(lambda _: put(b"%d" % CLOCK.now_ns()), lambda: delays_ns)
    trace: list[Sequence[int]] = []

    def met() -> int:
        trace.extend(plan for chunk in receiver.drain_trace() for plan in chunk.delays_ns)
        return len(trace)

    probes = met()
    put_until(lambda _: put(b"%d" % CLOCK.now_ns()), lambda: met() - probes >= 200)
    wait_until(lambda: met() and len(delays_ns) == sum(map(bool, trace)))
    receiver.close()
    timers.close()
    planned_ns = [plan[0] for plan in trace if plan]
    excess_ns = sorted(delay - planned for delay, planned in zip(delays_ns, planned_ns, strict=True))
    assert excess_ns[0] >= 0  # never early
    with witness.timely(0.01):
        assert excess_ns[len(excess_ns) // 2] < 10_000_000  # 0.1 ms on an idle machine
    assert net.faults == []


def test_what_is_put_to_a_pattern_of_keys_is_refused_and_counted(net: Net) -> None:
    first, second = net.listener(), net.connector()
    got: list[bytes] = []
    first.subscribe(KEY, lambda payload, _: got.append(payload))
    first.subscribe_all("forefeel", lambda _key, payload, _: got.append(payload))
    put_until(second.publisher(KEY, Qos.EVENT), lambda: got)
    for pattern in ("forefeel/**", "forefeel/*/*/master/command", "forefeel/ce$*/insertion/**"):
        put_until(
            second.publisher(pattern, Qos.EVENT), lambda: first.refused().get("refused_wildcard", 0) >= 2
        )
    assert first.refused()["refused_wildcard"] >= 2
    assert set(got) == {b"probe"}
    assert len(got) < 40


def test_what_is_far_too_large_is_not_even_put_together(net: Net) -> None:
    first, second = net.listener(), net.connector()
    got: list[int] = []
    first.subscribe(KEY, lambda payload, _: got.append(len(payload)))
    put = second.publisher(KEY, Qos.EVENT)
    put_until(put, lambda: got)
    put(bytes(300_000))
    put(bytes(60_000))
    wait_until(lambda: 60_000 in got)
    assert 300_000 not in got


def test_what_waits_for_a_reader_holds_on_to_little_memory() -> None:
    """In a process of its own, where nothing was freed before that could be used again."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        kept, grown_mb = pool.submit(unread_mb, 1000, 3000).result(timeout=30)
    assert kept >= 1000
    assert grown_mb < 20.0  # 50 MB where each keeps the largest packet


def unread_mb(waiting: int, sent: int) -> tuple[int, float]:
    """How many messages a subscriber is given that does not read while `sent` come, and its growth then."""
    net = Net()
    first, second = net.listener(), net.connector()
    got: list[str] = []
    goes_on = threading.Event()

    def hear(key: str, _payload: bytes, _receive_ns: int) -> None:
        got.append(key)
        goes_on.wait()

    first.subscribe_all("forefeel", hear, waiting)
    put = second.publisher(KEY, Qos.STREAM)
    put_until(put, lambda: got)
    before_mb = resident_mb()
    for _ in range(sent):
        put(bytes(300))
        time.sleep(0.0002)  # each travels by itself
    grown_mb = resident_mb() - before_mb
    goes_on.set()
    wait_until(lambda: len(got) >= waiting)
    net.close()
    return len(got), grown_mb


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
