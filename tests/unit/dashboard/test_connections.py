"""Where the page is served, and which connection gives way."""

import asyncio
import json
import socket
from types import SimpleNamespace
from typing import cast

import pytest

pytest.importorskip("uvicorn")

from starlette.requests import Request

from forefeel.child_process import listening_at, next_listening
from forefeel.common.codec import encode
from forefeel.common.errors import EndpointError
from forefeel.common.topics import EMERGENCY_STOP, SLAVE_STATE
from forefeel.common.transport.memory import MemoryBus
from forefeel.dashboard.server import HEAD_S, MOST_CONNECTIONS, Connection, StopButton, displaced, overdue
from tests.messages import usual
from tests.network import Traffic
from tests.stepped import SteppedHost


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


def test_a_socket_of_the_parent_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as theirs:
        monkeypatch.setenv("FOREFEEL_LISTENING", str(theirs.fileno()))
        with listening_at("127.0.0.1", 8600) as ours:
            assert ours.getsockname() == theirs.getsockname()
            theirs.detach()


def test_a_taken_port_is_said_in_words_or_gives_way_to_the_next() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(EndpointError, match=str(port)):
            listening_at("127.0.0.1", port)
        with next_listening("127.0.0.1", port) as other:
            assert 0 < other.getsockname()[1] - port < 20


@pytest.mark.parametrize(("linked", "stops"), [(True, 1), (False, 100)])
def test_button_takes_no_state_of_before_the_press_for_a_confirmation(linked: bool, stops: int) -> None:
    """An axis that was stopped and is silent may have been cleared since."""
    host, bus = SteppedHost(), MemoryBus()
    traffic = Traffic(bus.session(host.clock))
    button = StopButton(bus.session(host.clock), "cell", host.clock)
    key, payload = SLAVE_STATE.key("cell", "insertion"), encode(usual(SLAVE_STATE, state="estopped"))
    button.hear(key, payload, host.clock.now_ns())

    async def press() -> bytes:
        if linked:
            loop = asyncio.get_running_loop()
            loop.call_later(0.01, lambda: button.hear(key, payload, host.clock.now_ns()))
        answer = await button.press(cast(Request, SimpleNamespace(client=None)))
        return bytes(answer.body)

    assert json.loads(host.run(press())) == {"heard": True, "running": [] if linked else ["insertion"]}
    assert len(traffic.messages(EMERGENCY_STOP)) == stops
