import pytest

from common.messages import SafetyEvent, SafetyState
from common.notices import Notices, RateLimit, in_words

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
