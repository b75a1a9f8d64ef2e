"""The state of a command that its page shows, as a line of JSON to the process that serves the page."""

from pathlib import Path

from pydantic import BaseModel, ConfigDict

from forefeel.report.vessel import VesselSettings


class Scene(BaseModel):
    """Stage of a command: a run that goes on, or the results so far.

    Attributes:
        head: the stage in one sentence.
        recording: shown in place of the live cell.
        pages: HTML files that the page links to, by the words of the link.
        vessel: drawn by the page; None: that of the recording, if it holds one.
        waits: what goes on in place of a cell that is not there; nothing else is shown meanwhile.
        stays: the last one is served until a signal, not only until nobody looks.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    head: str = ""
    recording: Path | None = None
    pages: dict[str, Path] = {}
    vessel: VesselSettings | None = None
    waits: str = ""
    stays: bool = False
