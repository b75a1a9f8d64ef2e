"""One recording from the file to the texts of its results; nothing is written."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from threadpoolctl import threadpool_limits

from forefeel.columns import Columns, mapping_of
from forefeel.common.effects.model import ContactModel
from forefeel.common.errors import ConfigurationError, RecordingError, RunError
from forefeel.common.recording.recording import Recording
from forefeel.common.recording.tabular import load_recording
from forefeel.common.yaml_file import dump_mapping
from forefeel.diagnose.page import render_page
from forefeel.diagnose.words import answer
from forefeel.diagnosis.diagnose import Diagnosed, diagnose
from forefeel.diagnosis.diagnose.diagnose import check
from forefeel.diagnosis.diagnose.extended import extended_model
from forefeel.diagnosis.diagnose.prediction import Across, across_delay
from forefeel.diagnosis.diagnose.verdict import Diagnosis
from forefeel.terminal import Tell

JSON, PAGE, MODEL = "diagnosis.json", "report.html", "model.yaml"
FILES = MODEL, PAGE, JSON
"""In the order in which they are written: who finds the document finds the rest."""


@dataclass(frozen=True, slots=True)
class Task:
    """What to diagnose. `given` is the simulation to compare with; `axis` one of an MCAP file."""

    file: Path
    columns: Columns = (None, None, None)
    axis: str | None = None
    given: ContactModel | None = None


@dataclass(frozen=True, slots=True)
class Result:
    """The diagnosis, the short answer and the text of each of `FILES`."""

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
    recording = load_recording(task.file, mapping_of(task.columns), task.axis)
    check(recording)
    diagnosed = diagnose(recording, tell, task.given)
    if not isfinite(diagnosed.diagnosis.baseline.rmse_n):
        raise ConfigurationError(
            f"--model: the force of {task.given.name if task.given else 'the simulation'!r} along "
            f"{task.file} is not finite; expected a model in SI units"
        )
    model = extended_model(diagnosed.analysis, _title(recording, diagnosed.diagnosis))
    tell("prediction")
    across = _prediction(recording, model)
    tell("report")
    yaml = dump_mapping(model.to_mapping())
    texts = {
        MODEL: yaml,
        PAGE: render_page(recording, diagnosed, across, task.given, yaml),
        JSON: _document(diagnosed, across),
    }
    given = None if task.given is None else task.given.name
    return Result(diagnosed.diagnosis, tuple(answer(recording, diagnosed.diagnosis, across, given)), texts)


def _title(recording: Recording, diagnosis: Diagnosis) -> str:
    """The model's name: a model of a recording whose cause is not named is no finding."""
    if diagnosis.verdict == "cause_found":
        return f"{recording.name}, extended by its diagnosis"
    return f"{recording.name}, {diagnosis.verdict}: fits this recording and is no finding"


def _prediction(recording: Recording, model: ContactModel) -> Across | None:
    try:
        return across_delay(recording, model)
    except RecordingError:  # too short to be replayed
        return None


def _document(diagnosed: Diagnosed, across: Across | None) -> str:
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
