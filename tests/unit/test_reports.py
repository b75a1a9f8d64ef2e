import pytest

from forefeel.common.bus import Bus
from forefeel.common.daemon import SECOND_NS, Reports
from forefeel.common.lateness import Lateness
from forefeel.common.runtime.virtual import VirtualRuntime
from forefeel.common.topics import SLAVE_IMPAIRMENT, Qos
from forefeel.common.transport.impaired import ImpairedTransport
from forefeel.common.transport.impairment import ReplayedImpairment
from forefeel.common.transport.memory import MemoryBus
from tests.network import Traffic


@pytest.mark.parametrize(("when_ns", "last"), [(SECOND_NS, False), (SECOND_NS // 2, True)])
def test_trace_of_a_second_is_published_at_its_end_or_that_of_the_daemon(when_ns: int, last: bool) -> None:
    runtime, network = VirtualRuntime(), MemoryBus()
    inner = network.session(runtime.clock)
    transport = ImpairedTransport(inner, runtime, runtime.clock, ReplayedImpairment([()]), None)
    bus = Bus(transport, "cell", "insertion", runtime.clock)
    reports = Reports(bus, "slave", Lateness(), transport, runtime)
    traffic = Traffic(network.session(runtime.clock))
    transport.subscribe("any/key", lambda payload, _: None)
    network.session(runtime.clock).publisher("any/key", Qos.STREAM)(b"")
    reports.impairment(0)
    reports.impairment(SECOND_NS // 2)
    assert traffic.messages(SLAVE_IMPAIRMENT) == []
    reports.impairment(when_ns, last)
    assert [chunk.first_index for chunk in traffic.messages(SLAVE_IMPAIRMENT)] == [0]
