"""The local socket of a daemon, on asyncio: for the same user and root, a few at a time, a line each."""

import asyncio
import json
import os
import socket
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Self

from pydantic import ConfigDict, TypeAdapter, ValidationError

from common.errors import ConfigurationError
from common.state.folder import SOCKET
from forefeel.local.protocol import LONGEST_LINE, LONGEST_TEXT, Answer, Request, peer_uid, socket_path

_AT_ONCE = 8
_PATIENCE_S = 5.0
_REQUEST = TypeAdapter(Request, config=ConfigDict(strict=True, str_max_length=LONGEST_TEXT))
Act = Callable[[Request, str], Awaitable[Answer]]
"""Does what is asked for; who asks."""


class LocalServer:
    """Serves `act` while it is entered.

    Raises:
        ConfigurationError: the socket can not be made.
    """

    def __init__(self, folder: Path, role: str, act: Act) -> None:
        self._folder, self._role, self._act = folder, role, act
        self._talks: set[asyncio.Task[None]] = set()
        self._server: asyncio.Server | None = None

    async def __aenter__(self) -> Self:
        listening = self._bound()
        self._server = await asyncio.start_unix_server(self._accept, sock=listening, limit=LONGEST_LINE)
        return self

    async def __aexit__(self, *_: object) -> None:
        assert self._server is not None
        self._server.close()
        for talk in list(self._talks):
            talk.cancel()
        await asyncio.gather(*self._talks, return_exceptions=True)
        await self._server.wait_closed()
        with suppress(OSError):
            (self._folder / SOCKET).unlink()

    def _bound(self) -> socket.socket:
        listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            with suppress(FileNotFoundError):
                (self._folder / SOCKET).unlink()  # of a daemon that was killed: we hold the folder's lock
            descriptor, path = socket_path(self._folder, SOCKET)
            try:
                listening.bind(path)
                Path(path).chmod(0o600)
            finally:
                os.close(descriptor)
            listening.setblocking(False)
        except OSError as error:
            listening.close()
            raise ConfigurationError(
                f"{self._folder / SOCKET}: {error.strerror}; expected a socket"
            ) from error
        return listening

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        talk = asyncio.current_task()
        assert talk is not None
        self._talks.add(talk)
        try:
            answer = await self._answer(reader, writer)
            writer.write(json.dumps(answer._asdict()).encode() + b"\n")
            await asyncio.wait_for(writer.drain(), _PATIENCE_S)
        except (OSError, TimeoutError, ValueError):  # gone, silent, or endless: its own loss
            pass
        finally:
            self._talks.discard(talk)
            writer.close()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> Answer:
        line = await asyncio.wait_for(reader.readline(), _PATIENCE_S)  # read, or a refusal is lost
        uid = peer_uid(writer.get_extra_info("socket"))
        if uid not in (0, os.geteuid()):
            return self._refused(f"user {uid} may not: only root and the daemon's own user")
        if len(self._talks) > _AT_ONCE:
            return self._refused(f"{_AT_ONCE} others are speaking")
        try:
            request = _REQUEST.validate_json(line)
        except ValidationError as error:
            return self._refused(f"not understood: {error.errors(include_url=False)[0]['msg']}")
        return await self._act(request, f"uid {uid}")

    def _refused(self, why: str) -> Answer:
        return Answer(done=False, text=(why,), role=self._role)
