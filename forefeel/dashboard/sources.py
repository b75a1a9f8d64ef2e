"""What the page is fed from: a cell that is heard now, or a recording of one."""

import asyncio
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Protocol, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from forefeel.common.clock import Clock
from forefeel.common.errors import RecordingError
from forefeel.common.events.text import span
from forefeel.common.recording.mcap_spans import RunSpans
from forefeel.dashboard.cell_view import CellView
from forefeel.dashboard.feed import Answer, Feed
from forefeel.dashboard.lights import silent_s
from forefeel.dashboard.replay import ReplayClock
from forefeel.dashboard.trace import SPAN_S

R = TypeVar("R")


class Ask(BaseModel):
    """What a page asks for: an axis, and of a recording a time in s and how much before it is shown."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    axis: Annotated[str, Field(max_length=256)] | None = None
    at_s: Annotated[float, Field(ge=0.0, le=1e7)] = 0.0
    window_s: Annotated[float, Field(ge=1.0, le=SPAN_S)] = SPAN_S


class Viewer(Protocol):
    async def answer(self, ask: Ask) -> Answer: ...


class Source(Protocol):
    """Where pages get what they show."""

    def facts(self) -> dict[str, Any]:
        """What does not change: the cell, and whether it is a recording."""
        ...

    def viewer(self) -> Viewer: ...


class LiveCell:
    """A cell that is heard on one thread and shown on others."""

    def __init__(self, name: str, where: str, clock: Clock) -> None:
        self._name, self._where, self._clock = name, where, clock
        self._lock = threading.Lock()
        self.begin()

    def begin(self) -> None:
        """Forgets what was heard: another run of the cell is to come."""
        with self._lock:
            self._cell, self._since_ns = CellView(), self._clock.now_ns()

    def hear(self, key: str, payload: bytes, receive_ns: int) -> None:
        with self._lock:
            self._cell.hear(key, payload, receive_ns)

    def look(self, at: Callable[[CellView, int], R]) -> R:
        """Calls `at` with the cell and the time, while nobody else is at it."""
        with self._lock:
            return at(self._cell, self._clock.now_ns())

    def facts(self) -> dict[str, Any]:
        return {"cell": self._name, "file": None}

    def viewer(self) -> "LiveViewer":
        return LiveViewer(self)

    def silence(self, cell: CellView, now_ns: int) -> dict[str, Any] | None:
        """That nothing is heard, since when, and where it was listened for."""
        quiet_s = silent_s(cell.heard_ns, now_ns, self._since_ns)
        if quiet_s is None:
            return None
        word = "nothing heard yet" if cell.heard_ns is None else "silent"
        return {
            "word": f"Cell {self._name}: {word}",
            "for": span(quiet_s),
            "since_s": round(now_ns * 1e-9 - quiet_s, 1),
            "where": self._where,
        }


class LiveViewer:
    def __init__(self, live: LiveCell) -> None:
        self._live, self._feed = live, Feed()

    async def answer(self, ask: Ask) -> Answer:
        return self._live.look(lambda cell, now_ns: self._answer(cell, now_ns, ask))

    def _answer(self, cell: CellView, now_ns: int, ask: Ask) -> Answer:
        answer = self._feed.answer(cell, ask.axis, now_ns)
        return answer | {"silence": self._live.silence(cell, now_ns)}


class RecordedSource:
    """A recording, for any number of pages, each at its own time."""

    def __init__(self, path: Path) -> None:
        self._spans = RunSpans(path)
        self.metadata = self._spans.metadata

    def facts(self) -> dict[str, Any]:
        duration_s = (self._spans.end_ns - self._spans.start_ns) * 1e-9
        zero_s = self._spans.start_ns * 1e-9
        return {
            "cell": self._spans.cell,
            "file": self._spans.path.name,
            "duration_s": duration_s,
            "zero_s": zero_s,
        }

    def viewer(self) -> "RecordedViewer":
        return RecordedViewer(self._spans)


class RecordedViewer:
    def __init__(self, spans: RunSpans) -> None:
        self._replay, self._feed = ReplayClock(spans), Feed()

    async def answer(self, ask: Ask) -> Answer:
        """See `Viewer`; reads on a thread, so that other pages go on."""
        return await asyncio.to_thread(self._answer, ask)

    def _answer(self, ask: Ask) -> Answer:
        try:
            now_ns = self._replay.go_to(ask.at_s, ask.window_s)
        except RecordingError as error:
            return {"axes": [], "axis": None, "clock_s": 0.0, "silence": {"word": str(error)}}
        return self._feed.answer(self._replay.cell, ask.axis, now_ns) | {"silence": None}
