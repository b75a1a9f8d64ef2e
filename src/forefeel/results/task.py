"""One recording from the file to the texts of its results; nothing is written."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from threadpoolctl import threadpool_limits

from forefeel.common.causes.model import ContactModel
from forefeel.common.errors import (
    ConfigurationError,
    ForefeelError,
    InputError,
    RecordingError,
    RunError,
    UnclearError,
)
from forefeel.common.events.text import shown_unit, units_of
from forefeel.common.recording.loading import load_recording
from forefeel.common.recording.recording import Recording
from forefeel.common.recording.units import Mapping as ColumnMapping
from forefeel.common.recording.units import Quantity, parse_column, rescaled
from forefeel.common.yaml_file import dump_mapping
from forefeel.diagnosis.analysis import Progress
from forefeel.diagnosis.confirmation import Replay, confirm
from forefeel.diagnosis.diagnose import Diagnosed, check, diagnose
from forefeel.diagnosis.extended_model import extended_model
from forefeel.diagnosis.plausibility import Question, question
from forefeel.diagnosis.verdict import Diagnosis
from forefeel.results.confirmation_text import confirmation_lines
from forefeel.results.verdict_text import answer, failure, labelled

if TYPE_CHECKING:
    from forefeel.diagnosis.prediction import Across

JSON, PAGE, MODEL = "diagnosis.json", "report.html", "model.yaml"
FILES = MODEL, JSON, PAGE
Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Task:
    """A diagnosis to make. `given` is the simulation to compare with; `axis` one of an MCAP file.

    `beside`: further recordings of the same bench, for one answer to all. `confirm`: another one that the
    model is held against. `replay`: whether the force is predicted across a delay, too. `page`: whether
    report.html is made. `as_is`: nothing is asked about units.
    """

    file: Path
    beside: tuple[Path, ...] = ()
    columns: ColumnMapping = field(default_factory=ColumnMapping)
    axis: str | None = None
    given: ContactModel | None = None
    replay: bool = True
    page: bool = True
    as_is: bool = False
    confirm: Path | None = None


@dataclass(frozen=True, slots=True)
class Result:
    """The diagnosis, the short answer and the text of each of `FILES` that is there.

    `columns`: of the recording, with their units. `page_failed`: why there is no page, in one line.
    """

    diagnosis: Diagnosis
    lines: tuple[str, ...]
    texts: Mapping[str, str]
    columns: Mapping[Quantity, str]
    page_failed: str | None = None


@dataclass(frozen=True, slots=True)
class TaskOutcome:
    """Outcome of a task: its result, or in one line why it was skipped or failed."""

    task: Task
    result: Result | None = None
    skipped: str | None = None
    failed: str | None = None


class Answered(NamedTuple):
    """A diagnosis, the simulation extended by the causes where any are named, and the answer in words."""

    details: Diagnosed
    model: ContactModel
    lines: tuple[str, ...]


def answered(
    recordings: Sequence[Recording],
    progress: Progress = lambda _stage: None,
    given: ContactModel | None = None,
    as_is: bool = False,
) -> Answered:
    """Diagnoses recordings of one bench as `library.diagnose` does; returns details, the model (extended
    where a cause is named) and the answer's lines. `progress` gets each stage; `as_is`: units are not
    questioned.

    Raises RecordingError where one can not be diagnosed, or its units are not plausible.
    """
    with units_of(*[source.columns for source in recordings]):
        for recording in recordings:
            require_usable(recording, as_is)
        details = diagnose(recordings[0], progress, given, recordings[1:])
        lines = answer(details.recording, details.diagnosis, None, None if given is None else given.name)
    return Answered(details, model_of(details), tuple(lines))


def model_of(details: Diagnosed) -> ContactModel:
    """The simulation of a diagnosis, extended where causes are named."""
    named, title = details.diagnosis.names_causes, f"{details.recording.name}, extended by its diagnosis"
    if not named:  # a model of a recording whose cause is not named is no finding
        title = f"{details.recording.name}, {details.diagnosis.verdict}: mass, damper, spring and bias"
    return extended_model(details.analysis if named else details.analysis.baseline(), title)


def require_usable(recording: Recording, as_is: bool) -> None:
    """Raises RecordingError: no diagnosis is possible, or (not `as_is`) the units are not plausible."""
    if not as_is and (asked := question(recording)) is not None:
        raise _doubt(recording, asked)
    check(recording)


def usable_recording(file: Path, columns: ColumnMapping, axis: str | None, as_is: bool) -> Recording:
    """The recording of a file that can be diagnosed; raises as `load_recording` and `require_usable`."""
    usable = partial(require_usable, as_is=as_is)
    recording = load_recording(file, columns, axis, force=True, check=usable)
    with units_of(recording.columns):
        usable(recording)
    return recording


def _doubt(recording: Recording, asked: Question) -> RecordingError:
    """Makes the error that asks about a doubtful quantity: an UnclearError with the unit in which it would be
    usual, where there is one, else a plain RecordingError.
    """
    text = recording.columns.get(asked.quantity)
    column, unit = parse_column(asked.quantity, text) if text else (asked.quantity, "")
    other = rescaled(asked.quantity, unit, asked.factor) if text else None
    doubt = f"{recording.source}: {column} {asked.text} (--as-is if that is true)"
    if other is None:
        return RecordingError(f"{doubt}; expected s, {shown_unit('m')} and {shown_unit('N')}")
    return UnclearError(f"{doubt}, in {other} it would be usual", {asked.quantity: f"{other}:{column}"})


def examine(task: Task, tell: Tell = lambda stage: None) -> tuple[Result, Callable[[], str]]:
    """Reads, diagnoses and predicts; returns the result without its page, and a function that draws that.

    On one core, for the arrays are small and threads would wait. The page raises RunError where it fails.

    Raises:
        InputError: the recording can not be read or diagnosed, or the given model fails on it; one line.
        RunError: the diagnosis failed where it should not have.
    """
    try:
        with threadpool_limits(1):
            return _examine(task, tell)
    except ForefeelError:
        raise
    except Exception as error:
        raise RunError(f"{task.file}: the diagnosis failed, {failure(error)}") from error


def attempt(task: Task) -> TaskOutcome:
    """Examines a recording and, with `task.page`, draws its page. Raises no error of the recording, but puts
    it into the outcome: InputError as `skipped`, RunError as `failed`, one of the page as `page_failed`
    beside the result.
    """
    try:
        result, page = examine(task)
    except InputError as error:
        return TaskOutcome(task, skipped=error.answered_by("diagnose", task.file))
    except RunError as error:
        return TaskOutcome(task, failed=" ".join(str(error).split()))
    if not task.page:
        return TaskOutcome(task, result)
    try:
        return TaskOutcome(task, replace(result, texts={**result.texts, PAGE: page()}))
    except RunError as error:
        return TaskOutcome(task, replace(result, page_failed=str(error)))


def _examine(task: Task, tell: Tell) -> tuple[Result, Callable[[], str]]:
    """Reads and diagnoses; predicts, if a cause is named and with `task.replay`; replays the model on
    `task.confirm`, if given. Returns the result and a function that draws its page, as `examine` does. Raises
    errors as they are; ConfigurationError where the given model's force is not finite. `tell` gets stages.
    """
    tell("reading")
    files = [task.file, *task.beside, *([task.confirm] if task.confirm else [])]
    usable = partial(require_usable, as_is=task.as_is)
    recordings = [load_recording(file, task.columns, task.axis, force=True, check=usable) for file in files]
    other = recordings.pop() if task.confirm else None
    if other is not None:
        with units_of(other.columns):
            require_usable(other, task.as_is)  # before the diagnosis, which takes longer
    judged = answered(recordings, tell, task.given, task.as_is)
    recording, diagnosis = judged.details.recording, judged.details.diagnosis
    if not isfinite(diagnosis.baseline.rmse_n):
        raise ConfigurationError(
            f"--model: the force of {task.given.name if task.given else 'the simulation'!r} along "
            f"{task.file} is not finite; expected a model in SI units"
        )
    named = diagnosis.names_causes
    model = judged.model
    across = None
    if named and task.replay:  # without a cause there is no other model to predict with
        tell("prediction")
        across = _prediction(recording, model, judged.details.analysis.regression.sense)
    replay = None
    if other is not None:
        tell("confirmation")
        replay = confirm(judged.details, other)
    texts = {MODEL: dump_mapping(model.to_mapping()), JSON: _document(judged.details, across, replay)}
    given = None if task.given is None else task.given.name
    runs = [run for run in (*recordings, other) if run is not None]
    taken = [(f"{run.name}: " if len(runs) > 1 else "") + run.taken for run in runs if run.taken]
    *lines, disclaimer = answer(recording, diagnosis, across, given)
    if replay is not None:
        with units_of(recording.columns):
            lines += labelled(confirmation_lines(replay))
    page = partial(_page, task, judged.details, across, replay)
    return Result(diagnosis, (*taken, *lines, disclaimer), texts, recording.columns), page


def _page(task: Task, diagnosed: Diagnosed, across: "Across | str | None", replay: Replay | None) -> str:
    """Text of report.html; RunError whatever fails in it."""
    try:
        from forefeel.results.page import render_page  # noqa: PLC0415 - loads what draws

        with threadpool_limits(1), units_of(diagnosed.recording.columns):
            return render_page(diagnosed.recording, diagnosed, across, task.given, replay)
    except Exception as error:
        raise RunError(f"{task.file}: diagnosed, but {PAGE} failed, {failure(error)}") from error


def _prediction(recording: Recording, model: ContactModel, sense: float) -> "Across | str | None":
    """Errors across a delay; None of a recording too short to be replayed; or why it failed, in one line.
    `sense`: multiplies the force, so that a positive one resists as that of the model does.
    """
    from forefeel.diagnosis.prediction import across_delay  # noqa: PLC0415 - loads the predictor

    try:
        assert recording.force_n is not None
        return across_delay(replace(recording, force_n=sense * recording.force_n), model)
    except RecordingError:
        return None
    except Exception as error:  # noqa: BLE001 - the verdict stands without it
        return failure(error)


def _document(diagnosed: Diagnosed, across: "Across | str | None", replay: Replay | None) -> str:
    """Text of diagnosis.json, with confirmation and prediction; what is not finite is null."""
    document = {
        **diagnosed.diagnosis.to_mapping(),
        "confirmation": None if replay is None else asdict(replay.confirmation),
        "prediction_300_ms": None if across is None or isinstance(across, str) else asdict(across),
    }
    return json.dumps(finite(document), indent=2, allow_nan=False) + "\n"


def finite(value: object) -> object:
    """The value for JSON: null in place of what is not finite, such as a ratio to nothing."""
    if isinstance(value, float):
        return value if isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: finite(item) for key, item in value.items()}
    return [finite(item) for item in value] if isinstance(value, list | tuple) else value
