"""One part of what a page tells, as a line of JSON from the command to the process that serves the page."""

from pathlib import Path

from pydantic import BaseModel, ConfigDict

from forefeel.dashboard.vessel import VesselSettings


class Chapter(BaseModel):
    """Which runs are going on, or what has come of them.

    Attributes:
        head: in one sentence.
        recording: is shown in place of the live cell.
        pages: files beside it that the page leads to, by their words.
        vessel: that the page draws; None: that of the recording, if it holds one.
        stays: as the last one until the server is told to end, in place of until nobody looks.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    head: str = ""
    recording: Path | None = None
    pages: dict[str, Path] = {}
    vessel: VesselSettings | None = None
    stays: bool = False
