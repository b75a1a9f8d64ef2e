"""What a master says when it ends."""

from forefeel.common.topics import MASTER_LIMIT, MASTER_STATE
from tests.simulation.pair import Pair, S


def test_every_limit_of_the_force_is_counted_by_an_event_when_the_master_has_ended() -> None:
    pair = Pair(master={"axes": [{"rendering": {"max_force_n": 0.01, "max_slew_n_s": 1.0}}]})
    pair.run(2.093)  # amid a stroke, and 93 ms after events were due
    before = sum(event.count for event in pair.traffic.messages(MASTER_LIMIT))
    pair.master.close(pair.runtime.clock.now_ns())
    limited = pair.traffic.messages(MASTER_STATE)[-1].counters["force_limited"]
    assert 0 < before < limited, f"in {pair.runtime.clock.now_ns() / S} s"
    assert sum(event.count for event in pair.traffic.messages(MASTER_LIMIT)) == limited
