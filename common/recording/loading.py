"""Recordings from files as people have them."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from forefeel.common.errors import ConfigurationError, RecordingError, UnclearError
from forefeel.common.recording import array_tables
from forefeel.common.recording.cleaning import clean
from forefeel.common.recording.columns import Choice, candidates, further, is_rotary, undecided
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.recording.recording import Array, Column, Recording
from forefeel.common.recording.ros_table import RosTable
from forefeel.common.recording.text_table import TextTable
from forefeel.common.recording.units import QUANTITIES, TO_SI, Mapping, Quantity


class Table(Protocol):
    """Columns of numbers by name; see `TextTable`."""

    names: Sequence[str]
    units: dict[str, str]
    notes: list[str]

    def read(self, names: Sequence[str]) -> list[Array]: ...


_TABLES: dict[str, Callable[[Path], Table]] = {
    ".csv": TextTable,
    ".tsv": TextTable,
    ".txt": TextTable,
    ".dat": TextTable,
    ".parquet": array_tables.parquet,
    ".xlsx": array_tables.spreadsheet,
    ".mat": array_tables.matlab,
    ".h5": array_tables.hdf5,
    ".hdf5": array_tables.hdf5,
    ".tdms": array_tables.tdms,
    ".bag": RosTable,
}
SUFFIXES = (*_TABLES, ".mcap")

_LIKELY: dict[Quantity, tuple[tuple[str, ...], tuple[float, float]]] = {
    "time": (("s", "ms", "us", "ns"), (1e-5, 0.1)),
    "position": (("m", "mm", "um"), (5e-5, 0.5)),
    "force": (("N", "mN"), (1e-3, 1e3)),
}
"""Interval, travel and force of benches in SI, and the units that are tried in turn."""
_LIKELY_ROTARY = {
    **_LIKELY,
    "position": (("rad", "deg"), (1e-3, 15.0)),
    "force": (("Nm", "mNm"), (1e-3, 1e3)),
}


def load(
    source: Any,  # noqa: ANN401 - a path, arrays, or a DataFrame
    *beside: Any,  # noqa: ANN401 - arrays
    time: str | None = None,
    position: str | None = None,
    force: str | None = None,
    axis: str | None = None,
) -> Recording:
    """A recording from a file, from arrays by name, or from a DataFrame.

    Args:
        source: a file of one of `SUFFIXES`; columns of equal shape (n,), by name, as a DataFrame or as a
            structured array; or, in s, m and N, an array of shape (n, 2) or (n, 3), or with `beside` of
            shape (n,), of time, position and, where it was measured, force.
        time, position, force: the columns, each as `unit:column`, such as `mm:laser`; by default those that
            their names tell. `Recording.taken` says which.
        axis: of a recorded run with several.

    Raises:
        UnclearError: which column is what, or in which unit, is not sure; the text says what to add.
        RecordingError: it can not be read or used.
    """
    mapping = Mapping(time, position, force)
    if isinstance(source, str | Path):
        return load_recording(Path(source), mapping, axis)
    return recording_of(array_tables.table_of(source, *beside), "data", "data", mapping)


def load_recording(
    path: Path, mapping: Mapping | None = None, axis: str | None = None, force: bool | None = None
) -> Recording:
    """The recording in a file of one of `SUFFIXES`.

    Which column is what, and its unit, is taken from the names where they say it. Rows that can not be used
    are dropped. `Recording.taken` tells both. `axis` chooses one of an MCAP file of ours; it may be left out
    when there is only one. `force`: whether it is needed; None: where it is there; False: not looked for.

    Raises:
        UnclearError: which column is what is not sure.
        RecordingError: one line that says where, which value, and what was expected.
    """
    suffix = path.suffix.lower()
    if suffix == ".mcap" and (run := Run(path)).axes:
        if mapping not in (None, Mapping()):
            raise RecordingError(f"{path}: a recorded run names its columns, expected no others")
        return run.to_recording(axis)
    if suffix not in SUFFIXES:
        raise RecordingError(f"{path}: suffix {suffix!r}, expected one of {', '.join(SUFFIXES)}")
    return recording_of(_TABLES.get(suffix, RosTable)(path), path.stem, str(path), mapping, force)


def recordings_in(folder: Path) -> list[Path]:
    """Sorted paths of the files with one of `SUFFIXES` in a folder; hidden files are left out.

    Raises:
        ConfigurationError: none, or the folder can not be read.
    """
    try:
        files = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    except OSError as error:
        raise ConfigurationError(f"{folder}: {error.strerror}; expected a folder that can be read") from error
    files = [path for path in files if not path.name.startswith(".")]
    if not files:
        raise ConfigurationError(f"{folder}: no recording; expected {', '.join(SUFFIXES)} files")
    return files


def recording_of(
    table: Table, name: str, source: str, mapping: Mapping | None = None, force: bool | None = None
) -> Recording:
    """The recording in a table, in SI and cleaned; see `load_recording`, also for what is raised. `source`:
    head of error texts. The time keeps its origin, but stamps since 1970 begin at 0.
    """
    chosen = _chosen(source, table, mapping or Mapping(), force)
    taken = [column for column, _ in chosen.values()]
    numbers = table.read(taken)
    factors = [TO_SI[quantity][unit] for quantity, (_, unit) in chosen.items()]
    time_s = (numbers[0] - _first(numbers[0])) * factors[0]
    values = np.array([column * factor for column, factor in zip(numbers[1:], factors[1:], strict=True)])
    beside = _further(table, taken, taken[-1])
    values = np.vstack([values, *(column.values for column in beside)])
    time_s, values, done = clean(time_s, values, len(chosen) - 1)
    if len(time_s) < 2:
        notes = "".join(f"; {note}" for note in done)
        raise RecordingError(f"{source}: {len(time_s)} sample(s){notes}, expected at least 2")
    columns = {quantity: f"{unit}:{column}" for quantity, (column, unit) in chosen.items()}
    force_n = values[1] if len(chosen) > 2 else None
    noted = tuple(dict.fromkeys((*table.notes, *done)))
    others = []
    for column, row in zip(beside, values[len(chosen) - 1 :], strict=True):
        known = np.isfinite(row)
        if np.mean(known) > _KNOWN:
            others.append(replace(column, values=np.interp(time_s, time_s[known], row[known])))
    return Recording(name, time_s, values[0], force_n, source, columns, noted, tuple(others))


_MOST_FURTHER = 8  # columns that are kept beside: a wide table costs no more memory
_KNOWN = 0.9  # share of its numbers that such a column needs


def _further(table: Table, taken: Collection[str], beside: str) -> list[Column]:
    """Columns besides those that are taken which state a unit, are numbers and change, at the stamps of the
    column `beside`.
    """
    stated = further([name for name in table.names if name not in taken], table.units)[:_MOST_FURTHER]
    if not stated:
        return []
    try:
        *read, _ = table.read([*(name for name, _, _ in stated), beside])
    except RecordingError:
        return []  # a fault in what nobody asked for
    pairs = zip(stated, read, strict=True)
    columns = [Column(name, unit, values * factor) for (name, unit, factor), values in pairs]
    return [c for c in columns if np.isfinite(c.values).any() and np.nanstd(c.values) > 0.0]


def _first(values: Array) -> float:
    """First of stamps since 1970, whose differences lose nothing; 0 for others: they keep their origin."""
    finite = values[np.isfinite(values)]
    return float(finite[0]) if len(finite) and abs(finite[0]) > 1e6 else 0.0


Chosen = dict[Quantity, tuple[str, str]]
"""Column and unit of each quantity."""


def _chosen(source: str, table: Table, mapping: Mapping, force: bool | None) -> Chosen:
    """Column and unit of each quantity, as given or by its name; a force that is not given is left out where
    `force` is False, or None and no column is named so. Raises UnclearError where in doubt, RecordingError
    where a given column is missing or none can be meant.
    """
    given = mapping.columns()
    for quantity, (column, _) in given.items():
        if column not in table.names:
            names = ", ".join(map(repr, table.names))
            raise RecordingError(f"{source}: no column {column!r} for the {quantity}, it has {names}")
    chosen: Chosen = {}
    doubts: dict[Quantity, str] = {}
    for quantity in QUANTITIES:
        if quantity == "force" and force is False and quantity not in given:
            continue
        if quantity in given:
            chosen[quantity] = given[quantity]
            continue
        taken = {column for column, _ in (*given.values(), *chosen.values())}
        named = candidates(table.names, table.units, quantity)
        choices = [choice for choice in named if choice.column not in taken]
        if len(choices) == 1 and choices[0].unit is not None:
            chosen[quantity] = choices[0].column, choices[0].unit
        elif choices or quantity != "force" or force:
            doubts[quantity] = _doubt(quantity, choices)
    if doubts:
        raise _unclear(source, table, chosen, doubts)
    return chosen


def _doubt(quantity: Quantity, choices: Sequence[Choice]) -> str:
    if not choices:
        return f"no {quantity}: no column is named so"
    if len(choices) == 1:
        return f"no unit of {choices[0].column!r} is stated"
    return f"{', '.join(repr(choice.column) for choice in choices)} may each be the {quantity}"


def _unclear(source: str, table: Table, chosen: Chosen, doubts: dict[Quantity, str]) -> RecordingError:
    """UnclearError on what is in doubt, with columns and units that are likely by names, place and numbers.
    Raises RecordingError where no column can be meant. `doubts`: what is not sure, by quantity.
    """
    free = [name for name in table.names if name not in {column for column, _ in chosen.values()}]
    likely: dict[str, str] = {}
    for quantity, doubt in doubts.items():
        named = candidates(free, table.units, quantity) or undecided(free, table.units, quantity)
        numbers = {choice.column: _numbers(table, choice.column) for choice in named}
        fits = [choice for choice in named if _fits(quantity, numbers[choice.column])]
        if not fits:
            names = ", ".join(map(repr, table.names))
            raise RecordingError(
                f"{source}: {doubt}; it has {names}, expected {quantity} = UNIT:COLUMN with one that changes"
            )
        best = fits[0]
        unit = best.unit or _likely_unit(quantity, best.column, numbers[best.column])
        likely[quantity] = f"{unit}:{best.column}"
        free.remove(best.column)
    return UnclearError(f"{source}: {'; '.join(doubts.values())}", likely)


def _numbers(table: Table, name: str) -> Array:
    try:
        return table.read([name])[0]
    except RecordingError:
        return np.empty(0)


def _fits(quantity: Quantity, values: Array) -> bool:
    """True if a column may be that quantity: it changes, and a time mostly grows."""
    values = values[np.isfinite(values)]
    if len(values) < 2 or np.ptp(values) == 0.0:
        return False
    return quantity != "time" or float(np.mean(np.diff(values) >= 0.0)) > 0.99


def _likely_unit(quantity: Quantity, name: str, values: Array) -> str:
    """The first unit with which a bench is as large, as fast and as strong as benches are."""
    values = values[np.isfinite(values)]
    steps = np.diff(values)
    size = float(np.median(steps[steps > 0.0]) if quantity == "time" else np.ptp(values))
    units, (least, most) = (_LIKELY_ROTARY if is_rotary(name) else _LIKELY)[quantity]
    return next((unit for unit in units if least <= size * TO_SI[quantity][unit] <= most), units[0])
