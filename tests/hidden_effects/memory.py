"""A peer: sparse regression (PySINDy's STLSQ) over the diagnosis' own columns, those with a memory too.

A shape parameter, such as a time constant or a length, is not searched: each of three of its values has
columns of its own. Causes that are no column (a play, a delay, a lost contact, a factor on the force) have
none here.
"""

import time

import numpy as np

from forefeel.common.causes.candidate import Candidate, Changing, Periodic, PositionWave, Shape, base_name
from forefeel.common.causes.catalogue import CANDIDATES
from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.analysis import conditioned
from forefeel.diagnosis.regression import RecordingRegression
from forefeel.diagnosis.search import Periods
from forefeel.diagnosis.sensor_faults import clean
from tests.hidden_effects.answers import Answer, Measured
from tests.hidden_effects.columns import moves
from tests.hidden_effects.sindy import selected


def sparse_with_memory(measured: Measured) -> Answer:
    start_s = time.perf_counter()
    if not moves(measured):
        return Answer("refused", seconds=time.perf_counter() - start_s)
    recording = Recording("hidden", measured.time_s, measured.position_m, measured.force_n, "hidden")
    try:
        regression = conditioned(recording, clean(recording))
    except ValueError:  # too few samples in a row
        return Answer("refused", seconds=time.perf_counter() - start_s)
    phi, owners = _columns(regression)
    force = regression.signals.force[regression.signals.rows]
    unit = float(np.std(force))
    sizes_n = np.abs(selected(phi, force / unit)) * unit
    explained = {owner: float(sizes_n[owners == owner].max()) for owner in dict.fromkeys(owners) if owner}
    names = tuple(sorted((name for name in explained if explained[name]), key=lambda n: -explained[n]))
    verdict = "cause_found" if names else "nothing_missing"
    return Answer(verdict, names, seconds=time.perf_counter() - start_s)


def _columns(regression: RecordingRegression) -> tuple[Floats, np.ndarray[tuple[int], np.dtype[np.str_]]]:
    """Columns of unit size at the rows that count, and the cause of each, "" for mass, damping, stiffness."""
    blocks, owners = [regression.block({}, "", ())], [""] * 3
    for name, candidate in CANDIDATES.items():
        if isinstance(candidate, Changing):
            continue
        for shape in _shapes(regression, candidate):
            blocks.append(regression.block({}, name, shape))
            owners += [base_name(name)] * blocks[-1].shape[1]
    phi = np.hstack(blocks)[regression.signals.rows]
    scale = np.std(phi, axis=0)
    scale[scale < 1e-12] = 1.0  # a constant
    return phi / scale, np.array(owners)


def _shapes(regression: RecordingRegression, candidate: Candidate) -> list[Shape]:
    """The strongest line of what repeats, or the ends of a grid and its middle."""
    if isinstance(candidate, Periodic | PositionWave):
        periods, plain = Periods(regression), regression.fit({"bias": ()})
        return periods.lines(plain, 1) if isinstance(candidate, Periodic) else periods.over_position(plain, 1)
    grid = candidate.grid(regression.extent)
    last = len(grid) - 1
    return [grid[place] for place in sorted({0, last // 2, last})] if grid else []
