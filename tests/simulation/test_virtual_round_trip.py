"""Links that are too slow to arm, and to open a session over: both ends say the number."""

import pytest

from forefeel.common.events.console import Notices
from forefeel.common.events.text import quantity
from forefeel.common.topics import COMMAND, HAPTICS, MASTER_EVENT, MASTER_STATE, SLAVE_STATE
from tests.simulation.pair import Pair

TOLERANCE_MS = 2.0
"""The round trip is measured to within a control cycle at each end."""


def over(round_trip_s: float) -> Pair:
    pair = Pair()
    pair.to_slave.delay_s = pair.to_master.delay_s = round_trip_s / 2
    return pair


def said(notices: Notices, word: str) -> list[str]:
    return [text for text in notices.drain() if word in text]


def check_words(text: str, round_trip_ms: float, limit_ms: int) -> None:
    """That the text ends with the number and its limit."""
    asked, _, limit = text.rpartition(", limit ")
    number, unit = asked.rpartition("round trip ")[2].split()
    assert limit == quantity(limit_ms / 1e3, "s")
    assert float(number) * {"ms": 1, "s": 1e3}[unit] == pytest.approx(round_trip_ms, abs=TOLERANCE_MS)


def test_a_round_trip_beyond_the_limit_opens_a_session_and_does_not_arm_and_both_ends_say_so() -> None:
    pair = over(0.8)
    pair.run(4.0)
    slave, master = pair.slave.axes[0], pair.master.axes[0]
    assert {state.state.value for state in pair.traffic.messages(SLAVE_STATE)} == {"idle", "ready"}
    assert any(command.deadman for command in pair.traffic.messages(COMMAND))
    told = [said(end.events.notices, "limit") for end in (slave, master)]
    assert [len(texts) for texts in told] == [1, 1]  # in 5 s
    shown = [
        *told[0],
        *told[1],
        slave.reason,
        slave.status(0).removesuffix(")"),
        master.status(pair.runtime.clock.now_ns()),
        pair.traffic.newest(SLAVE_STATE).reason,
        pair.traffic.newest(MASTER_STATE).reason,
    ]
    for text in shown:
        check_words(text, 800.0, 700)


def test_up_to_two_seconds_of_round_trip_a_session_opens_and_stays() -> None:
    pair = over(1.9)
    pair.run(7.0)
    events = [event.event for event in pair.traffic.messages(MASTER_EVENT)]
    assert events == ["session_opened"]
    assert pair.traffic.times("session_lost") == []
    check_words(pair.slave.axes[0].reason, 1900.0, 700)


def test_beyond_two_seconds_of_round_trip_both_ends_say_that_there_is_no_answer() -> None:
    pair = over(2.2)
    pair.run(6.0)
    slave, master = pair.slave.axes[0], pair.master.axes[0]
    assert pair.traffic.events() == []
    assert (pair.traffic.messages(MASTER_EVENT), pair.traffic.messages(HAPTICS)) == ([], [])
    assert said(slave.events.notices, "lost")[0] == "session lost: no heartbeat from the master for 3.0 s"
    causes = {state.reason for state in pair.traffic.messages(MASTER_STATE)}
    assert "no answer within 2 s: it takes 2.2 s" in causes
    assert all("no answer" in cause for cause in causes)
    assert master.status(pair.runtime.clock.now_ns()).startswith("asking for a session: no answer")
