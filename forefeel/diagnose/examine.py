"""One recording from the file to the texts of its results; nothing is written."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from threadpoolctl import threadpool_limits

from forefeel.common.causes.model import ContactModel
from forefeel.common.errors import ConfigurationError, RecordingError, RunError
from forefeel.common.recording.recording import Recording
from forefeel.common.recording.tabular import load_recording
from forefeel.common.recording.units import NamedColumns, mapping_of
from forefeel.common.yaml_file import dump_mapping
from forefeel.diagnose.answer import answer
from forefeel.diagnosis.diagnose import Diagnosed, diagnose, diagnose_together
from forefeel.diagnosis.extended import extended_model
from forefeel.diagnosis.verdict import Diagnosis
from forefeel.terminal import Tell

if TYPE_CHECKING:
    from forefeel.diagnosis.prediction import Across

JSON, PAGE, MODEL = "diagnosis.json", "report.html", "model.yaml"
FILES = MODEL, PAGE, JSON
"""In the order in which they are written: who finds the document finds the rest."""


@dataclass(frozen=True, slots=True)
class Task:
    """What to diagnose. `given` is the simulation to compare with; `axis` one of an MCAP file.

    `beside`: further recordings of the same bench, for one answer to all. `replay`: whether the force is
    predicted across a delay, too. `page`: whether report.html is made.
    """

    file: Path
    beside: tuple[Path, ...] = ()
    columns: NamedColumns = (None, None, None)
    axis: str | None = None
    given: ContactModel | None = None
    replay: bool = True
    page: bool = True


@dataclass(frozen=True, slots=True)
class Result:
    """The diagnosis, the short answer and the text of each of `FILES` that was asked for."""

    diagnosis: Diagnosis
    lines: tuple[str, ...]
    texts: Mapping[str, str]


def examine(task: Task, tell: Tell = lambda stage: None) -> Result:
    """Reads, diagnoses, predicts, draws; on one core, for the arrays are small and threads would wait.

    Raises:
        InputError: the recording can not be read or diagnosed, or the given model fails on it; one line.
        RunError: the diagnosis failed where it should not have.
    """
    try:
        with threadpool_limits(1):
            return _examined(task, tell)
    except (ArithmeticError, LookupError, ValueError, MemoryError) as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise RunError(f"{task.file}: the diagnosis failed, {reason}") from error


def _examined(task: Task, tell: Tell) -> Result:
    tell("reading")
    recordings = [load_recording(f, mapping_of(task.columns), task.axis) for f in (task.file, *task.beside)]
    if task.beside:
        diagnosed = diagnose_together(recordings, tell, task.given)
    else:
        diagnosed = diagnose(recordings[0], tell, task.given)
    recording = diagnosed.recording
    if not isfinite(diagnosed.diagnosis.baseline.rmse_n):
        raise ConfigurationError(
            f"--model: the force of {task.given.name if task.given else 'the simulation'!r} along "
            f"{task.file} is not finite; expected a model in SI units"
        )
    named = diagnosed.diagnosis.verdict == "cause_found"
    analysis = diagnosed.analysis if named else diagnosed.analysis.baseline()
    model = extended_model(analysis, _title(recording, diagnosed.diagnosis))
    across = None
    if named and task.replay:  # without a cause there is no other model to predict with
        tell("prediction")
        across = _prediction(recording, model)
    texts = {MODEL: dump_mapping(model.to_mapping())}
    if task.page:
        from forefeel.diagnose.page import render_page  # noqa: PLC0415 - loads what draws

        tell("report")
        texts[PAGE] = render_page(recording, diagnosed, across, task.given, texts[MODEL])
    texts[JSON] = _document(diagnosed, across)
    given = None if task.given is None else task.given.name
    return Result(diagnosed.diagnosis, tuple(answer(recording, diagnosed.diagnosis, across, given)), texts)


def _title(recording: Recording, diagnosis: Diagnosis) -> str:
    """The model's name: a model of a recording whose cause is not named is no finding."""
    if diagnosis.verdict == "cause_found":
        return f"{recording.name}, extended by its diagnosis"
    return f"{recording.name}, {diagnosis.verdict}: mass, damper, spring and bias"


def _prediction(recording: Recording, model: ContactModel) -> "Across | None":
    from forefeel.diagnosis.prediction import across_delay  # noqa: PLC0415 - loads the predictor

    try:
        return across_delay(recording, model)
    except RecordingError:  # too short to be replayed
        return None


def _document(diagnosed: Diagnosed, across: "Across | None") -> str:
    document = {
        **diagnosed.diagnosis.to_mapping(),
        "prediction_300_ms": None if across is None else across.to_mapping(),
    }
    return json.dumps(_finite(document), indent=2, allow_nan=False) + "\n"


def _finite(value: object) -> object:
    """As JSON can hold it: null for what is not finite, such as a ratio to nothing."""
    if isinstance(value, float):
        return value if isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    return [_finite(item) for item in value] if isinstance(value, list | tuple) else value
