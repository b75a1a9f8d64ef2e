"""What a daemon does for its local socket."""

import asyncio
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from forefeel.common.clock import Clock
from forefeel.common.events.sink import EventSink
from forefeel.common.messages import SafetyState
from forefeel.local.protocol import Answer, Request

if TYPE_CHECKING:
    from forefeel.master.daemon import MasterDaemon
    from forefeel.slave.clearing import Clearing
    from forefeel.slave.daemon import SlaveDaemon

# s between two looks while something is waited for; chosen, not measured: shorter costs processor time
_POLL_S = 0.01
# s that the answer waits for the stop to show; chosen, not measured: a master needs a round trip, by default
# of at most 0.7 s
_STOPS_S = 1.0
# s that the answer waits for a tick to clear; chosen, not measured: a loop that lives ticks every ms
_TICK_S = 1.0
# s that a clearing may take to the disk: a busy one was seen to take more than half a second
_DISK_S = 2.0
_LASTS_S = 0.5
"""A cause that lasts shows within this: a blind load cell takes 0.2 s, a silent drive 50 ms."""
_ENDED = "not cleared: the control loop does not run any more; start the slave again"
_HANGS = "perhaps cleared: the control loop hangs in the tick that clears; start the slave again"


class SlaveHandlers:
    """Of the slave: state, stop, clear."""

    def __init__(self, daemon: "SlaveDaemon", event_sink: EventSink, clock: Clock) -> None:
        self._daemon, self._event_sink, self._clock = daemon, event_sink, clock

    async def __call__(self, request: Request, by: str) -> Answer:
        """Does what is asked for."""
        match request.do:
            case "estop":
                return await self._stop(request.reason or "local stop", by)
            case "clear":
                return await self._clear(request.axis, by)
            case _:
                return self._answer(True, *self._lines())

    async def _stop(self, reason: str, by: str) -> Answer:
        for axis in self._daemon.axes:
            axis.emergency_stop(reason, by)
        done = await _until(_STOPS_S, self._stopped)
        return self._answer(done, *self._lines())

    async def _clear(self, name: str | None, by: str) -> Answer:
        names = [axis.name for axis in self._daemon.axes]
        if name is not None and name not in names:
            return self._answer(False, f"no axis {name!r}; expected one of {', '.join(names)}")
        if not any(axis.halted for axis in self._daemon.axes):
            return self._answer(True, "nothing is latched", *self._lines())
        cleared = await self._cleared(name)
        if isinstance(cleared, str):
            return self._noted(by, False, cleared)
        await _until(_LASTS_S, lambda: any(axis.halted for axis in self._daemon.axes))
        await _until(_DISK_S, lambda: not self._unwritten())
        unkept = [
            f"axis {name}: the clearing is not on the disk: latched again after a new start"
            for name in self._unwritten()
        ]
        still = {axis.name: axis.reason for axis in self._daemon.axes if axis.halted}
        said = [f"axis {each.axis}: cleared {each.was}" for each in cleared if each.axis not in still]
        said += [f"axis {axis}: not cleared, the cause persists: {reason}" for axis, reason in still.items()]
        return self._noted(by, not (still or unkept), *said, *unkept)

    async def _cleared(self, name: str | None) -> "Sequence[Clearing] | str":
        """What a tick made of the wish, or why it is not known; what none has heeded in time, none will."""
        asked = self._daemon.clear(name)
        try:
            await asyncio.wait([asyncio.wrap_future(asked)], timeout=_TICK_S)
        finally:  # also when the asker is gone: nothing is cleared that nobody is told of
            asked.cancel()
        if asked.running():
            return _HANGS
        return _ENDED if asked.cancelled() else asked.result()

    def _unwritten(self) -> list[str]:
        """Axes that a new start would find latched, though they are cleared."""
        return [axis.name for axis in self._daemon.axes if not (axis.halted or axis.latch_persisted)]

    def _noted(self, by: str, done: bool, *text: str) -> Answer:
        self._event_sink.note("clear", self._clock.now_ns(), by=by, cleared=done, result=list(text))
        return self._answer(done, *text)

    def _stopped(self) -> bool:
        """Whether every axis is, and a new start would find it so."""
        return all(axis.state is SafetyState.ESTOPPED and axis.latch_persisted for axis in self._daemon.axes)

    def _lines(self) -> list[str]:
        lost = self._event_sink.problem or "it is not written yet"
        return [
            _line(axis.name, axis.state.value, axis.reason)
            + ("" if axis.latch_persisted else f"; NOT KEPT OVER A NEW START: {lost}")
            for axis in self._daemon.axes
        ]

    def _answer(self, done: bool, *text: str) -> Answer:
        return Answer(done, text, "slave")


class MasterHandlers:
    """Of the master: state, and a stop that it hands on."""

    def __init__(self, daemon: "MasterDaemon", clock: Clock) -> None:
        self._daemon, self._clock = daemon, clock

    async def __call__(self, request: Request, by: str) -> Answer:
        """Does what is asked for."""
        if request.do == "clear":
            return self._answer(
                False, "a master clears nothing; expected `forefeel clear` on the slave's host"
            )
        if request.do == "state":
            return self._answer(True, *self._lines())
        for axis in self._daemon.axes:
            axis.emergency_stop(request.reason or "the operator's stop", self._clock.now_ns(), by)
        done = await _until(_STOPS_S, lambda: not any(axis.stop.wanted for axis in self._daemon.axes))
        return self._answer(done, *self._lines())

    def _lines(self) -> list[str]:
        found = []
        for axis in self._daemon.axes:
            heard = axis.slave_state
            cause = axis.session.cause(self._clock.now_ns())
            state, reason = (heard.state.value, heard.reason) if heard else ("not heard", cause)
            found.append(_line(axis.name, state, reason))
        return found

    def _answer(self, done: bool, *text: str) -> Answer:
        return Answer(done, text, "master")


def _line(axis: str, state: str, reason: str) -> str:
    return f"axis {axis}: {state}, {reason}"


async def _until(timeout_s: float, condition: Callable[[], bool]) -> bool:
    """Whether it became true in time."""
    for _ in range(int(timeout_s / _POLL_S)):
        if condition():
            return True
        await asyncio.sleep(_POLL_S)
    return condition()
