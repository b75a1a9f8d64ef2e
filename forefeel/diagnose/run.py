"""One diagnosis from its options to the answer."""

from dataclasses import dataclass
from pathlib import Path

from forefeel.columns import Columns
from forefeel.common.errors import ConfigurationError
from forefeel.common.model_file import load_model
from forefeel.diagnose.examine import FILES, JSON, Task, examine
from forefeel.diagnose.folder import EARLIER, run_folder
from forefeel.files import results_folder, write_all
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
    """What the user asked for. `columns`: time, position, force as `unit:column`; `axis` of an MCAP file."""

    source: Path
    out: Path
    model: Path | None = None
    jobs: int = 1
    scheduler: str | None = None
    overwrite: bool = False
    columns: Columns = (None, None, None)
    axis: str | None = None


def run_diagnosis(options: DiagnosisOptions) -> None:
    """Diagnoses a file, or every recording of a folder; prints the answer.

    Raises:
        InputError: the file can not be diagnosed, or none of the folder; nothing was written.
        RunError: interrupted, or the results can not be written.
    """
    given = None if options.model is None else load_model(options.model)
    task = Task(options.source, options.columns, options.axis, given)
    if options.source.is_dir():
        run_folder(task, options.out, options.jobs, options.scheduler, options.overwrite)
        return
    if options.scheduler is not None:
        raise ConfigurationError(
            f"--scheduler: {options.source} is no folder; expected a folder of recordings"
        )
    with (
        ends_in_order("diagnosis", options.out) as written,
        results_folder(options.out, FILES, EARLIER, options.overwrite),
    ):
        with stages(options.source.stem, _STAGES, _LONG) as tell:
            result = examine(task, tell)
        write_all(options.out, result.texts, written)
    where = f"{', '.join(sorted(FILES, reverse=True))} in {options.out}"
    answer(*result.lines, where, document=lambda: result.texts[JSON])
