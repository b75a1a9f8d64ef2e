from itertools import count

import pytest

from forefeel.master.session import Session, SessionState

MS = 1_000_000


def asked() -> Session:
    asking = Session(count(11).__next__)
    assert asking.should_ask(0)
    return asking


def test_it_asks_at_once_and_again_every_quarter_of_a_second_until_it_is_accepted() -> None:
    asking = asked()
    times = [ms for ms in range(50, 1001, 50) if asking.should_ask(ms * MS)]
    assert times == [250, 500, 750, 1000]
    assert (asking.session_id, asking.state) == (11, SessionState.ASKING)
    assert asking.cause(12_400 * MS) == "no answer from the slave for 12 s"
    asking.answered(11, True, "", 1000 * MS, 1030 * MS)
    assert (asking.state, asking.heard_ns) == (SessionState.OPEN, 1030 * MS)
    assert not asking.should_ask(1900 * MS)


def opened() -> Session:
    asking = asked()
    asking.answered(11, True, "", 0, 30 * MS)
    return asking


def test_what_keeps_the_slave_from_being_heard_is_said_instead_of_its_silence() -> None:
    asking = asked()
    asking.obstacle = "10.0.0.2:7447 refuses the connection"
    assert asking.cause(9000 * MS) == asking.obstacle
    asking.heard_state(0, 10_000 * MS)
    assert "no answer to the handshake" in asking.cause(10_100 * MS)
    assert "no state from the slave" in asking.cause(14_000 * MS)


@pytest.mark.parametrize(
    ("reason", "session_id"),
    [
        ("another session holds the lease", 11),
        ("the stage is not at rest", 11),
        ("this session id was used before", 12),
    ],
)
def test_a_refusal_that_passes_is_asked_again_with_the_same_id_and_one_of_the_id_with_another(
    reason: str, session_id: int
) -> None:
    asking = asked()
    asking.answered(11, False, reason, 0, 10 * MS)
    assert (asking.state, asking.session_id) == (SessionState.ASKING, session_id)
    assert reason in asking.cause(20 * MS)
    assert asking.should_ask(250 * MS)


def test_an_answer_to_an_older_session_is_heard_but_changes_nothing() -> None:
    asking = asked()
    asking.answered(10, True, "", 0, 5 * MS)
    asking.answered(12, False, "settings differ: kind", 0, 6 * MS)
    assert (asking.state, asking.heard_ns) == (SessionState.ASKING, 6 * MS)


@pytest.mark.parametrize("accepted", [True, False])
def test_an_answer_that_took_longer_is_none_and_later_ones_find_another_id(accepted: bool) -> None:
    asking = asked()
    assert asking.should_ask(1750 * MS)
    asking.answered(11, accepted, "" if accepted else "another session holds the lease", 0, 2212 * MS)
    assert (asking.state, asking.session_id) == (SessionState.ASKING, 12)
    assert asking.cause(2300 * MS) == "no answer within 2 s: it takes 2.2 s"
    asking.answered(11, True, "", 1750 * MS, 2300 * MS)
    assert asking.state is SessionState.ASKING


def test_it_lives_as_long_as_the_slave_names_it_as_holder() -> None:
    asking = opened()
    for ms in range(0, 5000, 20):
        asking.heard_state(11, ms * MS)
        assert not asking.should_ask((ms + 999) * MS)
    assert asking.state is SessionState.OPEN


@pytest.mark.parametrize(
    ("named", "cause"),
    [
        (0, "the slave has ended the session"),
        (99, "the slave serves another master"),
        (None, "no state from the slave for 1.0 s"),
    ],
)
def test_unless_the_slave_names_it_for_a_second_it_asks_with_a_new_id(named: int | None, cause: str) -> None:
    asking = opened()
    asking.heard_state(11, 100 * MS)
    for ms in range(120, 1101, 20):
        if named is not None:
            asking.heard_state(named, ms * MS)
        assert not asking.should_ask(ms * MS)
    assert asking.should_ask(1101 * MS)
    assert (asking.state, asking.session_id) == (SessionState.ASKING, 12)
    assert asking.cause(1101 * MS) == cause
    asking.answered(11, True, "", 0, 1102 * MS)  # the answer of before
    assert asking.state is SessionState.ASKING
