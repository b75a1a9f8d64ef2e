"""The local socket of a daemon, on asyncio: for the same user and root, a few at a time, a datagram each.

It needs no descriptor for who asks, so that it answers when all are taken.
"""

import asyncio
import json
import os
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Self

from pydantic import ConfigDict, TypeAdapter, ValidationError

from forefeel.common.errors import ConfigurationError
from forefeel.common.state.folder import SOCKET
from forefeel.local.protocol import LONGEST_DATAGRAM, LONGEST_TEXT, Answer, Request, received, socket_path

_AT_ONCE = 8  # requests that are answered at once; chosen, not measured: further ones are refused
_REQUEST = TypeAdapter(Request, config=ConfigDict(strict=True, str_max_length=LONGEST_TEXT))
Act = Callable[[Request, str], Awaitable[Answer]]
"""Does what is asked for; who asks."""


class LocalServer:
    """The socket is there while this is entered; what comes before `serving` waits for it.

    So a stop that is asked for while a daemon starts is the first that it heeds.

    Raises:
        ConfigurationError: the socket can not be made.
    """

    def __init__(self, folder: Path, role: str) -> None:
        self._folder, self._role = folder, role
        self._talks: set[asyncio.Task[None]] = set()
        self._socket = self._bound()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
        with suppress(OSError):
            (self._folder / SOCKET).unlink()

    @asynccontextmanager
    async def serving(self, act: Act) -> AsyncIterator[None]:
        """Answers with `act` meanwhile."""
        loop = asyncio.get_running_loop()
        loop.add_reader(self._socket, self._receive, act)
        try:
            yield
        finally:
            loop.remove_reader(self._socket)
            for talk in list(self._talks):
                talk.cancel()
            await asyncio.gather(*self._talks, return_exceptions=True)

    def _bound(self) -> socket.socket:
        bound = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            with suppress(FileNotFoundError):
                (self._folder / SOCKET).unlink()  # of a daemon that was killed: we hold the folder's lock
            descriptor, path = socket_path(self._folder, SOCKET)
            try:
                bound.bind(path)
                Path(path).chmod(0o600)
            finally:
                os.close(descriptor)
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
            bound.setblocking(False)
        except OSError as error:
            bound.close()
            raise ConfigurationError(
                f"{self._folder / SOCKET}: {error.strerror}; expected a socket"
            ) from error
        return bound

    def _receive(self, act: Act) -> None:
        try:
            data, uid, asker = received(self._socket)
        except BlockingIOError:
            return
        talk = asyncio.create_task(self._talk(act, data, uid, asker), name="local request")
        self._talks.add(talk)
        talk.add_done_callback(self._talks.discard)

    async def _talk(self, act: Act, data: bytes, uid: int, asker: str | bytes) -> None:
        answer = await self._answer(act, data, uid)
        with suppress(OSError):  # gone, or it does not read: its own loss
            self._socket.sendto(json.dumps(answer._asdict()).encode(), asker)

    async def _answer(self, act: Act, data: bytes, uid: int) -> Answer:
        if uid not in (0, os.geteuid()):
            return self._refused(f"user {uid} may not: only root and the daemon's own user")
        if len(self._talks) > _AT_ONCE:
            return self._refused(f"{_AT_ONCE} others are speaking")
        if len(data) > LONGEST_DATAGRAM:
            return self._refused(f"not understood: more than {LONGEST_DATAGRAM} bytes")
        try:
            request = _REQUEST.validate_json(data)
        except ValidationError as error:
            return self._refused(f"not understood: {error.errors(include_url=False)[0]['msg']}")
        return await act(request, f"uid {uid}")

    def _refused(self, why: str) -> Answer:
        return Answer(done=False, text=(why,), role=self._role)
