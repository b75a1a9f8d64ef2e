"""Answers to one viewer: what is new since it asked last. Pure: time is an argument.

A viewer asks, draws, and asks again; so one that is slow is served less often and nothing waits for it. Of a
trace it gets the points that it does not have; of a card the newest, where it says something new.
"""

import json
from collections.abc import Callable
from typing import Any

import numpy as np

from forefeel.dashboard import panels
from forefeel.dashboard.axis_view import AxisView
from forefeel.dashboard.cell_view import CellView
from forefeel.dashboard.indicators import lights
from forefeel.dashboard.trace import Points

Answer = dict[str, Any]
_QUICK_NS = 100_000_000  # ns between two updates of a card that is watched
_SLOW_NS = 500_000_000  # ns between two updates of the other cards
_DECIMALS = 7  # digits behind the point that are sent, in s, m, N and J


class Feed:
    """Makes the answers to one viewer, and remembers what it has got."""

    def __init__(self) -> None:
        self._shown: tuple[AxisView, int] | None = None
        self._ends: dict[str, int] = {}
        self._sent: dict[str, str] = {}
        self._due_ns: dict[str, int] = {}

    def answer(self, cell: CellView, wanted: str | None, now_ns: int) -> Answer:
        """Changes since the last answer to this viewer: of the axis `wanted`, or the first if that is
        missing, the new points of its traces and the cards that changed (all of them where `anew` is true);
        always the names of the axes and the clock, without an axis only these.
        """
        axis = wanted if wanted in cell.axes else next(iter(cell.axes), None)
        answer: Answer = {"axes": list(cell.axes), "axis": axis, "clock_s": now_ns * 1e-9}
        if axis is None:
            return answer
        view = cell.axes[axis]
        answer["anew"] = self._restart(view)
        answer["now_s"] = round(view.timeline.now_s(now_ns), 4)
        answer["traces"] = {name: self._new(name, trace.since) for name, trace in view.traces.items()}
        answer["traces"]["shape"] = view.shapes.since(self._ends.get("shape", 0))
        self._ends["shape"] = view.shapes.end
        answer["cards"] = self._cards(cell, view, now_ns)
        return answer

    def _restart(self, view: AxisView) -> bool:
        """Forgets what was sent to the viewer, if the axis changed or its time began anew; True then."""
        shown = view, view.timeline.epoch
        if self._shown == shown:
            return False
        self._shown = shown
        self._ends, self._sent, self._due_ns = {}, {}, {}
        return True

    def _new(self, name: str, since: Callable[[int], Points]) -> list[list[float | None]]:
        points = since(self._ends.get(name, 0))
        self._ends[name] = points.end
        rows = np.round(points.rows, _DECIMALS).tolist()
        return [[value if value == value else None for value in row] for row in rows]  # noqa: PLR0124 - NaN

    def _cards(self, cell: CellView, view: AxisView, now_ns: int) -> Answer:
        """Makes the cards that are due; returns those that have changed since they were sent, by name."""
        made: dict[str, tuple[int, Callable[[], Any]]] = {
            "numbers": (_QUICK_NS, lambda: panels.numbers(view, now_ns)),
            "banner": (_QUICK_NS, lambda: panels.banner(view)),
            "gain": (_SLOW_NS, lambda: panels.gain(view, now_ns)),
            "standing": (_QUICK_NS, lambda: [light._asdict() for light in lights(view, now_ns)]),
            "watch": (_QUICK_NS, lambda: panels.watch(view, now_ns)),
            "energy": (_QUICK_NS, lambda: panels.energy(view, now_ns)),
            "delay": (_SLOW_NS, lambda: panels.delay(view, now_ns)),
            "model": (_SLOW_NS, lambda: panels.model(view, now_ns)),
            "loops": (_SLOW_NS, lambda: panels.loops(view, now_ns)),
            "counted": (_SLOW_NS, lambda: panels.counted(view, now_ns, cell.refused)),
            "events": (_QUICK_NS, lambda: [line._asdict() for line in reversed(list(view.events))]),
        }
        return {name: card for name, (every_ns, make) in made.items()
                for card in self._changed(name, every_ns, make, now_ns)}  # fmt: skip

    def _changed(self, name: str, every_ns: int, make: Callable[[], Any], now_ns: int) -> list[Any]:
        """Makes a card if it is due, and sets when it is due next; returns it alone in a list, or an empty
        list where it is not due or equals the one sent last.
        """
        due_ns = self._due_ns.get(name)
        # in a recording the time may go back
        if due_ns is not None and due_ns - every_ns <= now_ns < due_ns:
            return []
        self._due_ns[name] = now_ns + every_ns
        card = make()
        text = json.dumps(card)
        if self._sent.get(name) == text:
            return []
        self._sent[name] = text
        return [card]
