"""Cleaning of a table's rows: incomplete, doubled, rounded, held and out of order ones are told apart."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation.state_filter import GAP_S
from forefeel.common.recording.recording import Array

COMMON = 0.9  # share of its rows in which a column has a number, if it goes with the others
_MISPLACED = 100  # intervals by which a row may come too late, and is put in its place; beyond, a run begins
_APART_S = 10.0 * GAP_S  # between two runs that stand behind one another
_BRIDGED = 3.0  # intervals of a slower column that are interpolated over: two samples are lost
_LEAST_CHANGES = 20  # of a column that is held: the rhythm of fewer may be chance
_FAR = 5.0  # ranges of 90 % of the other readings, 16 standard deviations of noise, beyond which one is none
_FULL_SCALES = {str(2**n - k): f"2^{n}{' - 1' * k}" for n in range(10, 33) for k in (0, 1)}
_SHARP = 0.2  # of a step of the zero, what the rows beside it step at most: a load over three rows has half
_SETTLED_S = 1.0  # for which a zero stays, where there are several: a spike goes back
_ALONE = 1.5  # times the next largest step of the force; 312 recordings of hidden effects have no such step


def clean(time_s: Array, values: Array, names: Sequence[str]) -> tuple[Array, Array, list[str]]:
    """Cleans the rows of a table; returns increasing stamps, the values at them, and notes on what was done.

    Args:
        time_s: shape (n,), NaN where it is missing.
        values: shape (columns, n), the same.
        names: of the first columns, which are needed; a number that another one lacks costs no row.

    In turn: where columns have rows of their own, those of the last needed one are taken; rows without a
    needed number are dropped, then repetitions of the row before; rows that came up to 100 intervals late are
    put in their place; where the time goes back further, another run begins, 1 s after the last; stamps that
    several rows share are spread evenly to the next one; of a column that is held only new values count.
    """
    rows = _Rows(time_s, values, names)
    rows.merge()
    rows.keep(rows.complete, "for a missing number")
    same = (np.diff(rows.time_s) == 0.0) & (np.diff(rows.needed) == 0.0).all(axis=0)
    rows.keep(np.append(True, ~same)[: len(rows.time_s)], "as duplicates")
    rows.order()
    rows.spread()
    rows.blank_repeats()
    rows.merge()
    rows.keep(rows.complete)
    return rows.time_s, rows.values, rows.notes


class _Rows:
    """Rows while they are cleaned; each method changes them in place and adds notes. `taken_s`: for a held
    column, by its number, when its values were taken.
    """

    def __init__(self, time_s: Array, values: Array, names: Sequence[str]) -> None:
        self.time_s, self.values, self.names = time_s, values, names
        self.taken_s: dict[int, Array] = {}
        self.notes: list[str] = []

    @property
    def needed(self) -> Array:
        return self.values[: len(self.names)]

    @property
    def complete(self) -> NDArray[np.bool_]:
        return np.isfinite(self.time_s) & np.isfinite(self.needed).all(axis=0)

    def keep(self, which: NDArray[np.bool_], why: str = "") -> None:
        """Drops the rows that are not in `which`; notes their number if there is a reason `why`."""
        if dropped := np.count_nonzero(~which):
            self.notes += [f"{dropped:,} of {len(which):,} rows dropped {why}"] * (why != "")
            self.time_s, self.values = self.time_s[which], self.values[:, which]

    def merge(self) -> None:
        """Keeps only the rows of the last needed column and interpolates columns that lack at least 10 % of
        them: the position by a cubic spline (a mass moves smoothly), any other linearly. Does nothing where
        the needed columns stand in the same rows, or the time goes back.

        A force is not interpolated: between 50 readings a second dry friction came out 11 % too small.
        """
        there = np.isfinite(self.values) & np.isfinite(self.time_s)
        needed = there[: len(self.names)]
        first, last = needed[0], needed[-1]
        apart = np.count_nonzero(first & last) <= COMMON * max(needed.sum(axis=1))
        if not apart or min(needed.sum(axis=1)) < 2 or np.any(np.diff(self.time_s[needed.any(axis=0)]) < 0.0):
            return
        at_s, merged = self.time_s[last], self.values[:, last]
        for i, known in enumerate(there):
            stamps_s, which = np.unique(self.taken_s.get(i, self.time_s)[known], return_index=True)
            if len(stamps_s) > 1 and np.mean(known[last]) <= COMMON:
                merged[i] = _interpolated(stamps_s, self.values[i, known][which], at_s, 3 if i == 0 else 1)
                if i < len(self.names):
                    between = f"is interpolated at the {_hz(at_s)} of {self.names[-1]}"
                    self.notes.append(f"{self.names[i]}, of {_hz(stamps_s)}, {between}")
        if np.count_nonzero(first) * COMMON > len(at_s):
            self.notes.append(f"{self.names[-1]}, of {_hz(at_s)}, is the slower: its rows are used")
        self.time_s, self.values = at_s, merged

    def order(self) -> None:
        """Puts rows up to 100 intervals late in their place; where the time goes back further another run
        begins, whose stamps are shifted to begin 1 s after the last.
        """
        steps = np.diff(self.time_s)
        back = np.flatnonzero(steps < 0.0)
        if not len(back):  # and nothing to copy
            return
        far = back[-steps[back] > _MISPLACED * _usual_step(steps)] + 1
        runs = np.split(np.arange(len(self.time_s)), far)
        order = np.concatenate([run[np.argsort(self.time_s[run], kind="stable")] for run in runs])
        if moved := np.count_nonzero(order != np.arange(len(order))):
            self.notes.append(f"{moved:,} rows put in their order")
        self.time_s, self.values = self.time_s[order], self.values[:, order]
        for place in far:
            self.time_s[place:] += self.time_s[place - 1] + _APART_S - self.time_s[place]
        if count := len(far):
            self.notes.append(
                f"the time goes back ({count} x): taken as {count + 1} runs, {_APART_S:g} s apart"
            )

    def spread(self) -> None:
        """Spreads stamps that several rows share (rounded, or of a packet of samples) evenly up to the next
        one, over at most 1.5 usual steps. Does nothing with fewer than three different stamps.
        """
        first = np.flatnonzero(np.append(True, np.diff(self.time_s) > 0.0))
        if not 3 <= len(first) < len(self.time_s):
            return
        counts, steps = np.diff(np.append(first, len(self.time_s))), np.diff(self.time_s[first])
        usual, shortest = float(np.median(steps)), float(steps.min())
        interval = np.minimum(np.append(steps, usual), 1.5 * usual) / counts
        interval[[0, -1]] = np.minimum(interval[[0, -1]], np.median(interval))  # they may be cut
        within = np.arange(len(self.time_s)) - np.repeat(first, counts)
        self.time_s = self.time_s + within * np.repeat(interval, counts)
        self.time_s[: counts[0]] += min(steps[0], 1.5 * usual) - counts[0] * interval[0]
        rounded = np.allclose(steps / shortest, np.round(steps / shortest), atol=0.01)
        cause = (
            f"stamps lost their digits below {shortest:.2g} s" if rounded else "several rows share a stamp"
        )
        self.notes.append(f"{cause}: {len(within) - len(first):,} duplicate stamps spread evenly")

    def blank_repeats(self) -> None:
        """Sets to NaN the repeated values of each needed column that is held over several rows, and notes its
        rate. Its `taken_s` are the times of the rows, but for new values the times at which they were taken.
        """
        for i, name in enumerate(self.names):
            new, stamps_s = _new_values(self.time_s, self.values[i])
            if len(new):
                rates = f"at {_hz(stamps_s)} in rows of {_hz(self.time_s)}"
                self.notes.append(f"{name} is held: it changes {rates}")
                self.values[i, np.setdiff1d(np.arange(len(self.time_s)), new)] = np.nan
                self.taken_s[i] = self.time_s.copy()
                self.taken_s[i][new] = stamps_s


def _new_values(time_s: Array, column: Array) -> tuple[NDArray[np.int64], Array]:
    """Rows in which a column that is held for several rows has a new value, at rest by the same rhythm; and
    the evenly spaced stamps at which these were taken. Where no rhythm in time explains every row, those of
    `_new_by_rows`. Both empty for few changes, or for the single steps of a coarse encoder.
    """
    none, steps = (np.empty(0, np.int64), np.empty(0)), np.diff(column)
    changed = np.flatnonzero(steps) + 1
    rows, sizes = np.diff(changed), np.abs(steps[changed - 1])
    if len(rows) < _LEAST_CHANGES or np.median(rows) < 2.0 or np.mean(sizes < 1.01 * sizes.min()) > 0.5:
        return none
    gaps_s = np.diff(time_s[changed])
    period_s = np.mean(gaps_s[gaps_s <= 1.5 * np.median(gaps_s)])  # others are rests
    count = np.append(0.0, np.cumsum(np.round(gaps_s / period_s)))
    period_s, start_s = np.polyfit(count, time_s[changed], 1)
    late_s = time_s[changed] - start_s - period_s * count
    rounding_s = 0.1 * float(np.median(np.diff(time_s)))
    # each was taken after the row before the one that it is new in
    if np.max(late_s - time_s[changed] + time_s[changed - 1]) > late_s.min() + rounding_s:
        return _new_by_rows(time_s, changed)
    first_s = start_s + float(late_s.min())
    ends = (time_s[[0, -1]] + np.array([-rounding_s, rounding_s]) - first_s) / period_s
    stamps_s = first_s + period_s * np.arange(np.ceil(ends[0]), ends[1])
    rows, which = np.unique(np.searchsorted(time_s, stamps_s - rounding_s), return_index=True)
    return rows, stamps_s[which]


def _new_by_rows(time_s: Array, changed: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array]:
    """Rows in which a held column has a new value, where gaps shift its rhythm; and those rows' stamps. At
    rest by the rhythm of the others. Both empty where the changes have no rhythm in rows.
    """
    gaps, end = np.diff(changed), len(time_s)
    usual = float(np.median(gaps))
    period = float(np.mean(gaps[gaps <= 1.5 * usual]))
    short = gaps[gaps < 3.5 * period]  # the rest of long ones adds up
    if usual < 3.0 or np.mean(np.abs(short - period * np.round(short / period)) > 1.0) > 0.05:
        return np.empty(0, np.int64), np.empty(0)
    edges = np.concatenate([[-1], changed, [end]])
    rests = [np.arange(stop - period, start + 0.5 * period, -period) for start, stop in pairwise(edges[:-1])]
    rows = np.rint(np.concatenate([changed, *rests, np.arange(changed[-1] + period, end, period)])).astype(
        np.int64
    )
    rows = np.unique(rows[rows < end])
    return rows, time_s[rows]


def _interpolated(stamps_s: Array, values: Array, at_s: Array, degree: int) -> Array:
    """Spline values at `at_s`; NaN outside the stamps, and in gaps over `_BRIDGED` usual intervals."""
    from scipy.interpolate import make_interp_spline  # noqa: PLC0415 - slow to import

    intervals = np.diff(stamps_s)
    after = np.clip(np.searchsorted(stamps_s, at_s), 1, len(intervals))
    near = intervals[after - 1] <= _BRIDGED * np.median(intervals)
    within = (stamps_s[0] <= at_s) & (at_s <= stamps_s[-1])
    spline = make_interp_spline(stamps_s, values, degree if len(stamps_s) > degree else 1)
    return np.where(within & (near | np.isin(at_s, stamps_s)), spline(at_s), np.nan)


def _hz(time_s: Array) -> str:
    intervals = np.diff(time_s)
    usual = float(np.mean(intervals[intervals < 1.5 * np.median(intervals)]))  # without gaps and rests
    return f"{float(f'{1.0 / usual:.3g}'):,g} Hz"


def _usual_step(steps: Array) -> float:
    """Median size of the steps between different stamps: most rows may share theirs. 0 without any."""
    sizes = np.abs(steps[np.isfinite(steps) & (steps != 0.0)])
    return float(np.median(sizes)) if len(sizes) else 0.0


def unwrapped(stamps: Array, to_s: float) -> tuple[Array, list[str]]:
    """Stamps of a counter of 16 or 32 bit, or of 32 bit in us, continued over its wraps, and a note on these;
    other stamps, or any step back that is no wrap: unchanged, without a note. `to_s`: their unit in s.
    """
    steps = np.diff(stamps)
    back, usual = np.flatnonzero(steps < 0.0), _usual_step(steps)
    for size, what in ((2.0**16, "2^16"), (2.0**32 * 1e-6 / to_s, "2^32 us"), (2.0**32, "2^32")):
        forth = steps[back] + size
        if len(back) and np.all((forth >= 0.0) & (forth <= _MISPLACED * usual)):
            wraps = np.searchsorted(back + 1, np.arange(len(stamps)), "right")
            return stamps + size * wraps, [f"the time wraps at {what} ({len(back)} x): continued"]
    return stamps, []


def without_full_scale(values: Array, name: str) -> tuple[Array, list[str]]:
    """Values with NaN for readings of a converter's full scale, and notes on them: extremes far beyond all
    other values that repeat one number, or have the digits of 2^n - 1 or 2^n.
    """
    known, notes = values[np.isfinite(values)], list[str]()
    for extreme in (known.min(initial=np.inf), known.max(initial=-np.inf)):
        others = known[known != extreme]
        low, high = np.quantile(others, (0.05, 0.95)) if len(others) else (0.0, 0.0)
        count, digits = len(known) - len(others), f"{abs(extreme):.12f}".replace(".", "").strip("0")
        power = f" ({_FULL_SCALES[digits]})" if digits in _FULL_SCALES else ""
        if 0.0 < _FAR * (high - low) < np.abs(others - extreme).min() and (power or count > 1):
            values = np.where(values == extreme, np.nan, values)
            notes.append(f"{count:,} x {extreme:.10g}{power} in {name}, full scale of a converter, left out")
    return values, notes


def without_tares(time_s: Array, position: Array, force: Array, unit: str) -> tuple[Array, list[str]]:
    """Takes out of a force the steps with which its zero was set anew, and returns notes on them; else the
    force unchanged and no notes. A step goes from one row to the next, is one of up to three far larger than
    all others, stays, and is not explained as well by a stiffness that changes there.
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
