"""One diagnosis from its options to the answer."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from forefeel.common.errors import ConfigurationError
from forefeel.common.model_file import load_model
from forefeel.common.recording.units import NamedColumns
from forefeel.diagnose.examine import FILES, JSON, Task, examine
from forefeel.diagnose.folder import EARLIER, recordings_in, run_folder, save
from forefeel.files import results_folder
from forefeel.interrupt import ends_in_order
from forefeel.terminal import answer, stages

_STAGES = {
    "reading": "reading the recording",
    "sensor": "looking at the load cell",
    "search": "searching for causes",
    "trust": "weighing the evidence",
    "prediction": "predicting across 300 ms",
    "report": "drawing the report",
}
_LONG = "search", "trust", "prediction", "report"
"""The others are over before anyone wonders, and wrong input ends in them: its one line stands alone."""


@dataclass(frozen=True, slots=True)
class DiagnosisOptions:
    """What the user asked for.

    `together`: one answer to all recordings. `columns`: time, position, force as `unit:column`. `axis`: of an
    MCAP file. `replay`, `page`: as in `Task`.
    """

    sources: Sequence[Path]
    out: Path
    together: bool = False
    model: Path | None = None
    jobs: int = 1
    scheduler: str | None = None
    overwrite: bool = False
    columns: NamedColumns = (None, None, None)
    axis: str | None = None
    replay: bool = True
    page: bool = True


def run_diagnosis(options: DiagnosisOptions) -> None:
    """Diagnoses a file, or every recording of a folder; prints the answer.

    Raises:
        InputError: the file can not be diagnosed, or none of the folder; nothing was written.
        ConfigurationError: several sources without `together`, or options that do not go together.
        RunError: interrupted, or the results can not be written.
    """
    given = None if options.model is None else load_model(options.model)
    first, *beside = _together(options) if options.together else options.sources
    if beside and not options.together:
        raise ConfigurationError(
            f"{beside[0]}: a second recording; expected --together for one answer to all, or a folder"
        )
    task = Task(first, tuple(beside), options.columns, options.axis, given, options.replay, options.page)
    if first.is_dir():
        run_folder(task, options.out, options.jobs, options.scheduler, options.overwrite)
        return
    if options.scheduler is not None:
        raise ConfigurationError(
            f"--scheduler: {first} is no folder to diagnose one by one; expected a folder of recordings"
        )
    with (
        ends_in_order("diagnosis", options.out) as written,
        results_folder(options.out, FILES, EARLIER, options.overwrite),
    ):
        with stages("together" if beside else first.stem, _STAGES, _LONG) as tell:
            result = examine(task, tell)
        save(options.out, result, written)
    where = f"{', '.join(sorted(result.texts, reverse=True))} in {options.out}"
    answer(*result.lines, where, document=lambda: result.texts[JSON])


def _together(options: DiagnosisOptions) -> list[Path]:
    """The recordings of all sources, a folder's in its place."""
    found = [file for path in options.sources for file in (recordings_in(path) if path.is_dir() else [path])]
    if len(found) < 2:
        raise ConfigurationError(f"--together: {found[0]} alone; expected at least two recordings")
    return found
