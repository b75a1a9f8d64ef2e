"""What the live diagnosis asks for, and what it says."""

import asyncio
import json
from collections.abc import Callable
from io import BytesIO, TextIOWrapper
from typing import TypeVar

import numpy as np
import pytest

from forefeel.common.error_size import Floats
from forefeel.dashboard import diagnosing, worker
from forefeel.dashboard.cell_view import CellView
from forefeel.dashboard.detector import Alarm
from forefeel.dashboard.diagnosing import Diagnosing
from forefeel.dashboard.finding import LiveDiagnosis, wanted_s, watch_card
from tests.unit.dashboard.said import AXIS, S, hear, heard, talk

R = TypeVar("R")
ALARM = Alarm(100.0, 3.2, 0.4)


def rows_with_friction(seconds: float = 20.0) -> Floats:
    """A spring, a damper and dry friction of 0.1 N, with noise of 2 mN."""
    t = np.arange(0.0, seconds, 2e-3)
    x = 0.01 * np.sin(2 * np.pi * 0.3 * t) + 0.004 * np.sin(2 * np.pi * 1.1 * t)
    v = np.gradient(x, t)
    noise = np.random.default_rng(3).normal(0.0, 2e-3, len(t))
    return np.column_stack([t + 5000.0, x, 12.0 * x + 0.6 * v + 0.1 * np.tanh(v / 1e-4) + noise])


def test_nothing_is_asked_for_while_the_model_fits_or_too_little_is_known() -> None:
    assert wanted_s(None, None, 100.0) is None
    assert wanted_s(ALARM, None, 105.0) is None
    assert wanted_s(ALARM, None, 113.5) == 12.0
    assert wanted_s(ALARM, None, 500.0) == 60.0


def test_it_is_asked_again_with_twice_as_much_until_a_cause_is_named() -> None:
    first = LiveDiagnosis(100.0, 12.0, 113.5, "Something is missing.")
    assert wanted_s(ALARM, first, 120.0) is None
    assert wanted_s(ALARM, first, 126.0) == 24.5
    assert wanted_s(Alarm(900.0, 2.5, 0.1), first, 920.0) == 18.5  # another time that it went wrong
    assert wanted_s(ALARM, LiveDiagnosis(100.0, 40.0, 141.5, "x"), 181.5) == 60.0
    assert wanted_s(ALARM, LiveDiagnosis(100.0, 12.0, 113.5, "x", ("friction",), final=True), 1e6) is None


def test_where_no_cause_is_named_each_minute_is_diagnosed_once() -> None:
    minute = LiveDiagnosis(100.0, 60.0, 300.0, "Nothing was found.")
    assert wanted_s(ALARM, minute, 300.5) is None
    assert wanted_s(ALARM, minute, 359.5) is None
    assert wanted_s(ALARM, minute, 360.0) == 60.0


def test_the_card_says_since_when_and_which_cause() -> None:
    view, now_ns = heard(3.0)
    now_s = view.timeline.now_s(now_ns)
    assert watch_card(view, None, now_ns)["word"] == "the model fits"
    assert watch_card(view, None, now_ns + 3 * S)["word"] == "nothing to judge by"
    view.watch.alarm = Alarm(now_s - 5.0, 3.2, 0.4)
    card = watch_card(view, None, now_ns)
    assert card["word"] == "the model is wrong"
    assert card["since_s"] == pytest.approx(now_ns * 1e-9 - 5.0, abs=0.06)
    assert card["signs"].startswith("errors of the model at worst 3.2 × the usual · 40 % of the forces")
    assert card["headline"] == "The cause is looked for in 8 s."
    at_work = LiveDiagnosis(now_s - 5.0, 14.0, now_s)
    assert watch_card(view, at_work, now_ns)["headline"] == "Diagnosing 14 s of data …"
    found = LiveDiagnosis(now_s - 5.0, 14.0, now_s, "The model leaves out:", ("dry friction: 0.1 N",), True)
    card = watch_card(view, found, now_ns)
    assert card["headline"] == "From 14 s: The model leaves out:"
    assert (card["level"], card["causes"]) == ("bad", ["dry friction: 0.1 N"])
    view.watch.alarm = None
    assert watch_card(view, None, now_ns, "part")["word"] == "no change in sight"
    assert watch_card(view, found, now_ns)["headline"] == "Before: The model leaves out: dry friction: 0.1 N"


def test_the_worker_names_dry_friction() -> None:
    found = worker.diagnosed(rows_with_friction())
    assert found["final"]
    assert found["headline"] == "The model leaves out:"
    causes = found["causes"]
    assert isinstance(causes, list)
    assert "friction" in causes[0]
    assert "force" in causes[0]


def test_the_worker_says_why_there_is_no_answer() -> None:
    rows = rows_with_friction(20.0)
    rows[:, 1] = 0.01
    found = worker.diagnosed(rows)
    assert found["causes"] == []
    assert "the position never changes" in str(found["headline"])


def test_worker_reads_stdin_and_answers_on_stdout(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    packed = BytesIO()
    np.save(packed, rows_with_friction()[:500])
    packed.seek(0)
    monkeypatch.setattr("sys.stdin", TextIOWrapper(packed))
    monkeypatch.setattr(worker, "die_with_parent", lambda: None)
    monkeypatch.setattr("os.nice", lambda _: 0)
    worker.main()
    assert "expected at least" in json.loads(capsys.readouterr().out)["headline"]


class Watched:
    """A cell that stands still while it is looked at."""

    def __init__(self) -> None:
        self.cell = CellView()
        self.now_ns = hear(self.cell, talk(1, 2000))

    def look(self, at: Callable[[CellView, int], R]) -> R:
        return at(self.cell, self.now_ns)


def test_a_wrong_model_is_diagnosed_once_from_what_came_since(monkeypatch: pytest.MonkeyPatch) -> None:
    watched, asked = Watched(), list[int]()

    async def answer(rows: Floats) -> diagnosing.WorkerAnswer:
        asked.append(len(rows))
        return {"headline": "It is friction.", "causes": ["dry friction"], "final": True}

    monkeypatch.setattr(diagnosing, "_ask", answer)
    monkeypatch.setattr(diagnosing, "_LOOK_S", 0.001)
    view = watched.cell.axes[AXIS]
    watched.now_ns += 20 * S
    view.watch.alarm = Alarm(view.timeline.now_s(watched.now_ns) - 14.0, 3.0, 0.1)
    found: dict[str, LiveDiagnosis] = {}

    async def for_a_while() -> None:
        task = asyncio.create_task(Diagnosing(watched.look, found).run())
        await asyncio.sleep(0.05)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(for_a_while())
    assert asked == [1700]
    assert found[AXIS].headline == "It is friction."
    assert found[AXIS].final


class Ended:
    """A worker that has ended without an answer."""

    returncode = 1

    def __init__(self, said: bytes) -> None:
        self._said = said

    async def communicate(self, _rows: bytes) -> tuple[bytes, bytes]:
        return b"", self._said


@pytest.mark.parametrize(
    ("said", "headline"),
    [
        (None, "it could not be started (No such file or directory)"),
        (b"Traceback\na library is broken\n", "a library is broken"),
        (b"", "it ended without an answer"),
    ],
)
def test_worker_that_fails_says_why(
    monkeypatch: pytest.MonkeyPatch, said: bytes | None, headline: str
) -> None:
    async def start(*_: str, **__: object) -> Ended:
        if said is None:
            raise FileNotFoundError(2, "No such file or directory")
        return Ended(said)

    monkeypatch.setattr(asyncio, "create_subprocess_exec", start)
    answer = asyncio.run(diagnosing._ask(np.zeros((3, 3))))
    assert answer == {"headline": f"The diagnosis failed: {headline}.", "causes": [], "final": False}
