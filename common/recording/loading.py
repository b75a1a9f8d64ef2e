"""Recordings from files as people have them."""

from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from forefeel.common.errors import ConfigurationError, RecordingError, UnclearError, UntimedError
from forefeel.common.recording import array_tables
from forefeel.common.recording.cleaning import COMMON, clean, unwrapped, without_full_scale, without_tares
from forefeel.common.recording.columns import Choice, candidates, further
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.recording.proposals import ReadOnce, Table, different, doubt_about, propose
from forefeel.common.recording.recording import Array, Column, Recording
from forefeel.common.recording.ros_table import RosTable
from forefeel.common.recording.text_table import TextTable
from forefeel.common.recording.units import QUANTITIES, TO_SI, Mapping, Quantity, si_of

_TABLES: dict[str, Callable[[Path], Table]] = {
    ".csv": TextTable,
    ".tsv": TextTable,
    ".txt": TextTable,
    ".dat": TextTable,
    ".parquet": array_tables.parquet,
    ".xlsx": array_tables.spreadsheet,
    ".npz": array_tables.numpy_archive,
    ".mat": array_tables.matlab,
    ".h5": array_tables.hdf5,
    ".hdf5": array_tables.hdf5,
    ".tdms": array_tables.tdms,
    ".bag": RosTable,
}
SUFFIXES = (*_TABLES, ".mcap")
Check = Callable[[Recording], None]


def load(
    source: Any,  # noqa: ANN401 - a path, arrays, or a DataFrame
    *beside: Any,  # noqa: ANN401 - arrays
    time: str | None = None,
    position: str | None = None,
    force: str | None = None,
    axis: str | None = None,
    rate_hz: float | None = None,
) -> Recording:
    """Loads a recording from a file, from arrays, or from a DataFrame.

    Args:
        source: a file of one of `SUFFIXES`; columns of equal shape (n,), by name, as a DataFrame or as a
            structured array; or, in s, m and N, an array of shape (n, 2) or (n, 3), or with `beside` of shape
            (n,), of time, position and, where it was measured, force.
        time, position, force: the columns, each as `unit:column`, such as `mm:laser`; by default chosen by
            their names. `Recording.taken` says which.
        axis: of a recorded run with several.
        rate_hz: of the rows, where no column has their time.

    Raises:
        UnclearError: which column is what, or in which unit, is not sure; the text says what to add.
        RecordingError: it can not be read or used.
    """
    mapping = Mapping(time, position, force, rate_hz)
    if isinstance(source, str | Path):
        return load_recording(Path(source), mapping, axis)
    return recording_of(array_tables.table_of(source, *beside), "data", "data", mapping)


def load_recording(
    path: Path,
    mapping: Mapping | None = None,
    axis: str | None = None,
    force: bool | None = None,
    check: Check = lambda _: None,
) -> Recording:
    """Loads the recording in a file of one of `SUFFIXES`, or in the folder of a LeRobot data set.

    Columns and units that `mapping` does not give are chosen by their names. Rows that can not be used are
    dropped. `Recording.taken` tells both. `axis` chooses one of an MCAP file of ours; it may be left out when
    there is only one; such a file takes no `mapping` and ignores `force` and `check`. `force`: True: it is
    needed; None: taken where it is there; False: not looked for. `check` raises a RecordingError for a
    recording of no use: an UnclearError offers only what passes it.

    Raises:
        UnclearError: which column is what is not sure.
        UntimedError: no column has the time, and `mapping` no rate.
        RecordingError: one line that says where, which value, and what was expected.
    """
    suffix = ".parquet" if array_tables.is_data_set(path) else path.suffix.lower()
    if suffix == ".mcap" and (run := Run(path)).axes:
        if mapping not in (None, Mapping()):
            raise RecordingError(f"{path}: a recorded run names its columns, expected no others")
        return run.to_recording(axis)
    if suffix not in SUFFIXES:
        raise RecordingError(f"{path}: suffix {suffix!r}, expected one of {', '.join(SUFFIXES)}")
    table = RosTable(path, run.truncated) if suffix == ".mcap" else _TABLES[suffix](path)
    return recording_of(table, path.stem, str(path), mapping, force, check)


def recordings_in(folder: Path) -> list[Path]:
    """Sorted paths of the recordings in a folder: files with one of `SUFFIXES` that are not hidden; of a
    LeRobot data set the folder itself.

    Raises:
        ConfigurationError: none, or the folder can not be read.
    """
    if array_tables.is_data_set(folder):
        return [folder]
    try:
        files = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    except OSError as error:
        raise ConfigurationError(f"{folder}: {error.strerror}; expected a folder that can be read") from error
    files = [path for path in files if not path.name.startswith(".")]
    if not files:
        raise ConfigurationError(f"{folder}: no recording; expected {', '.join(SUFFIXES)} files")
    return files


def recording_of(
    table: Table,
    name: str,
    source: str,
    mapping: Mapping | None = None,
    force: bool | None = None,
    check: Check = lambda _: None,
) -> Recording:
    """Makes the recording of a table, in SI, cleaned and without steps of the force's zero; see
    `load_recording`, also for what is raised. `source`: head of error texts. The time keeps its origin, but
    stamps since 1970 begin at 0.
    """
    mapping, columns = mapping or Mapping(), ReadOnce(table)
    chosen, doubts, equals = _chosen(source, columns, mapping, force)
    if doubts:

        def trial(answered: Mapping) -> None:
            check(recording_of(columns, name, source, answered, force))

        raise _unclear(source, columns, mapping, chosen, doubts, trial)
    notes = [f"{column} equals {first} in every row" for column, first in equals.items()]
    time_s, rows = _in_si(table, chosen, mapping.rate_hz, notes)
    names = [chosen[quantity][0] for quantity in QUANTITIES[1:] if quantity in chosen]
    beside = _further(table, {*(column for column, _ in chosen.values()), *equals})
    time_s, values, done = clean(time_s, np.vstack([*rows, *(c.values for c in beside)]), names)
    notes = list(dict.fromkeys((*table.notes, *notes, *done)))
    if len(time_s) < 2:
        left = "; ".join([f"{len(time_s)} sample(s)", *notes])
        raise RecordingError(f"{source}: {left}, expected at least 2")
    if np.any(np.diff(time_s) <= 0.0):
        raise RecordingError(
            f"{source}: {len(time_s):,} rows share {len(np.unique(time_s)):,} stamps: their digits are lost; "
            f"expected all digits, or {_RATE}"
        )
    force_n = values[1] if len(rows) > 1 else None
    if force_n is not None:
        force_n, steps = without_tares(time_s, values[0], force_n, si_of("force", chosen["force"][1]))
        notes += steps
    others = []
    for column, row in zip(beside, values[len(rows) :], strict=True):
        there = np.isfinite(row)
        if np.mean(there) > COMMON:
            others.append(replace(column, values=np.interp(time_s, time_s[there], row[there])))
    texts = {quantity: f"{unit}:{column}" for quantity, (column, unit) in chosen.items()}
    return Recording(name, time_s, values[0], force_n, source, texts, tuple(notes), tuple(others))


def _in_si(
    table: Table, chosen: "Chosen", rate_hz: float | None, notes: list[str]
) -> tuple[Array, list[Array]]:
    """Reads the chosen columns in SI: time, by stamps or by `rate_hz`, and the others. Wraps of the time are
    continued, stamps since 1970 shifted to begin at 0, full scales set to NaN; adds to `notes`.
    """
    columns = table.read([column for column, _ in chosen.values()])
    read = dict(zip(chosen, columns, strict=True))
    if rate_hz is None:
        to_s = TO_SI["time"][chosen["time"][1]]
        stamps, done = unwrapped(read.pop("time"), to_s)
        finite = stamps[np.isfinite(stamps)]
        since_1970 = len(finite) and abs(finite[0]) > _LATEST_OWN_ORIGIN
        time_s = (stamps - finite[0] if since_1970 else stamps) * to_s
    else:
        stamped = [c.column for c in candidates(table.names, table.units, "time") if c.named]
        instead = f", not by {', '.join(map(repr, stamped))}" if stamped else ""
        time_s, done = np.arange(len(columns[0])) / rate_hz, [f"rows at {rate_hz:g} Hz{instead}"]
    notes += done
    rows = []
    for quantity, values in read.items():
        column, unit = chosen[quantity]
        known, done = without_full_scale(values, column)
        rows.append(known * TO_SI[quantity][unit])
        notes += done
    return time_s, rows


_RATE = "the rate of the rows in Hz, such as --rate 50 (in Python rate_hz=50)"
_LATEST_OWN_ORIGIN = 1e6  # in the unit of the column: larger first stamps count from 1970 and begin at 0
_MOST_FURTHER = 8  # columns that are kept beside: a wide table costs no more memory


def _further(table: Table, taken: Collection[str]) -> list[Column]:
    """Reads in SI the first 8 columns, not in `taken`, that state a known unit and change; none at all
    if one of those tried can not be read.
    """
    stated = further([name for name in table.names if name not in taken], table.units)
    changing = list[Column]()
    while stated and len(changing) < _MOST_FURTHER:
        some, stated = stated[:_MOST_FURTHER], stated[_MOST_FURTHER:]
        try:
            read = table.read([name for name, _, _ in some])
        except RecordingError:
            return []  # a fault in what nobody asked for
        columns = (Column(name, unit, v * factor) for (name, unit, factor), v in zip(some, read, strict=True))
        changing += [c for c in columns if np.isfinite(c.values).any() and np.nanstd(c.values) > 0.0]
    return changing[:_MOST_FURTHER]


Chosen = dict[Quantity, tuple[str, str]]
"""Column and unit of each quantity."""
Doubts = dict[Quantity, list[Choice]]
"""Columns that may hold a quantity."""


def _chosen(
    source: str, table: Table, mapping: Mapping, force: bool | None
) -> tuple[Chosen, Doubts, dict[str, str]]:
    """Column and unit of each quantity, as given or by its name; the candidates of each quantity in doubt;
    and the columns that equal another one, by name. No force where `force` is False, or None and no column is
    named so; no time where a rate is given. Raises RecordingError where a given column is missing.
    """
    chosen, doubts, equals = dict(mapping.columns()), Doubts(), dict[str, str]()
    for quantity, (column, _) in chosen.items():
        if column not in table.names:
            raise RecordingError(f"{source}: no column {column!r} for the {quantity}, it has {_names(table)}")
    wanted = [q for q in QUANTITIES if q != "time" or mapping.rate_hz is None]
    for quantity in wanted:
        if quantity in chosen or (quantity == "force" and force is False):
            continue
        taken = {column for column, _ in chosen.values()}
        choices = candidates([name for name in table.names if name not in taken], table.units, quantity)
        choices = different(table, quantity, choices, equals)
        if len(choices) == 1 and choices[0].unit is not None and choices[0].named:
            chosen[quantity] = choices[0].column, choices[0].unit
        elif quantity != "force" or force or any(choice.named for choice in choices):
            doubts[quantity] = choices
    return {quantity: chosen[quantity] for quantity in wanted if quantity in chosen}, doubts, equals


def _names(table: Table) -> str:
    return ", ".join(map(repr, table.names))


def _unclear(
    source: str,
    table: Table,
    mapping: Mapping,
    chosen: Chosen,
    doubts: Doubts,
    trial: Callable[[Mapping], None],
) -> RecordingError:
    """Makes the error on what is in doubt: an UnclearError with likely columns and units, and with what
    `trial` of them asks for besides. A RecordingError if some have no likely column (UntimedError if the time
    is one), or if `trial` refuses them.
    """
    likely: dict[Any, Any] = propose(table, chosen, doubts)
    doubt = f"{source}: {'; '.join(doubt_about(*item) for item in doubts.items())}"
    answers = ", ".join(f"{quantity} = {likely.get(quantity, 'UNIT:COLUMN')}" for quantity in doubts)
    if len(likely) < len(doubts):
        lacking = f"{doubt}; it has {_names(table)}, expected {answers}"
        timed = "time" in likely or "time" not in doubts
        return RecordingError(lacking) if timed else UntimedError(f"{lacking}; or {_RATE}")
    try:
        trial(replace(mapping, **likely))
    except UnclearError as odd:
        likely |= odd.columns
    except RecordingError as error:
        return RecordingError(f"{doubt}; with {answers}: {str(error).removeprefix(f'{source}: ')}")
    return UnclearError(doubt, likely)
