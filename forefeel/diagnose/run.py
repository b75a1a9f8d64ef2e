"""One diagnosis, or those of a folder, from the wish to the answer."""

import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import joblib
from rich.console import Console
from rich.progress import Progress, TextColumn, TimeElapsedColumn

from common.config import dump_mapping
from common.effects.model import ContactModel
from common.errors import InputError, RecordingError
from common.model_file import load_model
from common.recording.recording import Recording
from common.recording.tabular import Mapping, load_recording
from diagnosis.diagnose import Diagnosed, diagnose
from diagnosis.diagnose.extended import extended_model
from diagnosis.diagnose.prediction import Across, across_delay
from forefeel.diagnose.page import render_page
from forefeel.diagnose.words import answer, one_line
from forefeel.files import fresh_folder, write_whole

JSON, PAGE, MODEL = "diagnosis.json", "report.html", "model.yaml"
_SUFFIXES = ".csv", ".parquet", ".mcap"


@dataclass(frozen=True, slots=True)
class Wish:
    """What the user asked for. `columns`: time, position, force as `unit:column`."""

    source: Path
    out: Path
    model: Path | None = None
    jobs: int = 1
    overwrite: bool = False
    columns: tuple[str | None, str | None, str | None] = (None, None, None)


def run_diagnosis(wish: Wish) -> None:
    """Diagnoses a file, or every recording of a folder.

    Raises:
        InputError: the file can not be diagnosed, or none of the folder; nothing was written.
        RunError: the results can not be written.
    """
    given = None if wish.model is None else load_model(wish.model)
    if wish.source.is_dir():
        _folder(wish, given)
        return
    with _progress() as bar:
        task = bar.add_task("reading")
        diagnosed, lines = _one(wish, given, lambda stage: bar.update(task, description=stage))
    del diagnosed
    print("\n".join(lines))


def _one(wish: Wish, given: ContactModel | None, progress) -> tuple[Diagnosed, list[str]]:  # type: ignore[no-untyped-def]  # noqa: ANN001
    """Reads, diagnoses, writes the three files."""
    recording = load_recording(wish.source, _mapping(*wish.columns))
    diagnosed = diagnose(recording, progress, given)
    model = extended_model(diagnosed.analysis, f"{recording.name}, extended by its diagnosis")
    progress("prediction")
    across = _prediction(recording, model)
    folder = fresh_folder(wish.out, (JSON, PAGE, MODEL), "an earlier diagnosis", wish.overwrite)
    progress("report")
    document = {
        **diagnosed.diagnosis.to_mapping(),
        "prediction_300_ms": None if across is None else across.to_mapping(),
    }
    write_whole(folder / MODEL, dump_mapping(model.to_mapping()))
    write_whole(folder / PAGE, render_page(recording, diagnosed, across))
    write_whole(folder / JSON, json.dumps(document, indent=2, allow_nan=False) + "\n")
    return diagnosed, [
        *answer(recording, diagnosed.diagnosis, across),
        f"{PAGE}, {JSON}, {MODEL} in {folder}",
    ]


def _prediction(recording: Recording, model: ContactModel) -> Across | None:
    try:
        return across_delay(recording, model)
    except RecordingError:
        return None


def _folder(wish: Wish, given: ContactModel | None) -> None:
    """Every recording in a folder; goes on past a bad one and says so.

    Raises:
        InputError: no recording in the folder, or none that can be diagnosed.
    """
    files = sorted(path for path in wish.source.iterdir() if path.suffix.lower() in _SUFFIXES)
    if not files:
        raise InputError(f"{wish.source}: no recording, expected {', '.join(_SUFFIXES)} files")
    tasks = (joblib.delayed(_entry)(replace(wish, source=f, out=wish.out / f.stem), given) for f in files)
    parallel = joblib.Parallel(n_jobs=wish.jobs, return_as="generator")
    bad: list[str] = []
    with _progress() as bar:
        task = bar.add_task(wish.source.name, total=len(files))
        for number, (file, line, error) in enumerate(parallel(tasks), 1):
            bar.update(task, completed=number, description=f"{number} of {len(files)}: {file.name}")
            print(
                line if error is None else f"skipped: {error}",
                file=sys.stdout if error is None else sys.stderr,
            )
            bad += [] if error is None else [error]
    print(f"{len(files) - len(bad)} of {len(files)} diagnosed, {len(bad)} skipped; results in {wish.out}")
    if len(bad) == len(files):
        raise InputError(bad[-1])


def _entry(wish: Wish, given: ContactModel | None) -> tuple[Path, str, str | None]:
    """(file, line of the summary, why it was skipped)."""
    try:
        diagnosed, _ = _one(wish, given, lambda stage: None)
    except InputError as error:
        return wish.source, "", " ".join(str(error).splitlines())
    return wish.source, f"{wish.source.stem}: {one_line(diagnosed.diagnosis)}", None


def _progress() -> Progress:
    console = Console(stderr=True, highlight=False)
    columns = TextColumn("{task.description}"), TimeElapsedColumn()
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


def _mapping(time: str | None, position: str | None, force: str | None) -> Mapping | None:
    """A mapping when the user named any column; the others have their canonical names."""
    if time is None and position is None and force is None:
        return None
    return Mapping(time or "s:time_s", position or "m:position_m", force or "N:force_n")
