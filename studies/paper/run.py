"""`forefeel reproduce`, from the options to the files."""

import os
import shutil
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from forefeel.common.errors import ConfigurationError
from forefeel.files import whole
from forefeel.interrupt import ends_in_order, heeded
from forefeel.studies.paper.assemble import assemble
from forefeel.studies.paper.bench import FIGURES, STYLES, bench_run
from forefeel.studies.paper.page import draw_all, render_page, short_table
from forefeel.studies.paper.recordings import folders_to_read, recorded_runs
from forefeel.studies.paper.replay import ReplayedRun
from forefeel.studies.paper.results import Reproduction
from forefeel.terminal import Tell, answer, stages

_JSON, _PAGE = "reproduction.json", "reproduction.html"
_OURS = "figure_*.png", "flaw_?.png", "thresholds.png", _JSON, _PAGE
_ROOM_BYTES = 50e6  # free space that is asked for; page and figures take 3 MB


def run_reproduction(
    out: Path, overwrite: bool, recordings: Sequence[Path], seed: int, duration_s: float
) -> Reproduction:
    """Runs the bench, works everything out, writes the files, prints the short table.

    Args:
        out: the folder; overwrite: whether an earlier result in it may be replaced.
        recordings: folders of measured recordings; none: what FOREFEEL_DATA names.
        seed: of operator, world and network. duration_s: of each run of the bench.

    Raises:
        InputError: a folder can not be used; nothing was changed.
        RunError: the bench failed, or the files can not be written.
    """
    folders = folders_to_read(recordings)
    with ends_in_order("reproduction", out) as written:
        _prepare(out, overwrite)
        with stages("reproduce") as tell:
            numbers, files = _worked_out(folders, seed, duration_s, tell)
        _write(out, files)
        written.extend(files)
    answer(*short_table(numbers, out), document=numbers.to_json)
    return numbers


def _worked_out(
    folders: Sequence[Path], seed: int, duration_s: float, tell: Tell
) -> tuple[Reproduction, dict[str, bytes]]:
    """The numbers, and what each file holds."""
    runs = _bench(duration_s, seed, tell)
    skipped: Mapping[str, str] | None = None
    if folders:
        measured, skipped = recorded_runs(folders, tell)
        runs += measured
    numbers, traces = assemble(runs, skipped, STYLES, seed, tell)
    tell("figures and page")
    drawings = draw_all(numbers, traces)
    files = {f"{name}.png": drawing.png for name, drawing in drawings.items()}
    files[_PAGE] = render_page(numbers, drawings).encode()
    files[_JSON] = numbers.to_json().encode()
    return numbers, files


def _bench(duration_s: float, seed: int, tell: Tell) -> list[ReplayedRun]:
    runs = []
    for instrument in FIGURES:
        for style in STYLES:
            tell(f"simulated bench: {instrument}, {style}, {duration_s:g} s")
            runs.append(bench_run(instrument, style, duration_s, seed))
    return runs


def _prepare(folder: Path, overwrite: bool) -> None:
    """Makes the folder where it is missing; refuses one that can not be used, or holds an earlier result."""
    if folder.exists() and not folder.is_dir():
        raise ConfigurationError(f"--out {folder}: is a file; expected a folder")
    if not overwrite and any(next(folder.glob(pattern), None) for pattern in _OURS):
        raise ConfigurationError(
            f"--out {folder}: holds an earlier result; expected another folder, or --overwrite"
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK):
            raise ConfigurationError(f"--out {folder}: not writable; expected a folder that can be written")
        if shutil.disk_usage(folder).free < _ROOM_BYTES:
            raise ConfigurationError(f"--out {folder}: less than 50 MB free; expected room for the figures")
    except OSError as error:
        raise ConfigurationError(
            f"--out {folder}: {error.strerror}; expected a folder that can be written"
        ) from error


def _write(folder: Path, files: Mapping[str, bytes]) -> None:
    """All beside their places first, then into them: a reader sees the old file or the new one, whole."""
    with heeded(), ExitStack() as parts:
        for name, content in files.items():
            parts.enter_context(whole(folder / name, "the result")).write_bytes(content)
