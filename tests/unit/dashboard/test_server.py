"""Where the page is served."""

import socket

import pytest

from forefeel.child_process import listening_at
from forefeel.common.errors import EndpointError


def test_a_socket_of_the_parent_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as theirs:
        monkeypatch.setenv("FOREFEEL_LISTENING", str(theirs.fileno()))
        with listening_at("127.0.0.1", 8600) as ours:
            assert ours.getsockname() == theirs.getsockname()
            theirs.detach()


def test_why_it_can_not_listen_is_said_in_words() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(EndpointError, match=str(port)):
            listening_at("127.0.0.1", port)
