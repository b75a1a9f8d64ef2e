"""Cleaning of a table's rows: incomplete, doubled, rounded, held and out of order ones are told apart."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import log2
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation.state_filter import GAP_S
from forefeel.common.recording.recording import Array

_MISPLACED = 100  # intervals by which a row may come too late, and is put in its place; beyond, a run begins
_APART_S = 10.0 * GAP_S  # between two runs that stand behind one another
_COMMON = 0.9  # share of the rows of either column in which both have a number: one stream
_BRIDGED = 3.0  # intervals of a slower column that are interpolated over
_ROUNDED_S = 2.0  # of stamps that are in whole seconds and still tell the rate
_LEAST_CHANGES = 20  # of a column that is held
_ONE_ROW = 1.1  # intervals by which rows may come after what was taken evenly: one, and the stamps' rounding
_FAR = 5.0  # ranges of all other readings, beyond which a reading is none
_SHARP, _SETTLED_S = 0.2, 1.0  # of a step of the zero: what the rows beside step at most, how long it stays
_ALONE = 1.5  # times the next largest step of the force; 312 recordings of hidden effects have no such step


def clean(time_s: Array, values: Array, needed: int, names: Sequence[str]) -> tuple[Array, Array, list[str]]:
    """Stamps that increase, the rows of them, and what was done to get there, in words.

    Args:
        time_s: shape (n,), NaN where it is missing.
        values: shape (columns, n), the same.
        needed: the first so many columns are; a number that another one lacks costs no row.
        names: of the needed columns.

    In turn: of columns with rows of their own those of the last needed one are taken, see `_merged`; rows
    without one of the numbers are dropped; rows that say the same twice in a row, too; rows that came up to
    100 intervals late are put in their place; where the time goes back further, another run begins, and its
    stamps go on 1 s after the last; stamps that several rows share are spread evenly to the next one; a
    column that is held counts where it is new.
    """
    done: list[str] = []
    time_s, values = _merged(time_s, values, needed, names, done)
    whole = np.isfinite(time_s) & np.isfinite(values[:needed]).all(axis=0)
    time_s, values = _selected(time_s, values, whole, "for a missing number", done)
    if len(time_s) > 1:
        same = (np.diff(time_s) == 0.0) & (np.diff(values[:needed]) == 0.0).all(axis=0)
        time_s, values = _selected(time_s, values, np.append(True, ~same), "as duplicates", done)
    time_s, values = _ordered(time_s, values, done)
    time_s = _spread(time_s, done)
    taken_s = {}
    for i, name in enumerate(names):
        rows, stamps_s = _new(time_s, values[i])
        if len(rows):
            done.append(f"{name} is held: it changes at {_hz(stamps_s)} in rows of {_hz(time_s)}")
            values[i, np.setdiff1d(np.arange(len(time_s)), rows)] = np.nan
            taken_s[i] = time_s.copy()
            taken_s[i][rows] = stamps_s
    if taken_s:
        time_s, values = _merged(time_s, values, needed, names, done, taken_s)
        known = np.isfinite(values[:needed]).all(axis=0)
        time_s, values = time_s[known], values[:, known]
    return time_s, values, done


def unwrapped(stamps: Array, to_s: float) -> tuple[Array, list[str]]:
    """Stamps of a counter of 16 or 32 bit, or of 32 bit in us, without its wraps, and a note on them."""
    steps = np.diff(stamps)
    back, usual = np.flatnonzero(steps < 0.0), float(np.nanmedian(np.abs(steps))) if len(steps) else 0.0
    counts = "2^32 us" if np.isclose(to_s, 1e-6) else "2^32"
    for size, what in ((2.0**16, "2^16"), (2.0**32, counts), (2.0**32 * 1e-6 / to_s, "2^32 us")):
        forth = steps[back] + size
        if len(back) and np.all((forth >= 0.0) & (forth <= _MISPLACED * usual)):
            wraps = np.searchsorted(back + 1, np.arange(len(stamps)), "right")
            return stamps + size * wraps, [f"the time wraps at {what} ({len(back)} x): continued"]
    return stamps, []


def without_full_scale(values: Array, name: str) -> tuple[Array, list[str]]:
    """Values with NaN for readings of a converter's full scale, and a note on them: far beyond all others
    they repeat one number, or have the digits of 2^n - 1 or 2^n.
    """
    known, notes = values[np.isfinite(values)], list[str]()
    if len(known) < _LEAST_CHANGES:
        return values, notes
    low, high = np.quantile(known, (0.05, 0.95))
    for extreme in {float(known.max()), float(known.min())}:
        others = known[known != extreme]
        nearest = float(np.min(np.abs(others - extreme), initial=np.inf))
        count, power = len(known) - len(others), _power_of_two(extreme)
        if high > low and _FAR * (high - low) < nearest < np.inf and (power or count > 1):
            values = np.where(values == extreme, np.nan, values)
            notes.append(f"{count:,} x {extreme:.10g}{power} in {name}, full scale of a converter, left out")
    return values, notes


def _power_of_two(value: float) -> str:
    """` = 2^23 - 1` for a number with its digits, wherever the point stands; "": of no converter."""
    digits = int(f"{abs(value):.12f}".replace(".", "").strip("0") or "0")
    for number, less in ((digits, ""), (digits + 1, " - 1")):
        if number >= 1023 and log2(number).is_integer():
            return f" ({'-' * (value < 0.0)}2^{log2(number):.0f}{less})"
    return ""


def of_one_zero(time_s: Array, position: Array, force: Array, unit: str) -> tuple[Array, list[str]]:
    """Force without up to three steps from one row to the next that no others are like, that stay, and that a
    stiffness which changes there does not explain as well; and notes on them.
    """
    intervals, jumps = np.diff(time_s), np.diff(force)
    jumps[intervals > _BRIDGED * np.median(intervals)] = 0.0
    order = np.argsort(-np.abs(jumps))[:4]
    sizes = np.abs(jumps[order])
    alone = [n for n in range(1, len(sizes)) if sizes[n - 1] > _ALONE * sizes[n]]
    usual = float(np.median(np.abs(jumps)))
    if usual == 0.0 or not alone or sizes[alone[0] - 1] < 10.0 * usual:
        return force, []  # without noise it is the force that drives
    at = np.sort(order[: alone[0]])
    beside = np.abs(np.concatenate([[0.0], jumps, [0.0]])[np.stack([at, at + 2])])
    if np.any(beside > _SHARP * np.abs(jumps[at])) or np.any(np.diff(time_s[at]) < _SETTLED_S):
        return force, []  # a load that comes or goes takes several rows, a spike goes back
    speed = np.gradient(position, time_s)
    plain = np.column_stack([np.ones_like(force), position, speed, np.sign(speed)])
    after = np.arange(len(force))[:, None] > at
    fits = []
    for steps in (after * 1.0, after * position[:, None]):
        design = np.hstack([plain, steps])
        weights = np.linalg.lstsq(design, force, rcond=None)[0]
        fits.append((float(np.sum((force - design @ weights) ** 2)), weights[plain.shape[1] :]))
    (left, step), (left_of_stiffness, _) = fits
    if left > left_of_stiffness or np.any(np.abs(step - jumps[at]) > 0.3 * np.abs(jumps[at])):
        return force, []
    notes = [f"a step of {jumps[i]:.2g} {unit} at {time_s[i + 1]:.4g} s: tared again? Taken out" for i in at]
    return force - after @ step, notes


def _hz(time_s: Array) -> str:
    intervals = np.diff(time_s)
    usual = float(np.mean(intervals[intervals < 1.5 * np.median(intervals)]))  # without gaps and rests
    return f"{float(f'{1.0 / usual:.3g}'):,g} Hz"


def _merged(
    time_s: Array,
    values: Array,
    needed: int,
    names: Sequence[str],
    done: list[str],
    taken_s: Mapping[int, Array] = MappingProxyType({}),
) -> tuple[Array, Array]:
    """Rows of the last needed column, and the others between theirs, up to `_BRIDGED` intervals apart: the
    position by a cubic spline, which its mass makes smooth, any other by lines. Unchanged where they stand in
    the same rows, or the time goes back. `taken_s`: when a column was taken, where not at the rows' stamps.

    A force is not interpolated: between 50 readings a second dry friction came out 11 % too small.
    """
    there = np.isfinite(values) & np.isfinite(time_s)
    rows, stamped = there[needed - 1], time_s[there[:needed].any(axis=0)]
    common = np.count_nonzero(rows & there[0]) / max(there[:needed].sum(axis=1).max(), 1)
    if common > _COMMON or there[:needed].sum(axis=1).min() < 2 or np.any(np.diff(stamped) < 0.0):
        return time_s, values
    from scipy.interpolate import make_interp_spline  # noqa: PLC0415 - slow to import

    merged = values[:, rows]
    for i, (column, known) in enumerate(zip(values, there, strict=True)):
        stamps_s, first = np.unique(taken_s.get(i, time_s)[known], return_index=True)
        if len(stamps_s) < 2 or np.mean(known[rows]) > _COMMON:
            continue
        after = np.clip(np.searchsorted(stamps_s, time_s[rows]), 1, len(stamps_s) - 1)
        near = np.diff(stamps_s)[after - 1] <= _BRIDGED * np.median(np.diff(stamps_s))
        within = (stamps_s[0] <= time_s[rows]) & (time_s[rows] <= stamps_s[-1])
        spline = make_interp_spline(stamps_s, column[known][first], 3 if i == 0 and len(stamps_s) > 3 else 1)
        merged[i] = np.where(within & (near | np.isin(time_s[rows], stamps_s)), spline(time_s[rows]), np.nan)
        if i < needed:
            at = f"the {_hz(time_s[rows])} of {names[needed - 1]}"
            done.append(f"{names[i]}, of {_hz(stamps_s)}, is interpolated at {at}")
    if there[0].sum() * _COMMON > rows.sum():
        done.append(f"{names[needed - 1]}, of {_hz(time_s[rows])}, is the slower: its rows are used")
    return time_s[rows], merged


def _new(time_s: Array, column: Array) -> tuple[NDArray[np.int64], Array]:
    """Rows in which a column that is held for several rows is new, at rest in the same rhythm, and when it
    was taken: evenly, if that explains every row, else at their stamps. None where it is not held: what moves
    a coarse encoder has no rhythm, or makes single steps.
    """
    none, steps = (np.empty(0, np.int64), np.empty(0)), np.diff(column)
    changed = np.flatnonzero(steps) + 1
    gaps, sizes = np.diff(changed), np.abs(steps[changed - 1])
    if len(gaps) < _LEAST_CHANGES or (usual := float(np.median(gaps))) < 2.0:
        return none
    if np.mean(sizes < 1.01 * sizes.min()) > 0.5:
        return none
    period = float(np.mean(gaps[gaps <= 1.5 * usual]))
    count = np.append(0.0, np.cumsum(np.round(gaps / period)))
    period_s, start_s = np.polyfit(count, time_s[changed], 1)
    late_s, interval_s = time_s[changed] - start_s - period_s * count, float(np.median(np.diff(time_s)))
    if np.ptp(late_s) < _ONE_ROW * interval_s:
        before = np.floor((time_s[changed[0]] - time_s[0]) / period_s)
        numbers = np.arange(-before, (time_s[-1] - time_s[changed[0]]) / period_s)
        stamps_s = start_s + float(late_s.min()) + period_s * numbers
        rows = np.searchsorted(time_s, stamps_s - 0.01 * interval_s)
        rows, first = np.unique(rows[rows < len(column)], return_index=True)
        return rows, stamps_s[first]
    short = gaps[gaps < 3.5 * period]  # the rest of long ones adds up
    if usual < 3.0 or np.mean(np.abs(short - period * np.round(short / period)) > 1.0) > 0.05:
        return none
    edges = np.concatenate([[-1], changed, [len(column)]])
    rests = [np.arange(stop - period, start + 0.5 * period, -period) for start, stop in pairwise(edges[:-1])]
    after = np.arange(changed[-1] + period, len(column), period)
    rows = np.rint(np.concatenate([changed, *rests, after])).astype(np.int64)
    rows = np.unique(rows[rows < len(column)])
    return rows, time_s[rows]


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
    """Spreads stamps that several rows share (rounded, or of a packet of samples) evenly to the next one, as
    far as the usual one at most, with a note in `done`. Unchanged where none are equal, with fewer than three
    different ones, or where they are too far apart to tell the rate.
    """
    first = np.flatnonzero(np.append(True, np.diff(time_s) > 0.0))
    if len(first) >= len(time_s) or len(first) < 3:
        return time_s
    counts, steps = np.diff(np.append(first, len(time_s))), np.diff(time_s[first])
    if (usual := float(np.median(steps))) > _ROUNDED_S:
        return time_s
    steps = np.minimum(np.append(steps, usual), max(GAP_S, 1.5 * usual))
    interval = steps / counts
    # the first and the last may be cut
    interval[[0, -1]] = np.minimum(interval[[0, -1]], np.median(interval))
    within = np.arange(len(time_s)) - np.repeat(first, counts)
    spread = np.asarray(time_s + within * np.repeat(interval, counts))
    spread[: counts[0]] += steps[0] - counts[0] * interval[0]
    shortest = float(steps.min())
    rounded = np.allclose(steps / shortest, np.round(steps / shortest), atol=0.01)
    cause = f"stamps lost their digits below {shortest:.2g} s" if rounded else "several rows share a stamp"
    done.append(f"{cause}: {len(time_s) - len(first):,} duplicate stamps spread evenly")
    return spread
