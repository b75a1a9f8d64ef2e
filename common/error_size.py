"""The size of an error: rms, 95 % quantile, maximum."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ErrorSize:
    """Root mean square, 95 % quantile and maximum of the error's size; None without a sample."""

    rms_n: float | None = None
    p95_n: float | None = None
    max_n: float | None = None


def error_size(estimate_n: Floats, force_n: Floats) -> ErrorSize:
    """Root mean square, 95 % quantile and maximum of |estimate_n - force_n|, squared without overflow. Each
    is None where it is not finite, as when a model ran away; all are None for empty arrays.
    """
    if not len(force_n):
        return ErrorSize()
    with np.errstate(over="ignore", invalid="ignore"):
        size = np.abs(estimate_n - force_n)
        largest = float(size.max())
        # scaled, so that squares of a diverged prediction do not overflow
        whole = largest * rms(size / largest) if largest else 0.0
        return ErrorSize(_finite(whole), _finite(float(np.quantile(size, 0.95))), _finite(largest))


def rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
