"""The control socket of a daemon: emergency stop and clear, for the daemon's own user and root.

It receives datagrams of JSON, so that it answers when every descriptor is taken.
"""

import asyncio
import json
import os
import socket
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Self

from pydantic import ConfigDict, TypeAdapter, ValidationError

from forefeel.common.clock import Clock
from forefeel.common.errors import ConfigurationError
from forefeel.common.events.sink import EventSink
from forefeel.common.messages import SafetyState
from forefeel.common.state.folder import SOCKET
from forefeel.estop.client import LONGEST_TEXT, Answer, Request, socket_path

if TYPE_CHECKING:
    from forefeel.master.daemon import MasterDaemon
    from forefeel.slave.daemon import Clearing, SlaveDaemon

_LONGEST_REQUEST = 8192  # bytes: two of the longest texts, each character escaped in 12 bytes, take 6144
_BY = "control socket"  # asker in the event log: root or the daemon's own user
_REQUEST = TypeAdapter(Request, config=ConfigDict(strict=True, str_max_length=LONGEST_TEXT))
_POLL_S = 0.01
_STOPS_S = 1.0  # bounds the wait for a stop to show. A master needs a round trip, by default of at most 0.7 s
_TICK_S = 1.0  # bounds the wait for the tick that clears
_DISK_S = 2.0  # bounds the wait for a clearing on the disk: a busy one was seen to take half a second
_LASTS_S = 0.5  # A cause that lasts shows within this: a blind load cell takes 0.2 s, a silent drive 50 ms

Act = Callable[[Request], Awaitable[Answer]]


class ControlSocket:
    """Socket of a daemon while entered; requests before `serving` wait for it.

    So a stop that is asked for while a daemon starts is the first that it heeds.

    Raises:
        ConfigurationError: the socket can not be made.
    """

    def __init__(self, folder: Path, role: str) -> None:
        self._path, self._role = folder / SOCKET, role
        self._requests: set[asyncio.Task[None]] = set()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            self._path.unlink(missing_ok=True)  # of a daemon that was killed: we hold the folder's lock
            descriptor, path = socket_path(folder)
            mask = os.umask(0o177)
            try:
                self._socket.bind(path)
            finally:
                os.umask(mask)
                os.close(descriptor)
            self._socket.setblocking(False)
        except OSError as error:
            self._socket.close()
            raise ConfigurationError(f"{self._path}: {error.strerror}; expected a socket") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
        with suppress(OSError):
            self._path.unlink()

    @asynccontextmanager
    async def serving(self, act: Act) -> AsyncIterator[None]:
        """Answers requests on the open socket by `act` while entered, several at a time; at the end cancels
        the unanswered and leaves the socket open.
        """
        loop = asyncio.get_running_loop()
        loop.add_reader(self._socket, self._receive, act)
        try:
            yield
        finally:
            loop.remove_reader(self._socket)
            for request in list(self._requests):
                request.cancel()
            await asyncio.gather(*self._requests, return_exceptions=True)

    def _receive(self, act: Act) -> None:
        """Reads one datagram and starts a task that answers it, kept in `_requests` until it is done; returns
        at once when there is none.
        """
        try:
            data, asker = self._socket.recvfrom(_LONGEST_REQUEST)
        except BlockingIOError:
            return
        task = asyncio.create_task(self._reply(act, data, asker), name="control request")
        self._requests.add(task)
        task.add_done_callback(self._requests.discard)

    async def _reply(self, act: Act, data: bytes, asker: str | bytes) -> None:
        """Validates the request, awaits `act` and sends its answer to the asker as JSON; for a malformed
        request an answer with `done` False that says why. An error of sending is ignored.
        """
        try:
            answer = await act(_REQUEST.validate_json(data))
        except ValidationError as error:
            why = f"not understood: {error.errors(include_url=False)[0]['msg']}"
            answer = Answer(False, (why,), self._role)
        with suppress(OSError):  # it has gone, or does not read
            self._socket.sendto(json.dumps(answer._asdict()).encode(), asker)


class SlaveRequests:
    """Answers requests at the slave: a stop, and a clearing, which is logged."""

    def __init__(self, daemon: "SlaveDaemon", event_sink: EventSink, clock: Clock) -> None:
        self._daemon, self._event_sink, self._clock = daemon, event_sink, clock

    async def __call__(self, request: Request) -> Answer:
        if request.do == "clear":
            return await self._clear(request.axis)
        for axis in self._daemon.axes:
            axis.emergency_stop(request.reason or "local stop", _BY)
        return self._answer(await _until(_STOPS_S, self._stopped), *self._lines())

    async def _clear(self, name: str | None) -> Answer:
        """Clears what is latched at the axis `name`, or at all (None), and notes it in the event log; the
        Answer tells what was cleared and what not. Not done: no such axis, no tick that clears, any axis of
        the daemon that is halted within 0.5 s after, or a latch that is not removed from the disk within 2 s,
        which would stop the axis again at the next start. Done, and not noted, if no axis was latched.
        """
        axes = self._daemon.axes
        names = [axis.name for axis in axes]
        if name is not None and name not in names:
            return self._answer(False, f"no axis {name!r}; expected one of {', '.join(names)}")
        if not any(axis.halted for axis in axes):
            return self._answer(True, "nothing is latched", *self._lines())
        cleared = await self._clear_in_tick(name)
        if isinstance(cleared, str):
            return self._logged(False, cleared)
        await _until(_LASTS_S, lambda: any(axis.halted for axis in axes))
        await _until(_DISK_S, lambda: not self._unwritten())
        still = {axis.name: axis.reason for axis in axes if axis.halted}
        lines = [f"axis {entry.axis}: cleared {entry.was}" for entry in cleared if entry.axis not in still]
        lines += [f"axis {axis}: not cleared, the cause persists: {reason}" for axis, reason in still.items()]
        unwritten = [
            f"axis {axis}: the clearing is not on the disk: latched again after a new start"
            for axis in self._unwritten()
        ]
        return self._logged(not (still or unwritten), *lines, *unwritten)

    async def _clear_in_tick(self, name: str | None) -> "Sequence[Clearing] | str":
        """Asks the next tick to clear the axis `name`, or all (None), and waits 1 s at most; returns its
        result for each axis, or a line of text: the tick hangs, so that nothing is known, or it never came
        and nothing is cleared.
        """
        asked = self._daemon.clear(name)
        try:
            await asyncio.wait([asyncio.wrap_future(asked)], timeout=_TICK_S)
        finally:  # also when the asker is gone: nothing is cleared that nobody is told of
            asked.cancel()
        if asked.running():
            return "perhaps cleared: the control loop hangs in the tick that clears; start the slave again"
        if asked.cancelled():
            return "not cleared: the control loop does not run any more; start the slave again"
        return asked.result()

    def _unwritten(self) -> list[str]:
        """Axes that a new start would find latched, though they are cleared."""
        return [axis.name for axis in self._daemon.axes if not (axis.halted or axis.latch_persisted)]

    def _logged(self, done: bool, *text: str) -> Answer:
        self._event_sink.note("clear", self._clock.now_ns(), by=_BY, cleared=done, result=list(text))
        return self._answer(done, *text)

    def _stopped(self) -> bool:
        """True when every axis is stopped, and would be after a new start."""
        return all(axis.state is SafetyState.ESTOPPED and axis.latch_persisted for axis in self._daemon.axes)

    def _lines(self) -> list[str]:
        """Lines with state and reason, one for each axis; with a warning where that is not on the disk."""
        lost = f"; NOT KEPT OVER A NEW START: {self._event_sink.problem or 'it is not written yet'}"
        return [
            f"axis {axis.name}: {axis.state.value}, {axis.reason}{'' if axis.latch_persisted else lost}"
            for axis in self._daemon.axes
        ]

    def _answer(self, done: bool, *text: str) -> Answer:
        return Answer(done, text, "slave")


class MasterRequests:
    """Answers requests at the master: a stop, which it hands on."""

    def __init__(self, daemon: "MasterDaemon", clock: Clock) -> None:
        self._daemon, self._clock = daemon, clock

    async def __call__(self, request: Request) -> Answer:
        axes = self._daemon.axes
        if request.do == "clear":
            text = "a master clears nothing; expected `forefeel clear` on the slave's host"
            return Answer(False, (text,), "master")
        for axis in axes:
            axis.emergency_stop(request.reason or "the operator's stop", self._clock.now_ns(), _BY)
        done = await _until(_STOPS_S, lambda: not any(axis.stop.wanted for axis in axes))
        return Answer(done, tuple(self._lines()), "master")

    def _lines(self) -> list[str]:
        """Lines with the state and reason of the slave, one for each axis; where none was received, `not
        heard` and why it has no session.
        """
        lines = []
        for axis in self._daemon.axes:
            slave, cause = axis.slave_state, axis.session.cause(self._clock.now_ns())
            state, reason = (slave.state.value, slave.reason) if slave else ("not heard", cause)
            lines.append(f"axis {axis.name}: {state}, {reason}")
        return lines


async def _until(timeout_s: float, condition: Callable[[], bool]) -> bool:
    for _ in range(int(timeout_s / _POLL_S)):
        if condition():
            return True
        await asyncio.sleep(_POLL_S)
    return condition()
