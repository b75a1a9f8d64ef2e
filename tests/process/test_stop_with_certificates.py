"""`forefeel estop` over mutual TLS: whoever may stop a cell does, in each role that may."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from forefeel.common import topics
from forefeel.common.bus import Bus
from forefeel.common.clock import MonotonicClock
from forefeel.common.messages import EmergencyStop, Grip, SafetyState, SlaveState
from forefeel.common.transport.security import PartyRole
from forefeel.common.transport.settings import TransportSettings
from forefeel.local.stop import Caller, stop_over_network
from tests.secured import CELL, Secured, free_endpoint, make_pki, sessions


class Slave:
    """Says its state at 50 Hz, and stops when it is told to."""

    def __init__(self, net: Secured, pki: Path, endpoint: str) -> None:
        self.stops: list[EmergencyStop] = []
        clock = MonotonicClock()
        bus = Bus(net.open(pki, "slave", [endpoint]), CELL, "insertion", clock)
        bus.subscribe(topics.EMERGENCY_STOP, lambda stop, _: self.stops.append(stop))
        self._publisher, self._clock = bus.publisher(topics.SLAVE_STATE), clock
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ending.wait(0.02):
            state = SafetyState.ESTOPPED if self.stops else SafetyState.READY
            header = self._publisher.header(0, self._clock.now_ns())
            said = SlaveState(
                **header, state=state, reason="", position_m=0.0, velocity_m_s=0.0, gripper=Grip.CLOSED,
                stops=0, clock_offset_ns=None, clock_bound_ns=None, counters={},
            )  # fmt: skip
            self._publisher.send(said)


@pytest.fixture
def net() -> Iterator[Secured]:
    with sessions() as net:
        yield net
    assert net.faults == []


@pytest.mark.parametrize(
    ("role", "axes", "stopped"),
    [
        ("viewer", (), True),
        ("master", ("insertion",), True),
        pytest.param("recorder", (), False, marks=pytest.mark.soak),
    ],
)
def test_who_may_stop_a_cell_stops_it(
    net: Secured, tmp_path: Path, role: PartyRole, axes: tuple[str, ...], stopped: bool
) -> None:
    pki, endpoint = make_pki(tmp_path / "pki"), free_endpoint()
    slave = Slave(net, pki, endpoint)
    try:
        caller = Caller(TransportSettings(connect=(endpoint,), pki=pki), role, CELL)
        outcome = stop_over_network(caller, axes, "nurse", "the catheter kinks")
    finally:
        slave.close()
    assert outcome.done == stopped
    assert {(stop.source, stop.reason) for stop in slave.stops} == (
        {("nurse", "the catheter kinks")} if stopped else set()
    )
    assert outcome.axes == {"insertion": "estopped" if stopped else "ready"}
