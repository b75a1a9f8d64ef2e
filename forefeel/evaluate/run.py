"""One evaluation from its options to the table."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from rich.progress import BarColumn, TextColumn

from forefeel.common.causes.model import ContactModel
from forefeel.common.errors import ConfigurationError, InputError, RecordingError
from forefeel.common.model_file import load_model
from forefeel.common.recording.tabular import load_recording
from forefeel.common.recording.units import NamedColumns, mapping_of
from forefeel.diagnosis.evaluation.arrivals import DelayedLink
from forefeel.diagnosis.evaluation.evaluate import (
    Evaluated,
    Prepared,
    checked_model,
    evaluate,
    prepare,
    rules,
    to_json,
)
from forefeel.diagnosis.evaluation.methods import METHODS
from forefeel.evaluate.page import in_words, render_page
from forefeel.files import fresh_folder, write_all
from forefeel.interrupt import ends_in_order
from forefeel.terminal import answer, complain, progress, say

_JSON, _PAGE = "evaluation.json", "evaluation.html"


@dataclass(frozen=True, slots=True)
class EvaluationOptions:
    """What the user asked for on the command line. `columns`: time, position, force as `unit:column`."""

    files: tuple[Path, ...]
    delay_s: float
    jitter_s: float = 0.0
    loss: float = 0.0
    seed: int = 0
    model: Path | None = None
    columns: NamedColumns = (None, None, None)


def run_evaluation(options: EvaluationOptions, out: Path, overwrite: bool) -> dict[str, Evaluated]:
    """Reads, replays, writes evaluation.json and evaluation.html, prints the table.

    Raises:
        InputError: the options can not be fulfilled, or no file can be evaluated; nothing was written.
        RunError: interrupted, or the results can not be written.
    """
    with ends_in_order("evaluation", out) as written:
        return _run(options, out, overwrite, written)


def _run(options: EvaluationOptions, out: Path, overwrite: bool, written: list[str]) -> dict[str, Evaluated]:
    link = DelayedLink(options.delay_s, options.jitter_s, options.loss, options.seed)
    model = None if options.model is None else checked_model(load_model(options.model), str(options.model))
    prepared, skipped = _read(options, link)
    folder = fresh_folder(out, (_JSON, _PAGE), "an earlier evaluation", overwrite)
    for reason in skipped.values():
        say(f"skipped: {reason}")
    evaluated = _evaluate(prepared, model)
    said = rules(link, model)
    document = to_json(link, said, evaluated, skipped)
    page = render_page(link, said, evaluated, skipped)
    write_all(folder, {_JSON: document, _PAGE: page}, written)
    answer(*in_words(link, said, evaluated), f"{_PAGE}, {_JSON} in {folder}", document=lambda: document)
    return evaluated


def _read(options: EvaluationOptions, link: DelayedLink) -> tuple[dict[str, Prepared], dict[str, str]]:
    """(recordings, reasons for those that were skipped), both by the file's stem.

    Raises:
        InputError: two files of one stem, a column that is malformed, or nothing left.
    """
    stems = Counter(path.stem for path in options.files)
    for stem, count in stems.items():
        if count > 1:
            raise ConfigurationError(f"{count} files are named {stem!r}; expected one of each name")
    mapping = mapping_of(options.columns)
    prepared: dict[str, Prepared] = {}
    skipped: dict[str, str] = {}
    for path in options.files:
        try:
            prepared[path.stem] = prepare(load_recording(path, mapping), link)
        except RecordingError as error:
            skipped[path.stem] = " ".join(str(error).splitlines())
    if not prepared:
        _refuse(list(skipped.values()))
    return prepared, skipped


def _refuse(reasons: list[str]) -> None:
    """One line for each file that can not be evaluated; the last one is the error."""
    for reason in reasons[:-1]:
        complain(reason)
    raise InputError(reasons[-1])


def _evaluate(prepared: dict[str, Prepared], model: ContactModel | None) -> dict[str, Evaluated]:
    columns = TextColumn("{task.description}", markup=False), BarColumn(bar_width=40)
    evaluated: dict[str, Evaluated] = {}
    with progress(*columns) as bar:
        task = bar.add_task("", total=len(prepared) * len(METHODS))
        for stem, recording in prepared.items():

            def show(name: str, stem: str = stem) -> None:
                bar.update(task, advance=1, description=f"{stem}: {name}")

            evaluated[stem] = evaluate(recording, model, show)
    return evaluated
