from itertools import count

import pytest

from master.session import Link, Session

MS = 1_000_000


def session() -> Session:
    return Session(count(11).__next__)


def opened(now_ns: int = 0) -> Session:
    asking = session()
    asking.answered(11, True, "", now_ns)
    return asking


def test_it_asks_at_once_and_again_every_quarter_of_a_second() -> None:
    asking = session()
    asked = [ms for ms in range(0, 1001, 50) if asking.should_ask(ms * MS)]
    assert asked == [0, 250, 500, 750, 1000]
    assert (asking.session_id, asking.link, asking.reason) == (11, Link.ASKING, "no answer yet")


def test_an_acceptance_opens_it_and_it_asks_no_more() -> None:
    asking = session()
    asking.should_ask(0)
    asking.answered(11, True, "", 30 * MS)
    assert (asking.link, asking.reason, asking.heard_ns) == (Link.OPEN, "accepted", 30 * MS)
    assert not asking.should_ask(900 * MS)


def test_an_answer_to_an_older_session_is_heard_but_changes_nothing() -> None:
    asking = session()
    asking.answered(10, True, "", 5 * MS)
    asking.answered(12, False, "settings differ: kind", 6 * MS)
    assert (asking.link, asking.reason, asking.heard_ns) == (Link.ASKING, "no answer yet", 6 * MS)


@pytest.mark.parametrize("reason", ["another session holds the lease", "the stage is not at rest"])
def test_a_refusal_that_passes_is_asked_again_with_the_same_id(reason: str) -> None:
    asking = session()
    assert asking.should_ask(0)
    asking.answered(11, False, reason, 10 * MS)
    assert (asking.link, asking.reason, asking.session_id) == (Link.ASKING, reason, 11)
    assert asking.should_ask(250 * MS)


def test_settings_that_differ_do_not_come_right_by_asking() -> None:
    asking = session()
    asking.answered(11, False, "settings differ: kind: insertion here, rotation there", 0)
    assert (asking.link, asking.session_id) == (Link.MISMATCH, 11)


def test_an_id_that_was_used_is_replaced() -> None:
    asking = session()
    asking.answered(11, False, "this session id was used before", 0)
    assert (asking.link, asking.session_id) == (Link.ASKING, 12)


def test_a_late_refusal_does_not_close_an_open_session() -> None:
    asking = opened()
    asking.answered(11, False, "another session holds the lease", 10 * MS)
    assert (asking.link, asking.reason) == (Link.OPEN, "accepted")


def test_it_lives_as_long_as_the_slave_names_it_as_holder() -> None:
    asking = opened()
    for ms in range(0, 5000, 20):
        asking.heard_state(11, ms * MS)
        assert not asking.should_ask((ms + 999) * MS)
    assert asking.link is Link.OPEN


@pytest.mark.parametrize("named", [0, 99, None])
def test_when_the_slave_names_another_or_nobody_for_a_second_it_asks_with_a_new_id(named: int | None) -> None:
    asking = opened()
    asking.heard_state(11, 100 * MS)
    for ms in range(120, 1101, 20):
        if named is not None:
            asking.heard_state(named, ms * MS)
        assert not asking.should_ask(ms * MS)
    assert asking.should_ask(1101 * MS)
    assert (asking.link, asking.session_id) == (Link.ASKING, 12)
    assert asking.reason == "the slave no longer holds our session"
    asking.answered(11, True, "", 1102 * MS)  # the answer of before
    assert asking.link is Link.ASKING


def test_every_new_session_has_a_new_id() -> None:
    asking, ids = session(), set[int]()
    for round_ in range(50):
        now_ns = round_ * 2000 * MS
        asking.answered(asking.session_id, True, "", now_ns)
        ids.add(asking.session_id)
        assert asking.should_ask(now_ns + 1500 * MS)
    assert len(ids) == 50
