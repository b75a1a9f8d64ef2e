"""Cleaning of a table's rows: incomplete, doubled, rounded and out of order ones are told apart."""

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation.state_filter import GAP_S
from forefeel.common.recording.recording import Array

_MISPLACED = 100  # intervals by which a row may come too late, and is put in its place; beyond, a run begins
_APART_S = 10.0 * GAP_S  # between two runs that stand behind one another


def clean(time_s: Array, values: Array, needed: int) -> tuple[Array, Array, list[str]]:
    """Stamps that increase, the rows of them, and what was done to get there, in words.

    Args:
        time_s: shape (n,), NaN where it is missing.
        values: shape (columns, n), the same.
        needed: the first so many columns are; a number that another one lacks costs no row.

    In turn: rows without one of the numbers are dropped; rows that say the same twice in a row, too; rows
    that came up to 100 intervals late are put in their place; where the time goes back further, another run
    begins, and its stamps go on 1 s after the last; stamps that several rows share are spread evenly to the
    next one.
    """
    done: list[str] = []
    whole = np.isfinite(time_s) & np.isfinite(values[:needed]).all(axis=0)
    time_s, values = _selected(time_s, values, whole, "for a missing number", done)
    if len(time_s) > 1:
        same = (np.diff(time_s) == 0.0) & (np.diff(values[:needed]) == 0.0).all(axis=0)
        time_s, values = _selected(time_s, values, np.append(True, ~same), "as duplicates", done)
    time_s, values = _ordered(time_s, values, done)
    return _spread(time_s, done), values, done


def _selected(
    time_s: Array, values: Array, keep: NDArray[np.bool_], which: str, done: list[str]
) -> tuple[Array, Array]:
    if (dropped := int(np.count_nonzero(~keep))) == 0:
        return time_s, values
    done.append(f"{dropped:,} of {len(keep):,} rows dropped {which}")
    return time_s[keep], values[:, keep]


def _ordered(time_s: Array, values: Array, done: list[str]) -> tuple[Array, Array]:
    """Puts rows up to 100 intervals late in their place; where the time goes back further another run begins,
    whose stamps go on 1 s after the last. Returns stamps and values, with notes on it in `done`.
    """
    steps = np.diff(time_s)
    back = np.flatnonzero(steps < 0.0)
    if not len(back):
        return time_s, values
    far = back[-steps[back] > _MISPLACED * np.median(np.abs(steps))]
    runs = np.split(np.arange(len(time_s)), far + 1)
    order = np.concatenate([run[np.argsort(time_s[run], kind="stable")] for run in runs])
    moved = int(np.count_nonzero(order != np.arange(len(order))))
    if moved:
        done.append(f"{moved:,} rows put in their order")
    time_s = time_s[order]
    for place in far + 1:
        time_s[place:] += time_s[place - 1] + _APART_S - time_s[place]
    if len(far):
        done.append(f"the time goes back ({len(far)} x): taken as {len(far) + 1} runs, {_APART_S:g} s apart")
    return time_s, values[:, order]


def _spread(time_s: Array, done: list[str]) -> Array:
    """Spreads equal stamps (rounded, or of a packet of samples) evenly to the next one, over `GAP_S` at most,
    with a note in `done`. Unchanged where none are equal, or with fewer than three different ones.
    """
    first = np.flatnonzero(np.append(True, np.diff(time_s) > 0.0))
    if len(first) == len(time_s) or len(first) < 3:
        return time_s
    counts = np.diff(np.append(first, len(time_s)))
    steps = np.diff(time_s[first])
    steps = np.minimum(np.append(steps, steps[-1]), GAP_S)
    within = np.arange(len(time_s)) - np.repeat(first, counts)
    done.append(f"{len(time_s) - len(first):,} duplicate stamps spread evenly")
    return np.asarray(time_s + within * np.repeat(steps / counts, counts))
