"""The conversation with a page: its manners, and what it refuses."""

import asyncio
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

pytest.importorskip("starlette")
from starlette.websockets import WebSocket, WebSocketDisconnect

from forefeel.common.clock import VirtualClock
from forefeel.common.codec import encode
from forefeel.dashboard.endpoint import MOST_VIEWERS, Endpoint
from forefeel.dashboard.scene import Scene
from forefeel.dashboard.sources import LiveCell
from tests.unit.dashboard.talk import AXIS, CELL, S, talk
from tests.unit.dashboard.test_replay import write

Live = tuple[Endpoint, VirtualClock]
Act = str | Callable[[], None]


class Socket:
    """Asks what it was given, stays until `ended` if it is given, then goes away; what can be called happens
    before the next question. `settled`: it has asked all or was closed.
    """

    def __init__(self, *asks: Act, ended: asyncio.Event | None = None) -> None:
        self._ended, self.settled = ended, asyncio.Event()
        self.told: list[Any] = []
        self.closed: tuple[int, str] | None = None
        self.aborted = False
        self.state = SimpleNamespace(abort=partial(setattr, self, "aborted", True))
        self._asks = list(asks)

    async def accept(self) -> None:
        pass

    async def close(self, code: int, reason: str = "") -> None:
        self.closed = code, reason
        self.settled.set()

    async def receive_text(self) -> str:
        while self._asks:
            ask = self._asks.pop(0)
            if isinstance(ask, str):
                return ask
            ask()
        self.settled.set()
        if self._ended is not None:
            await self._ended.wait()
        raise WebSocketDisconnect

    async def send_text(self, text: str) -> None:
        self.told.append(json.loads(text))


def conversed(served: Endpoint, *asks: Act) -> Socket:
    """The conversation, when it has ended."""
    socket = Socket(*asks)
    before = served.open
    asyncio.run(served.converse(cast(WebSocket, socket)))
    assert served.open == before
    return socket


def recorded(path: Path, *asks: dict[str, Any]) -> list[dict[str, Any]]:
    """The facts of a recording, then an answer for each."""
    first, *answers = conversed(Endpoint(None, Scene(recording=path)), *map(json.dumps, asks)).told
    return [first["facts"], *answers]


@pytest.fixture
def live() -> Live:
    """A cell that was heard for half a second."""
    clock = VirtualClock(9 * S)
    cell = LiveCell(CELL, "tcp/10.0.0.2:7447", clock)
    served = Endpoint(cell, Scene())
    for topic, message, heard_ns in talk(1, 500):
        cell.hear(topic.key(CELL, AXIS), encode(message), heard_ns)
    clock.set_ns(9 * S + 500_000_000)
    return served, clock


def test_who_asks_is_answered_and_the_second_answer_holds_only_what_is_new(
    live: Live,
) -> None:
    began, first, second = conversed(live[0], "{}", "{}").told
    assert (began["facts"]["cell"], began["facts"]["file"]) == (CELL, None)
    assert (first["axis"], first["anew"], first["silence"]) == (AXIS, True, None)
    assert len(first["traces"]["felt"]) > 40
    assert (second["traces"]["felt"], second["cards"], second["anew"]) == ([], {}, False)


def test_silence_is_said_with_since_when(live: Live) -> None:
    live[1].set_ns(60 * S)
    _, answer = conversed(live[0], "{}").told
    assert answer["silence"] == {
        "word": "Cell cathlab: silent", "for": "50 s", "since_s": 9.5, "where": "tcp/10.0.0.2:7447",
    }  # fmt: skip


@pytest.mark.parametrize(
    "asked",
    [
        "", "nonsense", "[]", '{"at_s": -1}', '{"at_s": 1e400}', '{"window_s": 0}', '{"command": 1}',
        "[" * 3000, json.dumps({"axis": "x" * 257}),
    ],
)  # fmt: skip
def test_what_is_no_question_ends_the_conversation(live: Live, asked: str) -> None:
    ended = conversed(live[0], asked, "{}")
    assert ended.closed == (1008, "not understood")
    assert len(ended.told) == 1


def test_a_page_beyond_the_viewers_takes_the_place_of_the_oldest_that_asked_nothing(
    live: Live,
) -> None:
    async def crowd() -> list[Socket]:
        ended = asyncio.Event()
        sockets = [Socket(*["{}"] * (i not in {1, 2}), ended=ended) for i in range(MOST_VIEWERS + 3)]
        viewing = []
        for socket in sockets:
            viewing.append(asyncio.create_task(live[0].converse(cast(WebSocket, socket))))
            await socket.settled.wait()
        assert live[0].open == MOST_VIEWERS
        ended.set()
        await asyncio.gather(*viewing)
        return sockets

    refused = [i for i, socket in enumerate(asyncio.run(crowd())) if socket.closed and socket.aborted]
    assert refused == [1, 2, MOST_VIEWERS + 2]  # those in between were open pages
    assert live[0].open == 0


def test_each_page_of_a_recording_has_its_own_time(tmp_path: Path) -> None:
    run = write(tmp_path / "run.mcap", 6)
    facts, early, late = recorded(run, {"at_s": 1.0}, {"at_s": 3.5})
    assert (facts["file"], facts["cell"]) == ("run.mcap", CELL)
    assert (facts["duration_s"], facts["first_s"]) == pytest.approx((6.0, 5.0), abs=0.01)
    assert late["now_s"] - early["now_s"] == pytest.approx(2.5, abs=1e-3)
    assert early["clock_s"] - facts["zero_s"] == pytest.approx(1.0, abs=1e-6)


def test_damage_in_a_recording_is_said_on_the_page(tmp_path: Path) -> None:
    path = write(tmp_path / "run.mcap", 3)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    _, answer = conversed(Endpoint(None, Scene(recording=path)), '{"at_s": 3.0}').told
    assert "damaged" in answer["silence"]["word"]


def test_next_scene_begins_with_its_facts(live: Live, tmp_path: Path) -> None:
    pages = {"report": tmp_path / "report.html"}
    ended = Scene(head="ended", recording=write(tmp_path / "run.mcap", 3), pages=pages)
    at_2_s = '{"at_s": 2.0}'
    tell = partial(partial, live[0].show)
    _, second, shown, _, between, third, last = conversed(
        live[0], tell(ended), "{}", at_2_s, tell(Scene(waits="x")), "{}", "{}", tell(Scene()), "{}", "{}"
    ).told
    facts = second["facts"]
    assert (facts["file"], facts["scene"]) == ("run.mcap", {"head": "ended", "pages": ["report"]})
    assert shown["traces"]["felt"]
    assert (between["axes"], between["silence"]) == ([], {"word": "x"})
    assert third["facts"]["file"] is None
    assert last["axes"] == []  # nothing of the run before
    assert last["silence"]["word"] == f"Waits for master and slave of cell {CELL}"
