"""A peer: sysidentpy's FROLS (forward regression by the error reduction ratio) over the same columns.

The number of terms is the one of the least BIC, its own way to choose it.
"""

import time
import warnings

import numpy as np
from sysidentpy.basis_function import Polynomial
from sysidentpy.model_structure_selection import FROLS
from sysidentpy.parameter_estimation import LeastSquares

from forefeel.common.error_size import Floats
from tests.hidden_effects.answers import Answer, Measured
from tests.hidden_effects.columns import CONSTANT, answer, candidates, moves

_FIRST_INPUT = 2
"""Its code of a term is 1000 times the signal and the lag; signal 1 is the output, 0 the constant."""


def regressed(measured: Measured) -> Answer:
    start_s = time.perf_counter()
    if not moves(measured):
        return Answer("refused", seconds=time.perf_counter() - start_s)
    phi, force = candidates(measured)
    scale = np.std(phi, axis=0)
    scale[scale < 1e-12] = 1.0
    coefficients = _chosen(phi / scale, force)
    return answer(coefficients, coefficients / scale, time.perf_counter() - start_s)


def _chosen(phi: Floats, force: Floats) -> Floats:
    """A coefficient for each column, 0 for those that it leaves out. It regards columns one sample back."""
    count = phi.shape[1]
    method = FROLS(
        order_selection=True, n_info_values=count, info_criteria="bic", err_tol=None, model_type="NFIR",
        xlag=[[1]] * count, basis_function=Polynomial(degree=1), estimator=LeastSquares(),
    )  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        method.fit(X=np.vstack([phi[1:], phi[-1:]]), y=force[:, None])
    found = np.zeros(count)
    for code, value in zip(np.ravel(method.final_model), np.ravel(method.theta), strict=True):
        found[int(code) // 1000 - _FIRST_INPUT if code else CONSTANT] += value
    return found
