"""Compilation of numeric kernels to machine code, kept beside the source between runs.

A kernel holds the interpreter lock from its first to its last instruction, so that for every other thread
one call is one indivisible step.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compiles at the first call; later processes load the result. Rounding stays that of Python's floats."""
    return cast(F, numba.njit(cache=True)(function))


def fast_kernel(function: F) -> F:
    """As `kernel`; sums may be reordered, so that they use the processor's wide registers."""
    return cast(F, numba.njit(cache=True, fastmath={"reassoc", "contract", "nsz"})(function))
