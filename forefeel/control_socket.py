"""The control socket of a daemon: state, emergency stop and clear, for the daemon's own user and root.

It receives datagrams of JSON, so that it needs no descriptor for who asks and answers when all are taken.
"""

import asyncio
import json
import os
import socket
import struct
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
from forefeel.local.client import LONGEST_TEXT, Answer, Request, socket_path

if TYPE_CHECKING:
    from forefeel.master.daemon import MasterDaemon
    from forefeel.slave.clearing import Clearing
    from forefeel.slave.daemon import SlaveDaemon

_LONGEST_REQUEST = 8192
"""Bytes: two of the longest texts, each character escaped in 12 bytes, take 6144."""
_AT_ONCE = 8  # requests that are answered at once
_CREDENTIALS = struct.Struct("3i")
"""struct ucred of unix(7): process, user, group."""
_NOBODY = 65534  # user id that the kernel gives for unknown ones (/proc/sys/kernel/overflowuid)
_REQUEST = TypeAdapter(Request, config=ConfigDict(strict=True, str_max_length=LONGEST_TEXT))
_POLL_S = 0.01
_STOPS_S = 1.0
"""Bounds the wait for a stop to show. A master needs a round trip, by default of at most 0.7 s."""
_TICK_S = 1.0  # bounds the wait for the tick that clears
_DISK_S = 2.0  # bounds the wait for a clearing on the disk: a busy one was seen to take half a second
_LASTS_S = 0.5
"""A cause that lasts shows within this: a blind load cell takes 0.2 s, a silent drive 50 ms."""

Act = Callable[[Request, str], Awaitable[Answer]]
"""Does what is asked for; who asks."""


class ControlSocket:
    """The socket is there while this is entered; requests before `serving` wait for it.

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
            try:
                self._socket.bind(path)
                Path(path).chmod(0o600)
            finally:
                os.close(descriptor)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
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
        try:
            data, ancillary, _, asker = self._socket.recvmsg(
                _LONGEST_REQUEST + 1, socket.CMSG_SPACE(_CREDENTIALS.size)
            )
        except BlockingIOError:
            return
        task = asyncio.create_task(self._reply(act, data, _user(ancillary), asker), name="control request")
        self._requests.add(task)
        task.add_done_callback(self._requests.discard)

    async def _reply(self, act: Act, data: bytes, uid: int, asker: str | bytes) -> None:
        answer = await self.answer(act, data, uid)
        with suppress(OSError):  # it has gone, or does not read
            self._socket.sendto(json.dumps(answer._asdict()).encode(), asker)

    async def answer(self, act: Act, data: bytes, uid: int) -> Answer:
        """Checks a request of that user, and does what it asks for."""
        if uid not in (0, os.geteuid()):
            return self._refused(f"user {uid} may not: only root and the daemon's own user")
        if len(self._requests) > _AT_ONCE:
            return self._refused(f"{_AT_ONCE} others are speaking")
        if len(data) > _LONGEST_REQUEST:
            return self._refused(f"not understood: more than {_LONGEST_REQUEST} bytes")
        try:
            request = _REQUEST.validate_json(data)
        except ValidationError as error:
            return self._refused(f"not understood: {error.errors(include_url=False)[0]['msg']}")
        return await act(request, f"uid {uid}")

    def _refused(self, why: str) -> Answer:
        return Answer(False, (why,), self._role)


def _user(ancillary: Sequence[tuple[int, int, bytes]]) -> int:
    """The user who sent it, as the kernel knows it."""
    for level, kind, raw in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, socket.SCM_CREDENTIALS):
            return int(_CREDENTIALS.unpack(raw)[1])
    return _NOBODY


class SlaveRequests:
    """Answers requests at the slave: state, stop, clear."""

    def __init__(self, daemon: "SlaveDaemon", event_sink: EventSink, clock: Clock) -> None:
        self._daemon, self._event_sink, self._clock = daemon, event_sink, clock

    async def __call__(self, request: Request, by: str) -> Answer:
        match request.do:
            case "estop":
                for axis in self._daemon.axes:
                    axis.emergency_stop(request.reason or "local stop", by)
                return self._answer(await _until(_STOPS_S, self._stopped), *self._lines())
            case "clear":
                return await self._clear(request.axis, by)
            case _:
                return self._answer(True, *self._lines())

    async def _clear(self, name: str | None, by: str) -> Answer:
        axes = self._daemon.axes
        names = [axis.name for axis in axes]
        if name is not None and name not in names:
            return self._answer(False, f"no axis {name!r}; expected one of {', '.join(names)}")
        if not any(axis.halted for axis in axes):
            return self._answer(True, "nothing is latched", *self._lines())
        cleared = await self._cleared(name)
        if isinstance(cleared, str):
            return self._logged(by, False, cleared)
        await _until(_LASTS_S, lambda: any(axis.halted for axis in axes))
        await _until(_DISK_S, lambda: not self._unwritten())
        still = {axis.name: axis.reason for axis in axes if axis.halted}
        lines = [f"axis {each.axis}: cleared {each.was}" for each in cleared if each.axis not in still]
        lines += [f"axis {axis}: not cleared, the cause persists: {reason}" for axis, reason in still.items()]
        unwritten = [
            f"axis {axis}: the clearing is not on the disk: latched again after a new start"
            for axis in self._unwritten()
        ]
        return self._logged(by, not (still or unwritten), *lines, *unwritten)

    async def _cleared(self, name: str | None) -> "Sequence[Clearing] | str":
        """What the next tick cleared, or why that is not known."""
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

    def _logged(self, by: str, done: bool, *text: str) -> Answer:
        self._event_sink.note("clear", self._clock.now_ns(), by=by, cleared=done, result=list(text))
        return self._answer(done, *text)

    def _stopped(self) -> bool:
        """Whether every axis is, and a new start would find it so."""
        return all(axis.state is SafetyState.ESTOPPED and axis.latch_persisted for axis in self._daemon.axes)

    def _lines(self) -> list[str]:
        lost = f"; NOT KEPT OVER A NEW START: {self._event_sink.problem or 'it is not written yet'}"
        return [
            f"axis {axis.name}: {axis.state.value}, {axis.reason}{'' if axis.latch_persisted else lost}"
            for axis in self._daemon.axes
        ]

    def _answer(self, done: bool, *text: str) -> Answer:
        return Answer(done, text, "slave")


class MasterRequests:
    """Answers requests at the master: state, and a stop that it hands on."""

    def __init__(self, daemon: "MasterDaemon", clock: Clock) -> None:
        self._daemon, self._clock = daemon, clock

    async def __call__(self, request: Request, by: str) -> Answer:
        done, axes = True, self._daemon.axes
        if request.do == "clear":
            text = "a master clears nothing; expected `forefeel clear` on the slave's host"
            return Answer(False, (text,), "master")
        if request.do == "estop":
            for axis in axes:
                axis.emergency_stop(request.reason or "the operator's stop", self._clock.now_ns(), by)
            done = await _until(_STOPS_S, lambda: not any(axis.stop.wanted for axis in axes))
        return Answer(done, tuple(self._lines()), "master")

    def _lines(self) -> list[str]:
        found = []
        for axis in self._daemon.axes:
            slave, cause = axis.slave_state, axis.session.cause(self._clock.now_ns())
            state, reason = (slave.state.value, slave.reason) if slave else ("not heard", cause)
            found.append(f"axis {axis.name}: {state}, {reason}")
        return found


async def _until(timeout_s: float, condition: Callable[[], bool]) -> bool:
    for _ in range(int(timeout_s / _POLL_S)):
        if condition():
            return True
        await asyncio.sleep(_POLL_S)
    return condition()
