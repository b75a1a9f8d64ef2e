"""The conversation with a page: its manners, and what it refuses."""

import asyncio
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import pytest

pytest.importorskip("starlette")
from starlette.websockets import WebSocket, WebSocketDisconnect

from forefeel.common.clock import VirtualClock
from forefeel.common.codec import encode
from forefeel.dashboard import conversation
from forefeel.dashboard.chapter import Chapter
from forefeel.dashboard.conversation import Conversations
from forefeel.dashboard.sources import Ask, LiveCell, RecordedSource, Source
from forefeel.dashboard.story import Story
from tests.unit.dashboard.said import AXIS, CELL, S, talk
from tests.unit.dashboard.test_replay import write


class Socket:
    """Asks what it was given, then goes away."""

    def __init__(self, asks: Sequence[str]) -> None:
        self.told: list[Any] = []
        self.closed: tuple[int, str] | None = None
        self._asks = list(asks)

    async def accept(self) -> None:
        pass

    async def close(self, code: int, reason: str = "") -> None:
        self.closed = code, reason

    async def receive_text(self) -> str:
        if not self._asks:
            raise WebSocketDisconnect
        return self._asks.pop(0)

    async def send_text(self, text: str) -> None:
        self.told.append(json.loads(text))


def conversed(served: Conversations, *asks: str) -> Socket:
    """The conversation, when it has ended."""
    socket = Socket(asks)
    asyncio.run(served.serve(cast(WebSocket, socket)))
    assert served.open == 0
    return socket


def answers(source: Source, *asks: dict[str, Any]) -> list[dict[str, Any]]:
    """The facts, then an answer for each."""
    return conversed(Conversations(source), *map(json.dumps, asks)).told


@pytest.fixture
def live() -> tuple[LiveCell, VirtualClock]:
    clock = VirtualClock(9 * S)
    cell = LiveCell(CELL, "tcp/10.0.0.2:7447", clock)
    for topic, message, heard_ns in talk(1, 500):
        cell.hear(topic.key(CELL, AXIS), encode(message), heard_ns)
    clock.set_ns(9 * S + 500_000_000)
    return cell, clock


def test_who_asks_is_answered_and_the_second_answer_holds_only_what_is_new(
    live: tuple[LiveCell, VirtualClock],
) -> None:
    facts, first, second = answers(live[0], {}, {})
    assert facts == {"cell": CELL, "file": None}
    assert (first["axis"], first["anew"], first["silence"]) == (AXIS, True, None)
    assert len(first["traces"]["felt"]) > 40
    assert (second["traces"]["felt"], second["cards"], second["anew"]) == ([], {}, False)


def test_silence_is_said_with_since_when(live: tuple[LiveCell, VirtualClock]) -> None:
    cell, clock = live
    clock.set_ns(60 * S)
    _, answer = answers(cell, {})
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
def test_what_is_no_question_ends_the_conversation(live: tuple[LiveCell, VirtualClock], asked: str) -> None:
    ended = conversed(Conversations(live[0]), asked, "{}")
    assert ended.closed == (1008, "not understood")
    assert len(ended.told) == 1


def test_viewers_are_bounded(live: tuple[LiveCell, VirtualClock], monkeypatch: pytest.MonkeyPatch) -> None:
    served = Conversations(live[0])
    monkeypatch.setattr(served, "open", conversation.MOST_VIEWERS)
    full = Socket(["{}"])
    asyncio.run(served.serve(cast(WebSocket, full)))
    assert (full.closed, full.told) == ((1013, "too many viewers"), [])
    assert served.open == conversation.MOST_VIEWERS


def test_each_page_of_a_recording_has_its_own_time(tmp_path: Path) -> None:
    recorded = RecordedSource(write(tmp_path / "run.mcap", 4))
    facts, early, late = answers(recorded, {"at_s": 1.0}, {"at_s": 3.5})
    assert (facts["file"], facts["cell"]) == ("run.mcap", CELL)
    assert facts["duration_s"] == pytest.approx(4.0, abs=0.01)
    assert late["now_s"] - early["now_s"] == pytest.approx(2.5, abs=1e-3)
    assert early["clock_s"] - facts["zero_s"] == pytest.approx(1.0, abs=1e-6)


def test_damage_in_a_recording_is_said_on_the_page(tmp_path: Path) -> None:
    path = write(tmp_path / "run.mcap", 3)
    recorded = RecordedSource(path)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    _, answer = answers(recorded, {"at_s": 3.0})
    assert "damaged" in answer["silence"]["word"]


def test_next_chapter_begins_with_its_facts(live: tuple[LiveCell, VirtualClock], tmp_path: Path) -> None:
    story = Story(live[0], Chapter(head="running"))
    assert story.facts()["file"] is None
    viewer = story.viewer()
    report = tmp_path / "report.html"
    story.tell(Chapter(head="ended", recording=write(tmp_path / "run.mcap", 3), pages={"report": report}))
    facts = asyncio.run(viewer.answer(Ask()))["facts"]
    assert (facts["file"], facts["chapter"]) == ("run.mcap", {"head": "ended", "pages": ["report"]})
    assert asyncio.run(viewer.answer(Ask(at_s=2.0)))["traces"]["felt"]
    story.tell(Chapter(head="another run"))
    assert asyncio.run(viewer.answer(Ask()))["facts"]["file"] is None
    assert asyncio.run(viewer.answer(Ask()))["axes"] == []  # nothing of the run before
