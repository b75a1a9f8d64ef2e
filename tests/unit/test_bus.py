from forefeel.common.bus import BATCH_NS, Bus, observed
from forefeel.common.clock import VirtualClock
from forefeel.common.messages import ForceSample
from forefeel.common.topics import FORCE, HAPTICS, SLAVE_STATE
from forefeel.common.transport.memory import MemoryBus
from tests.messages import force, haptics, usual

MS = 1_000_000


class Net:
    """Two ends of a cell and an observer, on one clock."""

    def __init__(self) -> None:
        self.clock, network = VirtualClock(1000 * MS), MemoryBus()
        self.slave, self.master = (
            Bus(network.session(self.clock), "cell", "insertion", self.clock) for _ in range(2)
        )
        self.stranger = network.session(self.clock)
        self.observed: list[tuple[str, bytes]] = []
        self.stranger.subscribe_all("forefeel", lambda key, payload, _: self.observed.append((key, payload)))

    def run(self, ms: int) -> None:
        self.clock.set_ns(self.clock.now_ns() + ms * MS)
        self.slave.end_batches(self.clock.now_ns())


def test_other_end_takes_each_at_its_poll_and_observers_hear_the_batch() -> None:
    net, taken = Net(), list[tuple[int, int]]()
    poll = net.master.polled(FORCE, lambda sample, at_ns: taken.append((sample.sequence, at_ns)))
    forces = net.slave.publisher(FORCE)
    net.run(BATCH_NS // MS)
    for sequence in range(1, 4):
        forces.send(force(sequence, net.clock.now_ns()))
        assert len(taken) == sequence - 1
        poll()
        net.run(1)
    assert taken == [(1, 1020 * MS), (2, 1021 * MS), (3, 1022 * MS)]
    assert net.observed == []
    net.run(BATCH_NS // MS)
    ((key, payload),) = net.observed
    assert key == FORCE.key("cell", "insertion")
    heard = [(each.sequence, at_ns) for each, at_ns in observed(FORCE, payload, 5000 * MS)]
    assert heard == [(1, 4998 * MS), (2, 4999 * MS), (3, 5000 * MS)]
    net.run(BATCH_NS // MS)
    assert len(net.observed) == 1


def test_what_several_connections_bring_at_once_is_taken_in_the_order_of_sending() -> None:
    net, taken = Net(), list[int]()
    poll = net.master.polled(FORCE, lambda sample, _: taken.append(sample.sequence))
    forces = net.slave.publisher(FORCE)
    for sequence in (2, 1, 4, 3):
        forces.send(force(sequence, sequence))
    net.stranger.publisher(FORCE.taken_key("cell", "insertion"), FORCE.qos)(b"\xc1")
    poll()
    poll()
    assert taken == [1, 2, 3, 4]
    assert net.master.counts() == {"malformed_slave_force": 1}


def test_observed_batch_whose_stamps_are_wild_is_received_within_a_second() -> None:
    net = Net()
    publisher = net.slave.publisher(HAPTICS)
    for sequence, stamp_ns in ((1, -(2**63)), (2, 2**63 - 1)):
        publisher.send(haptics(sequence, 0).model_copy(update={"stamp_ns": stamp_ns}))
    net.slave.end_batches(0, last=True)
    found = observed(HAPTICS, net.observed[0][1], 2000 * MS)
    assert [at_ns for _, at_ns in found] == [1000 * MS, 2000 * MS]


def test_one_message_alone_is_observed_as_a_batch_is() -> None:
    net = Net()
    net.slave.publisher(SLAVE_STATE).send(usual(SLAVE_STATE))
    assert observed(SLAVE_STATE, net.observed[0][1], 7)[0][1] == 7
    sample: ForceSample = force(1, 0)
    assert observed(FORCE, net.stranger.codec.encode(sample), 7) == [(sample, 7)]
