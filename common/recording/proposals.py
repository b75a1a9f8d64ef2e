"""Columns and units that are likely meant where names leave it open: by names, place and numbers."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np

from forefeel.common.errors import RecordingError
from forefeel.common.recording.columns import Choice, axis_of, is_of_a_joint, is_rotary, words_of
from forefeel.common.recording.recording import Array
from forefeel.common.recording.units import QUANTITIES, TO_SI, Quantity

Ranges = dict[Quantity, dict[str, tuple[float, float]]]
_LIKELY: Ranges = {
    "time": {"s": (1e-5, 0.1), "ms": (1.0, 100.0), "us": (100.0, 1e5), "ns": (1e5, 1e8)},
    "position": {"m": (5e-5, 0.5), "mm": (0.05, 500.0), "um": (50.0, 5e5)},
    "force": {"N": (1e-3, 1e3), "mN": (1.0, 1e6)},
}
"""Interval, travel and force of benches, in units that are tried in turn. An interval of .1 to 1 may be of
seconds or of milliseconds."""
_LIKELY_ROTARY: Ranges = {
    "position": {"rad": (1e-3, 15.0), "deg": (0.06, 860.0)},
    "force": {"Nm": (1e-3, 1e3), "mNm": (1.0, 1e6)},
}
_EPOCH_S = 1.2e9, 2.2e9  # stamps of 2008 to 2039
_MOST_DIGITS = 1000.0  # range of whole numbers: beyond, they are counts of a converter or an encoder


class Table(Protocol):
    """Columns of numbers by name; see `TextTable`."""

    names: Sequence[str]
    units: dict[str, str]
    notes: list[str]

    def read(self, names: Sequence[str]) -> list[Array]: ...


class ReadOnce:
    """A table whose columns are kept once they were read: a file of text takes a second per million rows."""

    def __init__(self, table: Table) -> None:
        self._table = table
        self.names, self.units, self.notes = table.names, table.units, table.notes
        self._columns: dict[str, Array] = {}

    def read(self, names: Sequence[str]) -> list[Array]:
        if lacking := [name for name in names if name not in self._columns]:
            self._columns.update(zip(lacking, self._table.read(lacking), strict=True))
        return [self._columns[name] for name in names]


class Likely(NamedTuple):
    """A column with the unit that it states or is likely; `moves`: standard deviation in SI."""

    column: str
    unit: str
    moves: float = 0.0


def different(
    table: Table, quantity: Quantity, choices: list[Choice], equals: dict[str, str]
) -> list[Choice]:
    """Removes columns that equal an earlier one of the same unit row by row, which it adds to `equals`
    (column to earlier one), and times that do not grow. A single choice is returned unread.
    """
    if len(choices) < 2:
        return choices
    with suppress(RecordingError):  # of one of them: `_numbers` leaves it out
        table.read([choice.column for choice in choices])
    read: dict[Choice, Array] = {}
    for choice in choices:
        values = _numbers(table, choice.column)
        rivals = [one for one in read if one.unit == choice.unit and len(values)]
        equal = [one for one in rivals if np.array_equal(read[one], values, equal_nan=True)]
        if equal:
            equals[choice.column] = equal[0].column
        elif quantity != "time" or _changes(quantity, values):
            read[choice] = values
    return list(read)


def propose(
    table: Table, chosen: Mapping[Quantity, tuple[str, str]], doubts: Mapping[Quantity, list[Choice]]
) -> dict[Quantity, str]:
    """Likely `unit:column` of quantities in doubt: the first time, and the position and force that go
    together best. Leaves out a quantity for which any column would be a guess. `chosen`: columns that are
    sure.
    """
    silent = [q for q, choices in doubts.items() if not any(choice.named for choice in choices)]
    usable = {quantity: [Likely(*known)] for quantity, known in chosen.items()}
    for quantity, choices in doubts.items():
        usable[quantity] = []
        if quantity in silent and any(c.unit is None for c in choices) and len(choices) > len(silent):
            continue  # more columns that say nothing than are lacking: any would be a guess
        for choice in choices:
            values = _numbers(table, choice.column)
            if _changes(quantity, values) and (
                unit := choice.unit or _likely_unit(quantity, choice.column, values)
            ):
                moves = TO_SI[quantity][unit] * float(np.nanstd(values))
                usable[quantity].append(Likely(choice.column, unit, moves))
    best: dict[Quantity, Likely] = {}
    if times := usable.get("time"):
        best["time"] = times[0]
    taken = best["time"].column if times else ""
    positions, forces = ([x for x in usable.get(q, []) if x.column != taken] for q in QUANTITIES[1:])
    pairs = [(x, f) for x in positions for f in forces if x.column != f.column]
    if pairs:
        order = partial(_likeness, list(table.names), positions)
        best["position"], best["force"] = max(pairs, key=order)
    else:
        best |= {"position": positions[0]} if positions else {}
    return {q: f"{best[q].unit}:{best[q].column}" for q in doubts if q in best}


def _likeness(names: list[str], positions: list[Likely], pair: tuple[Likely, Likely]) -> tuple[float, ...]:
    """Sort key, larger is likelier, of a position and a force that belong together: they are of the same
    axis; share words; where all positions name an axis, that one moves most; their columns stand near.
    """
    position, force = pair
    return (
        axis_of(position.column) == axis_of(force.column) != "",
        len(words_of(position.column) & words_of(force.column)),
        position.moves if all(axis_of(one.column) for one in positions) else 0.0,
        -abs(names.index(force.column) - names.index(position.column)),
    )


def doubt_about(quantity: Quantity, choices: Sequence[Choice]) -> str:
    """Text on a quantity that is not sure; `choices`: the columns that may hold it."""
    names = ", ".join(repr(choice.column) for choice in choices)
    silent = "" if any(choice.named for choice in choices) else f"no {quantity}: no column is named so"
    several = f"{names} may each be the {quantity}" if len(choices) > 1 else ""
    stated = all(choice.unit for choice in choices)
    unit = "" if stated else f"no unit of {'them' if several else names} is stated"
    return "; ".join(filter(None, (silent, several, unit)))


def _numbers(table: Table, name: str) -> Array:
    try:
        return table.read([name])[0]
    except RecordingError:
        return np.empty(0)


def _changes(quantity: Quantity, values: Array) -> bool:
    """True if a column may be that quantity: it changes, and a time mostly grows."""
    values = values[np.isfinite(values)]
    if len(values) < 2 or np.ptp(values) == 0.0:
        return False
    return quantity != "time" or float(np.mean(np.diff(values) >= 0.0)) > 0.99


def _likely_unit(quantity: Quantity, name: str, values: Array) -> str | None:
    """Likely unit of a column that states none: that in which a time is a date of 2008 to 2039, else the
    first in which its interval, travel or force is that of a bench. None where there is none, of a joint,
    which may turn or slide, and where the column counts: rows in place of time, or a converter's steps.
    """
    values = values[np.isfinite(values)]
    steps = np.diff(values)
    size = float(np.median(steps[steps > 0.0]) if quantity == "time" else np.ptp(values))
    whole = bool(np.all(values == np.round(values)))
    if quantity == "time":
        for unit, to_s in TO_SI["time"].items():
            if _EPOCH_S[0] < values[0] * to_s < _EPOCH_S[1]:
                return unit
    counts = whole and (np.all(steps == 1.0) if quantity == "time" else size > _MOST_DIGITS)
    if counts or (quantity != "time" and is_of_a_joint(name)):
        return None
    units = (_LIKELY_ROTARY if is_rotary(name) and quantity != "time" else _LIKELY)[quantity]
    return next((unit for unit, (least, most) in units.items() if least <= size <= most), None)
