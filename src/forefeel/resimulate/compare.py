"""Compares what was predicted in recorded sessions with what this version predicts in them."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import geometric_mean
from time import process_time

import numpy as np
from rich.table import Table

from forefeel.common.daemon import software_version
from forefeel.common.error_size import ErrorSize, Floats, error_size
from forefeel.common.errors import RecordingError, RunError
from forefeel.common.events.text import quantity
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.topics import HAPTICS, MASTER_HANDSHAKE
from forefeel.report.traces import axis_traces
from forefeel.report.wording import ratio, share
from forefeel.resimulate.session import resimulate
from forefeel.terminal import answer, table


@dataclass(frozen=True, slots=True)
class VersionScore:
    """Error of a version's predictions; `coverage_95`: share of the forces in their band."""

    version: str
    error: ErrorSize
    coverage_95: float


@dataclass(frozen=True, slots=True)
class Resimulated:
    """One axis of a recorded session, then and now, on the same `scored` of all `commands`.

    `identical`: share of the predictions with their bands that are equal bit for bit; `difference`: between
    both predictions. `ratio`: rms error now over then. `lost`: messages that the recording lacks. `speed`:
    seconds of the session by second of processor.
    """

    file: str
    axis: str
    commands: int
    scored: int
    identical: float
    difference: ErrorSize
    recorded: VersionScore
    now: VersionScore
    zoh: ErrorSize
    ratio: float
    lost: int
    speed: float


def run_resimulation(files: Sequence[Path], require_identical: bool, no_worse: float | None) -> None:
    """Resimulates every axis of the recordings and prints a table of each.

    Raises:
        RecordingError: one of them can not be resimulated; nothing was printed.
        RunError: after the tables: a prediction differs, with `require_identical`, or the rms error of a
            session is over `no_worse` times the recorded one.
    """
    sessions = [_resimulated(run, axis) for run in map(Run, files) for axis in run.axes or ("none",)]
    mean = geometric_mean([session.ratio for session in sessions])
    text = f"rms now / then of {len(sessions)} sessions, geometric mean: {ratio(mean)}"
    document = {"schema": "forefeel.resimulation/1", "ratio": mean, "sessions": [*map(asdict, sessions)]}
    parts = (part for session in sessions for part in (_title(session), _table(session)))
    answer(*parts, *[text][: len(sessions) - 1], document=lambda: document)
    for session in sessions:
        name = f"{session.file}, axis {session.axis}"
        if require_identical and session.identical < 1.0:
            raise RunError(
                f"{name}: {share(session.identical)} of the predictions are identical, expected all"
            )
        if no_worse is not None and session.ratio > no_worse:
            raise RunError(f"{name}: rms now / then {session.ratio:.4g}, expected at most {no_worse:g}")


def _resimulated(run: Run, axis: str) -> Resimulated:
    """Predicts one axis of a session anew, and scores recorded and new predictions over the commands that
    have both, a measured force and a late one. RecordingError: it can not be predicted, or no prediction has
    an error.
    """
    begun_s = process_time()
    now_n, lost = resimulate(run, axis)
    spent_s = process_time() - begun_s
    commands = axis_traces(run, axis).commands
    then_n = np.array([commands.predicted_n, commands.low_n, commands.high_n])
    equal = ((then_n == now_n) | (np.isnan(then_n) & np.isnan(now_n))).all(axis=0)
    predicted = ~np.isnan([then_n[0], now_n[0]])
    rows = predicted.all(axis=0) & np.isfinite(commands.zoh_n + commands.force_n)
    force_n, software = commands.force_n[rows], next(run.messages(axis, MASTER_HANDSHAKE)).software
    recorded = _score(software, then_n[:, rows], force_n)
    now = _score(f"forefeel {software_version()}", now_n[:, rows], force_n)
    if not recorded.error.rms_n or now.error.rms_n is None:
        raise RecordingError(f"{run.path}: axis {axis}: nothing to compare, no prediction has an error")
    return Resimulated(
        file=run.path.name,
        axis=axis,
        commands=len(rows),
        scored=len(force_n),
        identical=float(np.mean(equal[predicted.any(axis=0)])),
        difference=error_size(now_n[0, predicted.all(axis=0)], then_n[0, predicted.all(axis=0)]),
        recorded=recorded,
        now=now,
        zoh=error_size(commands.zoh_n[rows], force_n),
        ratio=now.error.rms_n / recorded.error.rms_n,
        lost=lost,
        speed=float(np.ptp(run.column(axis, HAPTICS, "stamp_ns"))) * 1e-9 / spent_s,
    )


def _score(version: str, predictions_n: Floats, force_n: Floats) -> VersionScore:
    predicted_n, low_n, high_n = predictions_n
    inside = (low_n <= force_n) & (force_n <= high_n)
    return VersionScore(
        version, error_size(predicted_n, force_n), float(np.mean(inside)) if len(inside) else 0.0
    )


def _title(session: Resimulated) -> str:
    lost = f"; {session.lost} messages were not recorded" if session.lost else ""
    return (
        f"{session.file}, axis {session.axis}: {share(session.identical)} of the predictions identical, "
        f"{session.scored} of {session.commands} commands scored{lost}; {session.speed:.0f} x real time"
    )


def _table(session: Resimulated) -> Table:
    """Table of recorded and new predictions, their difference, and the zero-order hold."""
    numbers = "rms", "p95", "worst", "in the 95 % band"
    made = table("", *numbers, right=numbers)
    for name, error, coverage in (
        (f"recorded by {session.recorded.version}", session.recorded.error, session.recorded.coverage_95),
        (
            f"now {session.now.version}, {ratio(session.ratio)} of it",
            session.now.error,
            session.now.coverage_95,
        ),
        ("difference of the two", session.difference, None),
        ("zero-order hold", session.zoh, None),
    ):
        made.add_row(name, *(quantity(n, "N") for n in asdict(error).values()), share(coverage))
    return made
