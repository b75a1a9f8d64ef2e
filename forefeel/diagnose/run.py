"""One diagnosis from the wish to the answer."""

from dataclasses import dataclass
from pathlib import Path

from forefeel.columns import Columns
from forefeel.common.errors import ConfigurationError
from forefeel.common.model_file import load_model
from forefeel.diagnose.examine import FILES, JSON, Task, examine
from forefeel.diagnose.folder import EARLIER, run_folder
from forefeel.diagnose.stages import diagnosing
from forefeel.files import results_folder, write_all
from forefeel.interrupt import ends_in_order
from forefeel.terminal import answer


@dataclass(frozen=True, slots=True)
class Wish:
    """What the user asked for. `columns`: time, position, force as `unit:column`; `axis` of an MCAP file."""

    source: Path
    out: Path
    model: Path | None = None
    jobs: int = 1
    scheduler: str | None = None
    overwrite: bool = False
    columns: Columns = (None, None, None)
    axis: str | None = None


def run_diagnosis(wish: Wish) -> None:
    """Diagnoses a file, or every recording of a folder; prints the answer.

    Raises:
        InputError: the file can not be diagnosed, or none of the folder; nothing was written.
        RunError: interrupted, or the results can not be written.
    """
    given = None if wish.model is None else load_model(wish.model)
    task = Task(wish.source, wish.columns, wish.axis, given)
    if wish.source.is_dir():
        run_folder(task, wish.out, wish.jobs, wish.scheduler, wish.overwrite)
        return
    if wish.scheduler is not None:
        raise ConfigurationError(f"--scheduler: {wish.source} is no folder; expected a folder of recordings")
    with (
        ends_in_order("diagnosis", wish.out) as written,
        results_folder(wish.out, FILES, EARLIER, wish.overwrite),
    ):
        with diagnosing(wish.source.stem) as tell:
            result = examine(task, tell)
        write_all(wish.out, result.texts, written)
    where = f"{', '.join(sorted(FILES, reverse=True))} in {wish.out}"
    answer(*result.lines, where, document=lambda: result.texts[JSON])
