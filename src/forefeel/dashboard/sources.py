"""Sources of the page: a live cell, or a recording of one."""

import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from forefeel.common.clock import Clock
from forefeel.common.errors import RecordingError
from forefeel.common.events.text import span
from forefeel.common.recording.mcap_spans import RunSpans
from forefeel.common.topics import BY_NAME, COMMAND
from forefeel.dashboard.cell_view import UNREAD, CellView
from forefeel.dashboard.feed import Answer, Feed
from forefeel.dashboard.trace import SPAN_S

_SILENT_NS = 2_000_000_000  # after which a cell counts as silent
LEAD_S = 20.0  # s that are read of a recording before the place asked for
_TOPICS = [topic for name, topic in BY_NAME.items() if name not in UNREAD]


class Ask(BaseModel):
    """Request of a page: an axis; of a recording a time in s, and the length of the span shown before it."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    axis: Annotated[str, Field(max_length=256)] | None = None
    at_s: Annotated[float, Field(ge=0.0, le=1e7)] = 0.0
    window_s: Annotated[float, Field(ge=1.0, le=SPAN_S)] = SPAN_S


Viewer = Callable[[Ask], Answer]


def nothing(now_ns: int, why: str) -> Answer:
    """Answer without an axis, and the reason."""
    return {"axes": [], "axis": None, "clock_s": now_ns * 1e-9, "silence": {"word": why}}


class LiveCell:
    """A live cell. Messages come in one thread, pages ask in another.

    Args:
        name: of the cell.
        where: endpoints in words.
    """

    def __init__(self, name: str, where: str, clock: Clock) -> None:
        self._name, self._where, self._clock = name, where, clock
        self._lock = threading.Lock()
        self._cause = ""  # why nothing was heard yet
        self.begin()

    def begin(self, waits: str = "") -> None:
        """Forgets what was heard, for another run of the cell; `waits`, if any, is shown in its place."""
        with self._lock:
            self._waits, self._cell, self._since_ns = waits, CellView(), self._clock.now_ns()

    def hear(self, key: str, payload: bytes, receive_ns: int) -> None:
        with self._lock:
            self._cell.hear(key, payload, receive_ns)

    def update_cause(self, watch: Callable[[bool], str]) -> None:
        self._cause = watch(self._cell.heard_ns is not None)

    def facts(self) -> dict[str, Any]:
        return {"cell": self._name, "file": None}

    def viewer(self) -> Viewer:
        """Makes a function that answers one page with what is new to it in the cell, and with data on the
        cell's silence, if it is silent; while the cell waits, only with the text of that.
        """
        feed = Feed()

        def answer(ask: Ask) -> Answer:
            with self._lock:
                now_ns = self._clock.now_ns()
                if self._waits:
                    return nothing(now_ns, self._waits)
                return feed.answer(self._cell, ask.axis, now_ns) | {"silence": self._silence(now_ns)}

        return answer

    def _silence(self, now_ns: int) -> dict[str, Any] | None:
        """Data for the page on a cell that was not heard yet, or not for more than 2 s: word, length, begin,
        endpoints with the cause; None while something is heard.
        """
        heard_ns = self._cell.heard_ns
        quiet_ns = now_ns - (self._since_ns if heard_ns is None else heard_ns)
        if heard_ns is not None and quiet_ns <= _SILENT_NS:
            return None
        waits = f"Waits for master and slave of cell {self._name}"
        return {
            "word": waits if heard_ns is None else f"Cell {self._name}: silent",
            "for": span(quiet_ns * 1e-9),
            "since_s": round((now_ns - quiet_ns) * 1e-9, 1),
            "where": f"{self._where}; {self._cause}" if self._cause else self._where,
        }


class Recorded:
    """A recording, for any number of viewers, each at its own time."""

    def __init__(self, path: Path) -> None:
        self._spans, self._first_s = RunSpans(path), 0.0  # s, the first command
        self.metadata = self._spans.metadata
        start_ns = self._spans.start_ns
        commands = self._spans.between(start_ns, start_ns + round(LEAD_S * 1e9), [COMMAND])
        with suppress(RecordingError):  # damaged there: the page says it
            self._first_s = (next((command.log_ns for command in commands), start_ns) - start_ns) * 1e-9

    def facts(self) -> dict[str, Any]:
        spans = self._spans
        duration_s, zero_s = (spans.end_ns - spans.start_ns) * 1e-9, spans.start_ns * 1e-9
        return {"cell": spans.cell, "file": spans.path.name, "duration_s": duration_s, "zero_s": zero_s,
                "first_s": self._first_s}  # fmt: skip

    def viewer(self) -> Viewer:
        """Makes a function that answers one page from its own place in the recording. At a damaged place the
        answer has no data but the error's text; nothing is raised.
        """
        replay, feed = ReplayClock(self._spans), Feed()

        def answer(ask: Ask) -> Answer:
            try:
                now_ns = replay.go_to(ask.at_s, ask.window_s)
            except RecordingError as error:
                return nothing(0, str(error))
            return feed.answer(replay.cell, ask.axis, now_ns) | {"silence": None}

        return answer


class ReplayClock:
    """One viewer's place in a recording. A time a little later than the last is read on from there.

    Any other is read from `LEAD_S` before it, so that traces, states and the usual size of errors are known.
    """

    def __init__(self, spans: RunSpans) -> None:
        self.cell = CellView()
        self._spans = spans
        self._until_ns: int | None = None

    def go_to(self, at_s: float, window_s: float) -> int:
        """Brings `cell` to its state at `at_s` of the recording, or at its nearest end; returns that time in
        ns. After a jump back, or far ahead, `cell` is a new one that has only the messages of the `window_s`
        before that time, or of `LEAD_S` if those are more.

        Raises:
            RecordingError: the file is damaged there.
        """
        start_ns, length_ns = self._spans.start_ns, self._spans.end_ns - self._spans.start_ns + 1
        until_ns = start_ns + round(min(max(at_s, 0.0) * 1e9, length_ns))
        lead_ns = round(max(LEAD_S, window_s) * 1e9)
        from_ns = self._until_ns
        if from_ns is None or not from_ns <= until_ns <= from_ns + lead_ns:
            from_ns = until_ns - lead_ns
            self.cell = CellView()
        self._until_ns = None  # where the file is damaged the cell stays half read: the next one begins anew
        for logged in self._spans.between(from_ns, until_ns, _TOPICS):
            self.cell.take(logged.axis, logged.topic, logged.message, logged.log_ns)
        self._until_ns = until_ns
        return until_ns
