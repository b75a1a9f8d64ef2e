"""Has a diagnosis made while a model is wrong, one at a time, by a process of its own."""

import asyncio
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from typing import NamedTuple, TypedDict

import numpy as np

from forefeel.child_process import child_environment
from forefeel.common.error_size import Floats
from forefeel.common.events.console import printable
from forefeel.dashboard.cell_view import CellView
from forefeel.dashboard.finding import LiveDiagnosis, wanted_s

# s after which a diagnosis is given up
_TIMEOUT_S = 120.0
# s between two looks for an alarm
_LOOK_S = 0.5
_LEAST_ROWS = 200  # samples of a stretch


class Stretch(NamedTuple):
    axis: str
    since_s: float
    span_s: float
    until_s: float
    rows: Floats


class Diagnosing:
    """Looks at the cell now and then.

    Args:
        look: calls its argument with the cell, the time, and nobody else at it.
        findings: takes the last one of each axis.
    """

    def __init__(self, look: "Look", findings: dict[str, LiveDiagnosis]) -> None:
        self._look, self._findings = look, findings

    async def run(self) -> None:
        """Until it is cancelled; the process it has started then ends, too."""
        while True:
            stretch = self._look(self.next)
            if stretch is not None:
                await self._diagnose(stretch)
            await asyncio.sleep(_LOOK_S)

    def next(self, cell: CellView, now_ns: int) -> Stretch | None:
        """What is to be diagnosed now, if anything."""
        for axis, view in cell.axes.items():
            alarm, now_s = view.watch.alarm, view.timeline.now_s(now_ns)
            span_s = wanted_s(alarm, self._findings.get(axis), now_s)
            if alarm is None or span_s is None:
                continue
            rows = view.samples.rows()
            rows = rows[rows[:, 0] > rows[-1, 0] - span_s] if len(rows) else rows
            if len(rows) >= _LEAST_ROWS:
                return Stretch(axis, alarm.since_s, span_s, now_s, rows)
        return None

    async def _diagnose(self, stretch: Stretch) -> None:
        at_work = LiveDiagnosis(stretch.since_s, stretch.span_s, stretch.until_s)
        self._findings[stretch.axis] = at_work
        said = await _ask(stretch.rows)
        if self._findings.get(stretch.axis) is at_work:  # else another run has begun
            self._findings[stretch.axis] = replace(
                at_work, headline=said["headline"], causes=tuple(said["causes"]), final=said["final"]
            )


Look = Callable[[Callable[[CellView, int], Stretch | None]], Stretch | None]


class WorkerAnswer(TypedDict):
    headline: str
    causes: list[str]
    final: bool


async def _ask(rows: Floats) -> WorkerAnswer:
    """The worker's answer, or why there is none."""
    packed = BytesIO()
    np.save(packed, rows, allow_pickle=False)
    try:
        process = await _worker()
    except OSError as error:
        return _failed(f"it could not be started ({error.strerror})")
    try:
        out, said = await asyncio.wait_for(process.communicate(packed.getvalue()), _TIMEOUT_S)
    except TimeoutError:
        return _failed(f"no answer within {_TIMEOUT_S:g} s")
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    try:
        answer: WorkerAnswer = json.loads(out)
    except ValueError:
        last = said.decode(errors="replace").strip().rpartition("\n")[2]
        return _failed(printable(last) or "it ended without an answer")
    return answer


async def _worker() -> asyncio.subprocess.Process:
    return await asyncio.create_subprocess_exec(
        sys.executable, "-m", "forefeel.dashboard.worker",
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        start_new_session=True,
        env=child_environment(),
    )  # fmt: skip


def _failed(why: str) -> WorkerAnswer:
    return {"headline": f"The diagnosis failed: {why}.", "causes": [], "final": False}
