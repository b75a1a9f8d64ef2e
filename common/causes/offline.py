"""What the evaluation of whole recordings shares: arrays, intervals, loops compiled when first needed."""

from collections.abc import Callable
from functools import cache, wraps
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
F = TypeVar("F", bound=Callable[..., Any])


def intervals_s(t: Array) -> Array:
    """dt before each stamp, shape (n,); 0 before the first, where every effect is at rest."""
    return np.diff(t, prepend=t[:1])


def lazy_kernel(function: F) -> F:
    """Compiles the loop at its first call: a daemon, which never calls it, does not load the compiler.

    Arrays reach it contiguous and writable, copied where they are not: one compilation fits all recordings.
    """

    @cache
    def compiled() -> Callable[..., Any]:
        from forefeel.common.jit import kernel  # noqa: PLC0415 - loads numba

        return kernel(function)

    @wraps(function)
    def call(*arguments: object) -> object:
        return compiled()(*map(_plain, arguments))

    return cast(F, call)


def _plain(argument: object) -> object:
    return np.require(argument, np.float64, ["C", "W"]) if isinstance(argument, np.ndarray) else argument
