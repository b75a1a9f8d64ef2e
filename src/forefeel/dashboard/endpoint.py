"""WebSocket endpoint of the page. A scene is a live cell or a recording, with results.

A page asks, is answered, draws and asks again; what nobody asks for is not made.
"""

import asyncio
import json
from pathlib import Path
from typing import Any

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse
from starlette.websockets import WebSocket, WebSocketDisconnect

from forefeel.dashboard.feed import Answer
from forefeel.dashboard.scene import Scene
from forefeel.dashboard.sources import Ask, LiveCell, Recorded
from forefeel.report.vessel import of_recording

CONVERSATION, RESULTS = "/conversation", "/results/{words}"
MOST_VIEWERS = 16  # open pages at once
_MOST_ASKED_CHARACTERS = 2048
# close codes: policy violation (RFC 6455, 7.4.1), try again later (IANA registry)
_REFUSED, _FULL = 1008, 1013
# its script and style stand in the file; it can reach nothing, not even the server that it comes from
_HEADERS = {
    "Cache-Control": "no-cache",
    "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:; sandbox allow-scripts",
    "X-Content-Type-Options": "nosniff",
}


class Endpoint:
    """Serves the newest scene to up to `MOST_VIEWERS` pages at once. One thread at a time.

    A page beyond these takes the place of the oldest that has asked nothing; without one it is refused.
    """

    def __init__(self, live: LiveCell | None, scene: Scene) -> None:
        self._live = live
        self._viewers: dict[WebSocket, bool] = {}  # by age; whether it has asked
        self.show(scene)

    def show(self, scene: Scene) -> None:
        """Serves that scene from now on: its recording, or without one the live cell, which forgets all that
        it received. While the scene waits for something, the page shows only that text. Raises InputError
        where the recording can not be read.
        """
        self._source: LiveCell | Recorded
        self._vessel = scene.vessel
        if scene.recording is not None:
            self._source = Recorded(scene.recording)
            self._vessel = scene.vessel or of_recording(self._source.metadata)
        else:
            assert self._live is not None
            self._live.begin(scene.waits)
            self._source = self._live
        self.scene = scene

    def facts(self) -> dict[str, Any]:
        """Constants of the scene, which a page gets first: cell, recording, title, links, vessel."""
        scene = {"head": self.scene.head, "pages": list(self.scene.pages)}
        vessel = None if self._vessel is None else self._vessel.model_dump(mode="json")
        return self._source.facts() | {"scene": scene, "vessel": vessel}

    async def result(self, asked: Request) -> FileResponse:
        path: Path | None = self.scene.pages.get(asked.path_params["words"])
        if path is None:
            raise HTTPException(404)
        return FileResponse(path, headers=_HEADERS, content_disposition_type="inline")

    @property
    def open(self) -> int:
        """Number of open pages."""
        return len(self._viewers)

    async def converse(self, socket: WebSocket) -> None:
        """Answers a page until it leaves. With `MOST_VIEWERS` pages open it first closes the oldest that has
        sent no request yet, or, if all have, this new one.
        """
        await socket.accept()
        if len(self._viewers) >= MOST_VIEWERS:
            displaced = next((viewer for viewer, asked in self._viewers.items() if not asked), socket)
            self._viewers.pop(displaced, None)
            await displaced.close(_FULL, "too many viewers")
            displaced.state.abort()
            if displaced is socket:
                return
        self._viewers[socket] = False
        try:
            await self._answer(socket)
        except WebSocketDisconnect:
            return
        finally:
            self._viewers.pop(socket, None)

    async def _answer(self, socket: WebSocket) -> None:
        """Sends the facts of the scene, then answers each request; the first after a change of scene with the
        new facts. Returns once the page is displaced, or closed for a request that is not understood; raises
        WebSocketDisconnect when it leaves.
        """
        scene, viewer = self.scene, self._source.viewer()
        answer: Answer = {"facts": self.facts()}
        while True:
            await socket.send_text(json.dumps(answer, allow_nan=False, separators=(",", ":")))
            asked = await socket.receive_text()
            if socket not in self._viewers:  # displaced meanwhile
                return
            self._viewers[socket] = True
            try:
                if len(asked) > _MOST_ASKED_CHARACTERS:
                    raise ValueError("too long")
                ask = Ask.model_validate_json(asked)
            except ValueError:
                await socket.close(_REFUSED, "not understood")
                return
            if scene is self.scene:  # in a thread: while a recording is read, other pages go on
                answer = await asyncio.to_thread(viewer, ask)
            else:
                scene, viewer = self.scene, self._source.viewer()
                answer = {"facts": self.facts()}
