"""Which connection of the page gives way."""

from types import SimpleNamespace
from typing import cast

import pytest

pytest.importorskip("uvicorn")

from forefeel.dashboard.server import HEAD_S, MOST_CONNECTIONS, Connection, displaced, overdue


def peer(since_s: float, silent: bool = True) -> Connection:
    return cast(Connection, SimpleNamespace(since_s=since_s, silent=silent))


def test_nobody_gives_way_while_there_is_room() -> None:
    assert displaced([peer(float(i)) for i in range(MOST_CONNECTIONS - 1)]) is None


def test_the_oldest_silent_one_gives_way_and_the_oldest_where_all_are_being_answered() -> None:
    peers = [peer(float(i), silent=i >= 7) for i in range(MOST_CONNECTIONS)]
    assert displaced(peers[::-1]) is peers[7]
    answered = [peer(float(i), silent=False) for i in range(MOST_CONNECTIONS)]
    assert displaced(answered[::-1]) is answered[0]


def test_a_request_that_does_not_arrive_in_time_is_overdue() -> None:
    late, answered, recent = peer(0.0), peer(0.0, silent=False), peer(1.0)
    assert overdue([late, answered, recent], HEAD_S + 0.5) == [late]
