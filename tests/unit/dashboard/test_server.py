"""Where the page is served."""

import socket

import pytest

from forefeel.child_process import listening_at, next_listening
from forefeel.common.errors import EndpointError


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
