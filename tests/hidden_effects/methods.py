"""The diagnosis and its peers, by name. A peer's library, an extra, is imported where it is asked."""

import time
import warnings
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from forefeel.common.causes.candidate import Candidate, Changing, Periodic, PositionWave, Shape, base_name
from forefeel.common.causes.catalogue import CANDIDATES
from forefeel.common.error_size import Floats
from forefeel.diagnosis.analysis import conditioned
from forefeel.diagnosis.regression import RecordingRegression
from forefeel.diagnosis.search import Periods
from forefeel.diagnosis.sensor_faults import clean
from tests.hidden_effects.answers import Answer, Measured, Method
from tests.hidden_effects.columns import CONSTANT, answer, candidates, moves
from tests.hidden_effects.product import diagnosed, recording_of

PRODUCT = "product"
TITLES = {
    PRODUCT: "diagnosis",
    "pysindy": "PySINDy STLSQ",
    "sysidentpy": "sysidentpy FROLS",
    "memory": "STLSQ over the diagnosis' columns",
}
_BLOCKS = 5
_THRESHOLDS = (0.01, 0.02, 0.04, 0.07, 0.1, 0.15, 0.25, 0.4)
"""Of STLSQ, in units of the std of the force."""
_FIRST_INPUT = 2
"""FROLS' code of a term is 1000 times the signal and the lag; signal 1 is the output, 0 the constant."""


def method_of(name: str) -> Method:
    """One of TITLES; it raises ImportError where its library is not installed."""
    peers = {"pysindy": sparse, "sysidentpy": regressed, "memory": sparse_with_memory}
    return diagnosed if name == PRODUCT else peers[name]


def sparse(measured: Measured) -> Answer:
    """PySINDy's STLSQ over columns of unit std."""
    return _chosen(measured, _sparsest)


def regressed(measured: Measured) -> Answer:
    """sysidentpy's FROLS, forward regression by the error reduction ratio, with the least BIC's terms."""
    return _chosen(measured, _forward)


def sparse_with_memory(measured: Measured) -> Answer:
    """STLSQ over the diagnosis' own columns, those with a memory too.

    A shape parameter, such as a time constant or a length, is not searched: each of three of its values has
    columns of its own. Causes that are no column (a play, a delay, a lost contact, a factor on the force)
    have none here.
    """
    start_s, recording = time.perf_counter(), recording_of(measured)
    try:
        regression = conditioned(recording, clean(recording)) if moves(measured) else None
    except ValueError:  # too few samples in a row
        regression = None
    if regression is None:
        return Answer("refused", seconds=time.perf_counter() - start_s)
    phi, owners = _columns(regression)
    sizes_n = np.abs(_sparsest(phi, regression.signals.force[regression.signals.rows]))
    explained = {owner: float(sizes_n[owners == owner].max()) for owner in dict.fromkeys(owners) if owner}
    names = tuple(sorted((name for name in explained if explained[name]), key=lambda n: -explained[n]))
    verdict = "cause_found" if names else "nothing_missing"
    return Answer(verdict, names, seconds=time.perf_counter() - start_s)


def _chosen(measured: Measured, choose: Callable[[Floats, Floats], Floats]) -> Answer:
    """The answer of a choice among the columns, by `choose(columns of unit std, force)`."""
    start_s = time.perf_counter()
    if not moves(measured):
        return Answer("refused", seconds=time.perf_counter() - start_s)
    phi, force = candidates(measured)
    scale = _scale(phi)
    coefficients = choose(phi / scale, force)
    return answer(coefficients, coefficients / scale, time.perf_counter() - start_s)


def _scale(phi: Floats) -> Floats:
    scale = np.std(phi, axis=0)
    scale[scale < 1e-12] = 1.0  # a constant
    return np.asarray(scale, dtype=np.float64)


def _sparsest(phi: Floats, force: Floats) -> Floats:
    """Coefficients at the threshold of the sparsest model whose error on held-out blocks is within one
    standard error of the best.
    """
    unit = float(np.std(force))
    force = force / unit
    blocks = np.array_split(np.arange(len(force)), _BLOCKS)
    errors = np.array([[_error(phi, force, block, limit) for block in blocks] for limit in _THRESHOLDS])
    mean = np.mean(errors, axis=1)
    best = int(np.argmin(mean))
    allowed = mean[best] + float(np.std(errors[best])) / np.sqrt(_BLOCKS)
    last = max(n for n, error in enumerate(mean) if error <= allowed)
    return _fitted(phi, force, _THRESHOLDS[last]) * unit


def _error(phi: Floats, force: Floats, block: NDArray[np.int_], limit: float) -> float:
    others = np.ones(len(force), dtype=bool)
    others[block] = False
    rest = force[block] - phi[block] @ _fitted(phi[others], force[others], limit)
    return float(np.mean(rest * rest))


def _fitted(phi: Floats, force: Floats, threshold: float) -> Floats:
    from pysindy import STLSQ

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = STLSQ(threshold=threshold, alpha=1e-6, max_iter=30).fit(phi, force[:, None])
    return np.asarray(model.coef_[0], dtype=np.float64)


def _forward(phi: Floats, force: Floats) -> Floats:
    """A coefficient for each column, 0 for those left out; FROLS regards columns one sample back."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    count = phi.shape[1]
    method = FROLS(
        order_selection=True, n_info_values=count, info_criteria="bic", err_tol=None, model_type="NFIR",
        xlag=[[1]] * count, basis_function=Polynomial(degree=1), estimator=LeastSquares(),
    )  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        method.fit(X=np.vstack([phi[1:], phi[-1:]]), y=force[:, None])
    coefficients = np.zeros(count)
    for code, value in zip(np.ravel(method.final_model), np.ravel(method.theta), strict=True):
        coefficients[int(code) // 1000 - _FIRST_INPUT if code else CONSTANT] += value
    return coefficients


def _columns(regression: RecordingRegression) -> tuple[Floats, NDArray[np.str_]]:
    """Columns of unit size at the rows that count, and the cause of each, "" for mass, damping, stiffness."""
    blocks, owners = [regression.block({}, "", ())], [""] * 3
    for name, candidate in CANDIDATES.items():
        if isinstance(candidate, Changing):
            continue
        for shape in _shapes(regression, candidate):
            blocks.append(regression.block({}, name, shape))
            owners += [base_name(name)] * blocks[-1].shape[1]
    phi = np.hstack(blocks)[regression.signals.rows]
    return phi / _scale(phi), np.array(owners)


def _shapes(regression: RecordingRegression, candidate: Candidate) -> list[Shape]:
    """The strongest line of what repeats, or the ends of a grid and its middle."""
    if isinstance(candidate, Periodic | PositionWave):
        periods, plain = Periods(regression), regression.fit({"bias": ()})
        return periods.lines(plain, 1) if isinstance(candidate, Periodic) else periods.over_position(plain, 1)
    grid = candidate.grid(regression.extent)
    last = len(grid) - 1
    return [grid[place] for place in sorted({0, last // 2, last})] if grid else []
