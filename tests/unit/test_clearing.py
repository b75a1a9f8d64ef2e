"""A clearing that nobody waits for any more clears nothing; everybody who waits is told the truth."""

import asyncio
from concurrent.futures import Future

import pytest

from forefeel.common.messages import SafetyState
from forefeel.local import handlers
from forefeel.local.handlers import SlaveHandlers
from forefeel.local.protocol import Answer, Request
from forefeel.slave.clearing import Clearing
from tests.unit.failing import refusing
from tests.unit.slave_cell import Cell

STOPPED, IDLE = SafetyState.ESTOPPED, SafetyState.IDLE


@pytest.fixture(name="cell")
def stopped_cell(monkeypatch: pytest.MonkeyPatch) -> Cell:
    monkeypatch.setattr(handlers, "_TICK_S", 0.02)
    monkeypatch.setattr(handlers, "_LASTS_S", 0.0)
    cell = Cell()
    cell.daemon.axes[0].emergency_stop("pressed")
    cell.step()
    assert cell.states() == [STOPPED, STOPPED]
    return cell


def clear(cell: Cell, axis: str | None = None) -> "asyncio.Task[Answer]":
    acting = SlaveHandlers(cell.daemon, cell.book, cell.runtime.clock)
    return asyncio.create_task(acting(Request(do="clear", axis=axis), "nurse"))


def test_a_clearing_that_came_too_late_is_none_and_the_control_loop_goes_on(cell: Cell) -> None:
    async def ask_while_the_loop_stands() -> Answer:
        return await clear(cell)

    answer = asyncio.run(ask_while_the_loop_stands())
    assert not answer.done and answer.text[0].startswith("not cleared: the control loop does not run")
    cell.step()
    assert cell.states() == [STOPPED, STOPPED]
    cell.clear()
    assert cell.states() == [IDLE, IDLE]


def test_who_is_gone_before_the_tick_has_nothing_cleared(cell: Cell) -> None:
    async def ask_and_go() -> None:
        task = clear(cell)
        await asyncio.sleep(0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    asyncio.run(ask_and_go())
    cell.step()
    assert cell.states() == [STOPPED, STOPPED]


def test_of_a_tick_that_hangs_nobody_says_that_it_cleared_nothing(
    cell: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = Future[list[Clearing]]()
    begun.set_running_or_notify_cancel()
    monkeypatch.setattr(cell.daemon, "clear", lambda _: begun)

    async def ask() -> Answer:
        return await clear(cell)

    answer = asyncio.run(ask())
    assert not answer.done and answer.text[0].startswith("perhaps cleared: the control loop hangs")


def test_a_clearing_in_the_last_tick_is_answered_by_what_it_did(
    cell: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cell.daemon.axes[1], "tick", refusing(ZeroDivisionError("torn")))
    asked = cell.daemon.clear()
    with pytest.raises(ZeroDivisionError):
        cell.step(1)
    assert [each.still for each in asked.result(0)] == ["", "axis insertion is halted"]


def test_two_clearings_between_two_ticks_are_both_heeded(cell: Cell) -> None:
    first, second = cell.daemon.clear("rotation"), cell.daemon.clear("insertion")
    cell.step(1)
    assert [each.axis for each in first.result(0)] == ["rotation"]
    assert second.result(0) == [
        Clearing("insertion", "estopped: pressed", ""),
        Clearing("rotation", "estopped: axis insertion is halted", ""),
    ]
    assert cell.states() == [IDLE, IDLE]


def test_two_people_who_clear_at_once_are_both_told_so(cell: Cell) -> None:
    async def ask_twice() -> list[Answer]:
        asked = [clear(cell), clear(cell)]
        await asyncio.sleep(0)
        cell.step(1)
        return await asyncio.gather(*asked)

    answers = asyncio.run(ask_twice())
    cleared = "axis insertion: cleared estopped: pressed"
    assert [(answer.done, answer.text[0]) for answer in answers] == [(True, cleared)] * 2
    assert [noted["cleared"] for noted in cell.book.of("clear")] == [True, True]
