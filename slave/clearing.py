"""Clearing of latched stops and faults: a local act, for all that hang together in one tick."""

from collections.abc import Sequence
from concurrent.futures import Future
from typing import NamedTuple

from forefeel.slave.axis import SlaveAxis

FOLLOWS = "axis {} is halted"
"""Why an axis stops with another one."""


class Clearing(NamedTuple):
    """What became of one axis: what was latched, and why it still is; empty when it is not any more."""

    axis: str
    was: str
    still: str


class ClearRequest:
    """Asked on asyncio, heeded by the control loop at its next tick; `done` has the result then.

    Who cancels `done` before that tick has nothing cleared.
    """

    def __init__(self, axis: str | None) -> None:
        self.done: Future[list[Clearing]] = Future()
        self._axis = axis
        self._was: list[tuple[SlaveAxis, str]] = []

    def begin(self, axes: Sequence[SlaveAxis]) -> bool:
        """Before the axes' ticks; whether it is still wanted, and `end` is to follow."""
        if not self.done.set_running_or_notify_cancel():
            return False
        chosen = [axis for axis in axes if axis.halted and self._means(axis)]
        self._was = [(axis, f"{axis.state.value}: {axis.reason}") for axis in chosen]
        for axis in chosen:
            axis.clear()
        return True

    def end(self) -> None:
        self.done.set_result(
            [Clearing(axis.name, was, axis.reason if axis.halted else "") for axis, was in self._was]
        )

    def _means(self, axis: SlaveAxis) -> bool:
        """Whether it is asked to clear that axis: one that is named takes those with it that follow it."""
        return self._axis in (None, axis.name) or axis.reason == FOLLOWS.format(self._axis)
