"""The conversation with an open page over a WebSocket: it asks, it is answered, it draws, it asks again."""

import json

from pydantic import ValidationError
from starlette.websockets import WebSocket, WebSocketDisconnect

from forefeel.dashboard.sources import Ask, Source

PATH = "/conversation"
MOST_VIEWERS = 16  # open pages at once
# characters of a question
_MOST_ASKED_CHARACTERS = 2048
# close codes: policy violation (RFC 6455, 7.4.1), try again later (IANA registry)
_REFUSED, _FULL = 1008, 1013


class Conversations:
    """Serves up to `MOST_VIEWERS` pages at once; what nobody asks for is not made."""

    def __init__(self, source: Source) -> None:
        self.open = 0
        self._source = source

    async def serve(self, socket: WebSocket) -> None:
        await socket.accept()
        if self.open >= MOST_VIEWERS:
            await socket.close(_FULL, "too many viewers")
            return
        self.open += 1
        try:
            await self._converse(socket)
        except WebSocketDisconnect:
            return
        finally:
            self.open -= 1

    async def _converse(self, socket: WebSocket) -> None:
        viewer = self._source.viewer()
        await socket.send_text(json.dumps(self._source.facts()))
        while True:
            asked = await socket.receive_text()
            try:
                if len(asked) > _MOST_ASKED_CHARACTERS:
                    raise ValueError("too long")
                ask = Ask.model_validate_json(asked)
            except (ValueError, ValidationError):
                await socket.close(_REFUSED, "not understood")
                return
            answer = await viewer.answer(ask)
            await socket.send_text(json.dumps(answer, allow_nan=False, separators=(",", ":")))
