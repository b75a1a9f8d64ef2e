"""One evaluation from its options to the table."""

from collections import Counter
from collections.abc import Sequence
from functools import partial
from itertools import count
from pathlib import Path

from forefeel.common.causes.model import ContactModel
from forefeel.common.errors import ConfigurationError, RecordingError
from forefeel.common.events.text import units_of
from forefeel.common.model_file import load_model
from forefeel.common.recording.loading import load_recording
from forefeel.common.recording.units import Mapping
from forefeel.diagnosis.evaluation.arrivals import DelayedLink
from forefeel.diagnosis.evaluation.delays import most_usual
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
from forefeel.evaluation.page import in_words, render_page
from forefeel.files import folder_named_after, fresh_folder, write_all
from forefeel.interrupt import ends_in_order
from forefeel.terminal import answer, bar, complain, say

_JSON, _PAGE = "evaluation.json", "evaluation.html"


def run_evaluation(
    files: Sequence[Path],
    links: Sequence[DelayedLink],
    model_file: Path | None,
    columns: Mapping,
    axis: str | None,
    out: Path | None,
    overwrite: bool,
) -> ContactModel | None:
    """Replays the recordings across the links, by increasing delay, through every method, writes
    evaluation.json and evaluation.html into `out`, or a folder named after the first file, and prints the
    tables; files that can not be used are skipped. Returns the model of `model_file`.

    Raises:
        InputError: the options can not be fulfilled, or no file can be evaluated; nothing was written.
        RunError: interrupted, or the results can not be written.
    """
    folder = out or folder_named_after(files[0])
    link = most_usual(links)
    with ends_in_order("evaluation", folder) as written:
        model = checked_model(load_model(model_file), str(model_file)) if model_file else None
        prepared, skipped = _read(files, columns, axis, links, model)
        fresh_folder(folder, (_JSON, _PAGE), "an earlier evaluation", overwrite)
        recordings = [usual.recording for usual, _ in prepared.values()]
        for recording in recordings:
            say(": ".join(filter(None, (recording.source, recording.taken))))
        for reason in skipped.values():
            say(f"skipped: {reason}")
        evaluated = _evaluate(prepared, model, links)
        stated = rules(link, model)
        document = to_json(link, stated, evaluated, skipped)
        with units_of(*[recording.columns for recording in recordings]):
            page = render_page(link, stated, evaluated, skipped)
            lines = list(in_words(link, evaluated))
        write_all(folder, {_JSON: document, _PAGE: page}, written)
    answer(*lines, f"{_PAGE}, {_JSON} in {folder}", document=lambda: document)
    return model


def _read(
    files: Sequence[Path],
    columns: Mapping,
    axis: str | None,
    links: Sequence[DelayedLink],
    model: ContactModel | None,
) -> tuple[dict[str, tuple[Prepared, Prepared]], dict[str, str]]:
    """Loads the recordings and prepares them for the most usual and for the longest of the links; one that
    can not be used over both is skipped. Returns by the file's stem (usual, longest) of each, and the reasons
    for those that were skipped. Where nothing is left it prints the reasons but the last, which it raises.

    Raises:
        InputError: two files of one stem, a column that is malformed, or nothing left.
    """
    stems = Counter(path.stem for path in files)
    for stem, times in stems.items():
        if times > 1:
            raise ConfigurationError(f"{times} files are named {stem!r}; expected one of each name")
    prepared: dict[str, tuple[Prepared, Prepared]] = {}
    skipped: dict[Path, RecordingError] = {}
    for path in files:
        try:
            recording = load_recording(path, columns, axis, force=True)
            longest = usual = prepare(recording, links[-1], model)
            if (link := most_usual(links)) != links[-1]:
                usual = prepare(recording, link, model)
            prepared[path.stem] = usual, longest
        except RecordingError as error:
            skipped[path] = error
    if not prepared:
        *others, (_, last) = skipped.items()
        for path, reason in others:
            complain(reason.answered_by("evaluate", path))
        raise last
    return prepared, {path.stem: error.answered_by("evaluate", path) for path, error in skipped.items()}


def _evaluate(
    prepared: dict[str, tuple[Prepared, Prepared]], model: ContactModel | None, links: Sequence[DelayedLink]
) -> dict[str, Evaluated]:
    """Evaluates each recording by every method and over every link; results by the file's stem. Prints a line
    for each delay and shows a progress bar.
    """
    number = count()
    with bar(len(prepared) * len(links) * len(METHODS)) as show:

        def tell(stem: str, method: str) -> None:
            done = next(number)
            show(done, f"{stem}: {method}")
            if done % len(METHODS) == 0:
                say(f"{stem}: replaying, delay {done // len(METHODS) % len(links) + 1} of {len(links)}")

        return {
            stem: evaluate(usual, model, partial(tell, stem), links, longest)
            for stem, (usual, longest) in prepared.items()
        }
