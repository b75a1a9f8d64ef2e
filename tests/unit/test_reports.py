from common.bus import Bus
from common.daemon import Reports
from common.lateness import Lateness
from common.runtime.virtual import VirtualRuntime
from common.topics import Qos
from common.transport.impaired import ImpairedTransport
from common.transport.impairment import ReplayedImpairment
from common.transport.memory import MemoryBus


def test_a_trace_that_nobody_drained_in_time_is_counted_among_the_states_counters() -> None:
    runtime, network = VirtualRuntime(), MemoryBus()
    transport = ImpairedTransport(
        network.session(runtime.clock), runtime, runtime.clock, ReplayedImpairment([()]), None
    )
    bus = Bus(transport, "cell", "insertion", runtime.clock)
    reports = Reports(bus, "slave", Lateness(), transport, runtime)
    reports.impairment(0)
    assert bus.counts() == {}
    transport.subscribe("any/key", lambda payload, _: None)
    put = network.session(runtime.clock).publisher("any/key", Qos.STREAM)
    for _ in range(65_536 + 7):
        put(b"")
    reports.impairment(0)
    assert bus.counts() == {"trace_lost": 7}
