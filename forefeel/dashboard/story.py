"""What a page shows one after the other: a cell while it runs, the recording of it, the next run."""

from pathlib import Path
from typing import Any

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse

from forefeel.dashboard.chapter import Chapter
from forefeel.dashboard.feed import Answer
from forefeel.dashboard.sources import Ask, LiveCell, RecordedSource, Source, Viewer
from forefeel.dashboard.vessel import of_recording

RESULTS = "/results/{words}"
# its script and style stand in the file; it can reach nothing, not even the server that it comes from
_HEADERS = {
    "Cache-Control": "no-cache",
    "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:; sandbox allow-scripts",
    "X-Content-Type-Options": "nosniff",
}


class Story:
    """The source of all pages of one server. One thread at a time.

    Attributes:
        number: of the chapter; a viewer that has seen another one begins anew.
    """

    def __init__(self, live: LiveCell | None, chapter: Chapter) -> None:
        self._live = live
        self.number = 0
        self.tell(chapter)

    def tell(self, chapter: Chapter) -> None:
        """Raises InputError where its recording can not be read."""
        self.source: Source
        self._vessel = chapter.vessel
        if chapter.recording is not None:
            self.source = RecordedSource(chapter.recording)
            self._vessel = chapter.vessel or of_recording(self.source.metadata)
        else:
            assert self._live is not None
            self._live.begin()
            self.source = self._live
        self.chapter = chapter
        self.number += 1

    def facts(self) -> dict[str, Any]:
        chapter = {"head": self.chapter.head, "pages": list(self.chapter.pages)}
        vessel = None if self._vessel is None else self._vessel.model_dump(mode="json")
        return self.source.facts() | {"chapter": chapter, "vessel": vessel}

    def viewer(self) -> "StoryViewer":
        return StoryViewer(self)

    async def result(self, asked: Request) -> FileResponse:
        """One of the chapter's pages."""
        path: Path | None = self.chapter.pages.get(asked.path_params["words"])
        if path is None:
            raise HTTPException(404)
        return FileResponse(path, headers=_HEADERS, content_disposition_type="inline")


class StoryViewer:
    """Answers with new facts where the next chapter has begun."""

    def __init__(self, story: Story) -> None:
        self._story = story
        self._begin()

    def _begin(self) -> None:
        self._number = self._story.number
        self._viewer: Viewer = self._story.source.viewer()

    async def answer(self, ask: Ask) -> Answer:
        if self._number != self._story.number:
            self._begin()
            return {"facts": self._story.facts()}
        return await self._viewer.answer(ask)
