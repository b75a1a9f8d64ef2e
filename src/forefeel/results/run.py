"""One diagnosis from its options to the answer."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from forefeel.common.errors import ConfigurationError, RunError
from forefeel.common.recording.array_tables import is_data_set
from forefeel.common.recording.loading import recordings_in
from forefeel.diagnosis.excitation import SECONDS
from forefeel.files import folder_named_after, fresh_folder, write_all
from forefeel.interrupt import ends_in_order
from forefeel.results.folder import EARLIER, run_folder, save
from forefeel.results.task import FILES, JSON, MODEL, PAGE, Task, Tell, examine
from forefeel.terminal import answer, complain, say, suggest

_LONG = {
    "search": "searching for causes",
    "trust": "weighing the evidence",
    "prediction": "predicting across 300 ms",
    "report": "drawing the report",
}
"""The others are over before anyone wonders, and wrong input ends in them: its one line stands alone."""


def stages(name: str) -> Tell:
    """Function that says the stages of a diagnosis that take long."""
    return lambda stage: say(f"{name}: {_LONG[stage]}") if stage in _LONG else None


def run_diagnosis(
    sources: Sequence[Path],
    out: Path | None,
    task: Task,
    together: bool,
    jobs: int,
    scheduler: str | None,
    overwrite: bool,
) -> None:
    """Diagnoses a file, or every recording of a folder; prints the answer, writes the results into `out`, by
    default a folder named after the first source, and may suggest the next command. `together`: one answer to
    all sources.

    The answer is printed and written before the page is drawn.

    Raises:
        InputError: the file can not be diagnosed, or none of the folder; nothing was written.
        ConfigurationError: several sources without `together`, or options that do not go together.
        RunError: interrupted, or the results can not be written.
    """
    out = out or folder_named_after(sources[0])
    first, *beside = _all_recordings(sources) if together else sources
    if beside and not together:
        raise ConfigurationError(
            f"{beside[0]}: a second recording; expected --together for one answer to all, or a folder"
        )
    task = replace(task, file=first, beside=tuple(beside))
    folder = first.is_dir() and not is_data_set(first)
    if folder and task.confirm is not None:
        raise ConfigurationError(f"--confirm: {first} is a folder; expected one recording, or --together")
    if folder:
        run_folder(task, out, jobs, scheduler, overwrite)
        return
    if scheduler is not None:
        raise ConfigurationError(
            f"--scheduler: {first} is no folder to diagnose one by one; expected a folder of recordings"
        )
    name = "together" if beside else first.stem
    with ends_in_order("diagnosis", out) as written:
        fresh_folder(out, FILES, EARLIER, overwrite)
        result, page = examine(task, stages(name))
        save(out, result, written)
        where = f"{', '.join(result.texts)} in {out}"
        answer(*result.lines, where, document=lambda: result.texts[JSON])
        if task.page:
            draw(page, name, out, written)
        diagnosis = result.diagnosis
        motion = diagnosis.next_motion
        if motion is not None and motion.words is None and not beside and task.axis is None:
            seconds = motion.duration_s if motion.duration_s != SECONDS[1] else None
            suggest("investigate", first, seconds=seconds, **task.columns.options())
        if (diagnosis.names_causes or diagnosis.verdict == "nothing_missing") and task.axis is None:
            suggest("evaluate", first, *beside, model=out / MODEL, out=out, **task.columns.options())


def draw(page: Callable[[], str], name: str, out: Path, written: list[str]) -> None:
    """Draws the page by calling `page`, and writes it into `out`. A RunError of `page` is printed, not
    raised, for the diagnosis is there; RunError where the file can not be written.
    """
    try:
        stages(name)("report")
        text = page()
    except RunError as error:
        complain(str(error))
        return
    write_all(out, {PAGE: text}, written)
    say(f"{PAGE} in {out}")


def _all_recordings(sources: Sequence[Path]) -> list[Path]:
    """Files of all sources, a folder's in its place. ConfigurationError: fewer than two."""
    files = [file for path in sources for file in (recordings_in(path) if path.is_dir() else [path])]
    if len(files) < 2:
        raise ConfigurationError(f"--together: {files[0]} alone; expected at least two recordings")
    return files
