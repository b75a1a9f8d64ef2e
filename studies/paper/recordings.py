"""Measured recordings to compare on: every table or run of the folders that were named."""

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from forefeel.common.errors import ConfigurationError, RecordingError
from forefeel.common.recording.recording import Recording
from forefeel.common.recording.tabular import load_recording
from forefeel.diagnosis.evaluation.arrivals import DelayedLink, arrivals
from forefeel.diagnosis.evaluation.methods import Forefeel
from forefeel.diagnosis.evaluation.replay import replay
from forefeel.loopback.plan import resisting_sign
from forefeel.studies.paper.assemble import DELAY_S
from forefeel.studies.paper.contact import Array
from forefeel.studies.paper.online import held
from forefeel.studies.paper.replay import SCORED_FROM_S, ReplayedRun

VARIABLE = "FOREFEEL_DATA"
_SUFFIXES = ".csv", ".parquet", ".mcap"
_LEAST_S = 1.0  # s of a recording that are scored at least


def folders_to_read(given: Sequence[Path]) -> list[Path]:
    """What was given, or the folder of the environment variable FOREFEEL_DATA; may be none.

    Raises:
        ConfigurationError: one of them is no folder.
    """
    variable = os.environ.get(VARIABLE, "")
    named = [("--recordings", path) for path in given] or ([(VARIABLE, Path(variable))] if variable else [])
    for where, path in named:
        if not path.is_dir():
            raise ConfigurationError(f"{where} {path}: no such folder; expected a folder of recordings")
    return [path for _, path in named]


def recorded_runs(
    folders: Sequence[Path], progress: Callable[[str], None]
) -> tuple[list[ReplayedRun], dict[str, str]]:
    """The recordings with motion and force, by name; and those that can not be used, with the reason."""
    runs: dict[str, ReplayedRun] = {}
    skipped: dict[str, str] = {}
    for folder in folders:
        for path in sorted(folder.iterdir()):
            if path.suffix.lower() not in _SUFFIXES:
                continue
            name = path.stem if path.stem not in runs else str(path)
            progress(f"recording {name}")
            try:
                runs[name] = _run(name, path)
            except RecordingError as error:
                skipped[name] = str(error).removeprefix(f"{path}: ")
    return list(runs.values()), skipped


def _run(name: str, path: Path) -> ReplayedRun:
    """Raises RecordingError: unreadable, without force, or too short."""
    recording = load_recording(path)
    if recording.force_n is None:
        raise RecordingError("no force column")
    least_s = SCORED_FROM_S + DELAY_S + _LEAST_S
    if recording.duration_s < least_s:
        raise RecordingError(f"{recording.duration_s:.3g} s, expected at least {least_s:g} s")
    turned = replace(recording, force_n=resisting_sign(recording) * recording.force_n)
    return ReplayedRun(name, turned, product_prediction(turned, DELAY_S))


def product_prediction(recording: Recording, delay_s: float) -> Array:
    """The product's force for each sample, shape (n,); before anything has arrived the held one.

    As in `forefeel evaluate` it sees only what has arrived.
    """
    assert recording.force_n is not None
    trace = replay(recording, arrivals(recording.time_s, DelayedLink(delay_s)), Forefeel(None))
    return np.where(trace.answered, trace.force_n, held(recording.time_s, recording.force_n, delay_s))
