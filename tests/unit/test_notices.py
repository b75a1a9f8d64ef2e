import pytest

from forefeel.common.messages import SafetyEvent, SafetyState
from forefeel.common.notices import (
    Lasting,
    Notices,
    RateLimit,
    in_words,
    is_long_round_trip,
    long_round_trip,
    span,
)

S = 1_000_000_000


def test_a_transition_is_one_printable_line_whatever_its_reason_holds() -> None:
    event = SafetyEvent(
        session_id=1,
        sequence=1,
        stamp_ns=1,
        before=SafetyState.ARMED,
        event="estop",
        after=SafetyState.ESTOPPED,
        reason="a\nb\x1b[2J",
    )
    notices = Notices()
    notices.add(in_words(event))
    assert notices.drain() == ["armed -> estopped, estop: a?b?[2J"]
    assert notices.drain() == []


def test_very_many_lines_keep_the_newest() -> None:
    notices = Notices()
    for i in range(1000):
        notices.add(str(i))
    assert notices.drain()[-1] == "999"


@pytest.mark.parametrize("at_once", [1, 7, 100])
def test_a_second_has_ten_lines_and_the_next_says_how_many_more_there_were(at_once: int) -> None:
    limit, said = RateLimit(10), list[str]()
    texts = [str(i) for i in range(100)]
    for first in range(0, 100, at_once):
        said += limit.passed(texts[first : first + at_once], S + first)
    assert said == texts[:10]
    assert limit.passed([], 2 * S) == ["90 more, not shown"]
    assert limit.passed(["again"], 2 * S + 1) == ["again"]
    assert limit.passed([], 3 * S) == []


def test_a_cause_that_lasts_is_told_at_once_and_every_five_seconds() -> None:
    lasting = Lasting()
    assert [at_s for at_s in range(3, 20) if lasting.due(at_s * S)] == [3, 8, 13, 18]


def test_times_that_have_passed() -> None:
    assert [span(s) for s in (-1, 3.24, 48.9, 125, 4020)] == [
        "0.0 s", "3.2 s", "48 s", "2 min 05 s", "1 h 07 min",
    ]  # fmt: skip


def test_a_round_trip_that_is_too_long_is_known_by_its_words() -> None:
    assert long_round_trip(0.812, 0.7) == "round trip 812 ms, limit 700 ms"
    assert is_long_round_trip(long_round_trip(0.812, 0.7))
    assert not is_long_round_trip("ramp done")
