"""The cable in software, with packets: a delay that was asked for is there, and little more."""

import socket
import time
from pathlib import Path

import numpy as np
import pytest

from tests.system.net.cable import ADDRESSES, TunCable
from tests.system.net.hosts import Hosts, joined_by_tun, needs_root
from tests.system.net.namespaces import inside

pytestmark = needs_root
ASKED_S = 0.005
PACKETS = 1000


def udp(hosts: Hosts, host: int) -> socket.socket:
    """A socket on one of the hosts."""
    with inside(hosts.names[host]):
        found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        found.bind((ADDRESSES[host], 9000))
    found.settimeout(1.0)
    return found


def one_way_s(near: socket.socket, far: socket.socket, packets: int) -> np.ndarray:
    """The delay of each packet that arrived; one at a time, so that this process waits for nothing else."""
    found = []
    for _ in range(packets):
        near.sendto(time.monotonic_ns().to_bytes(8, "little"), far.getsockname())
        try:
            sent_ns = int.from_bytes(far.recv(64), "little")
        except TimeoutError:
            continue
        found.append((time.monotonic_ns() - sent_ns) * 1e-9)
    return np.array(found)


@pytest.mark.soak
def test_five_milliseconds_are_five_milliseconds_in_both_ways(tmp_path: Path) -> None:
    with joined_by_tun(tmp_path) as (hosts, cable), udp(hosts, 0) as a, udp(hosts, 1) as b:
        bare_s = one_way_s(a, b, PACKETS)
        cable.shape(delay_s=ASKED_S)
        for near, far in ((a, b), (b, a)):
            delay_s = one_way_s(near, far, PACKETS // 4)
            assert len(delay_s) == PACKETS // 4
            assert delay_s.min() >= ASKED_S
            assert np.median(delay_s) == pytest.approx(ASKED_S, abs=0.0007)
        late = cable.count()
        print(
            f"bare p50 {np.median(bare_s) * 1e6:.0f} p99 {np.quantile(bare_s, 0.99) * 1e6:.0f} us; "
            f"forwarder late p50 {late['late_p50_us']:.0f} p99 {late['late_p99_us']:.0f} us"
        )
        assert np.median(bare_s) < 0.0007
        check_orders(cable, a, b)


def check_orders(cable: TunCable, a: socket.socket, b: socket.socket) -> None:
    """Cut, mended, stalled, lossy."""
    cable.shape()
    b.settimeout(0.05)
    cable.cut()
    assert len(one_way_s(a, b, 3)) == 0
    cable.mend()
    assert len(one_way_s(a, b, 3)) == 3
    b.settimeout(1.0)
    at_ns = cable.stall(0.3)
    assert one_way_s(a, b, 1)[0] == pytest.approx(0.3, abs=0.05)
    assert time.monotonic_ns() - at_ns >= 300_000_000
    cable.shape(loss=0.3)
    for _ in range(PACKETS):
        a.sendto(b"", b.getsockname())
        time.sleep(1e-4)
    time.sleep(0.1)
    assert cable.count()["ab"]["lost"] == pytest.approx(0.3 * PACKETS, rel=0.25)
