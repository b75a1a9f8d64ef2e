"""The diagnoses of a folder: each recording for itself, past bad ones, and a summary."""

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from forefeel.common.errors import InputError, RunError
from forefeel.common.events.text import quantity, units_of
from forefeel.common.recording.loading import recordings_in
from forefeel.common.recording.units import Quantity
from forefeel.diagnosis.verdict import Diagnosis
from forefeel.files import fresh_folder, write_all
from forefeel.interrupt import ends_in_order, signal_flag
from forefeel.report.wording import DISCLAIMER
from forefeel.results.parallel import in_parallel
from forefeel.results.task import FILES, JSON, PAGE, Result, Task, TaskOutcome, attempt
from forefeel.results.verdict_text import named, noise_text
from forefeel.terminal import answer, bar, complain, say, suggest, table

SUMMARY, SCHEMA = "summary.json", "forefeel.diagnoses/1"
EARLIER = "an earlier diagnosis"


@dataclass(slots=True)
class Summary:
    """Diagnoses and columns by the recording's stem; reasons by the file's name."""

    diagnosed: dict[str, Diagnosis] = field(default_factory=dict)
    columns: dict[str, Mapping[Quantity, str]] = field(default_factory=dict)
    skipped: dict[str, str] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)

    def to_json(self) -> str:
        """Text of summary.json: each diagnosis in brief, by stem, and why files were skipped or failed; the
        whole diagnosis of each recording is beside it.
        """
        recordings = {stem: _brief(diagnosis) for stem, diagnosis in sorted(self.diagnosed.items())}
        document = {
            "schema": SCHEMA,
            "recordings": recordings,
            "skipped": dict(sorted(self.skipped.items())),
            "failed": dict(sorted(self.failed.items())),
        }
        return json.dumps(document, indent=2, allow_nan=False) + "\n"


def run_folder(task: Task, out: Path, jobs: int, scheduler: str | None, overwrite: bool) -> None:
    """Diagnoses every recording in the folder `task.file`, `jobs` at a time, into `out`/<stem>/; writes
    summary.json, with the reasons for skipped and failed ones, prints it in words and suggests the next
    command.

    Raises:
        InputError: no recording in the folder, or none that can be diagnosed.
        RunError: interrupted, a diagnosis failed, or a result can not be written.
    """
    files = recordings_in(task.file if scheduler is None else task.file.resolve())
    summary = Summary()
    with ends_in_order("diagnosis", out) as written:
        fresh_folder(out, (SUMMARY,), EARLIER, overwrite)
        tasks = [replace(task, file=file) for file in _with_free_folder(files, out, overwrite, summary)]
        with signal_flag() as stop, closing(in_parallel(attempt, tasks, jobs, scheduler, stop.check)) as done:
            for outcome in _with_progress(done, len(tasks), task.file.name):
                _save_outcome(outcome, out, overwrite, summary, written)
        if not summary.diagnosed and not summary.failed:
            raise InputError(list(summary.skipped.values())[-1])
        write_all(out, {SUMMARY: summary.to_json()}, written)
    answer(*_in_words(summary, out), document=summary.to_json)
    if summary.failed:
        raise RunError(
            f"{len(summary.failed)} of {len(files)} recordings failed; {SUMMARY} in {out} says why"
        )
    if len(summary.diagnosed) > 1:
        files = [file for file in files if file.stem in summary.diagnosed] if summary.skipped else [task.file]
        suggest("diagnose", *files, "--together", out=out / "together", **task.columns.options())


def _with_free_folder(files: Iterable[Path], out: Path, overwrite: bool, summary: Summary) -> Iterator[Path]:
    """Yields the files whose folder in `out` is free. One of the same stem as an earlier file, or whose
    folder holds an earlier diagnosis without `overwrite`, is entered in the summary as skipped, and said.
    """
    taken: dict[str, Path] = {}
    for file in files:
        folder = out / file.stem
        if file.stem in taken:
            reason = f"{file}: {taken[file.stem].name} has the same stem; expected one recording of each stem"
        elif (folder / JSON).exists() and not overwrite:
            reason = f"{file}: {folder} holds {EARLIER}; expected another --out, or --overwrite"
        else:
            taken[file.stem] = file
            yield file
            continue
        _skip(file, reason, summary)


def _skip(file: Path, reason: str, summary: Summary) -> None:
    summary.skipped[file.name] = reason
    say(f"skipped: {reason}")


def _save_outcome(
    outcome: TaskOutcome, out: Path, overwrite: bool, summary: Summary, written: list[str]
) -> None:
    """Writes the results of an outcome into `out`/<stem>/ and enters it in the summary; says what failed or
    was skipped. A folder that can not be used is skipped, too. Adds the folder's name to `written`.
    """
    file = outcome.task.file
    if outcome.result is None:
        if outcome.failed is not None:
            summary.failed[file.name] = outcome.failed
            say(f"failed: {outcome.failed}")
        else:
            _skip(file, outcome.skipped or "", summary)
        return
    folder = out / file.stem
    try:
        fresh_folder(folder, FILES, EARLIER, overwrite)
    except InputError as error:
        _skip(file, f"{file}: {error}", summary)
        return
    save(folder, outcome.result, [])
    written.append(f"{file.stem}/")
    summary.diagnosed[file.stem] = outcome.result.diagnosis
    summary.columns[file.stem] = outcome.result.columns
    if outcome.result.page_failed is not None:
        complain(outcome.result.page_failed)


def save(folder: Path, result: Result, written: list[str]) -> None:
    """Writes the results; a page of an earlier diagnosis does not stay beside them.

    Raises:
        RunError: one can not be written.
    """
    if PAGE not in result.texts:
        (folder / PAGE).unlink(missing_ok=True)
    write_all(folder, result.texts, written)


def _with_progress(outcomes: Iterable[TaskOutcome], total: int, name: str) -> Iterator[TaskOutcome]:
    """Yields the outcomes as they come, with a bar on a terminal and a line for each that has a result."""
    with bar(total) as show:
        show(0, name)
        for number, outcome in enumerate(outcomes, 1):
            yield outcome
            show(number, name)
            if outcome.result is not None:
                say(f"{number} of {total}: {outcome.task.file.stem}: {named(outcome.result.diagnosis)}")


def _brief(diagnosis: Diagnosis) -> dict[str, object]:
    """Entry of a diagnosis in summary.json: verdict, causes, rivals, flags, noise, errors held out."""
    return {
        "verdict": diagnosis.verdict,
        "causes": [cause.name for cause in diagnosis.causes],
        "rivals": [list(group) for group in diagnosis.rivals],
        "flags": list(diagnosis.flags),
        "noise_floor_n": diagnosis.noise_floor_n,
        "held_out": asdict(diagnosis.held_out),
    }


def _in_words(summary: Summary, out: Path) -> Iterator[RenderableType]:
    """Yields the table, where anything was diagnosed, the counts and the disclaimer, for the terminal."""
    if summary.diagnosed:
        yield _table(summary)
    count = len(summary.diagnosed)
    all_of = count + len(summary.skipped) + len(summary.failed)
    left = f", {len(summary.skipped)} skipped, {len(summary.failed)} failed" if count < all_of else ""
    yield f"{count} of {all_of} diagnosed{left}; {SUMMARY} and a folder for each in {out}"
    yield DISCLAIMER


def _table(summary: Summary) -> Table:
    """Table of the diagnosed recordings, by stem: verdict and causes, rms errors of simulation and extended
    model, noise; as angles or torques where a recording has these.
    """
    numbers = "simulation off by", "extended", "noise"
    made = table("recording", "verdict", *numbers, right=numbers)
    for stem, diagnosis in sorted(summary.diagnosed.items()):
        held = diagnosis.held_out
        with units_of(summary.columns[stem]):
            sizes = (quantity(size, "N") for size in (held.rmse_before_n, held.rmse_after_n))
            made.add_row(Text(stem), Text(named(diagnosis)), *sizes, noise_text(diagnosis))
    return made
