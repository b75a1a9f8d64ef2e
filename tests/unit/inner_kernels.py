"""Inner kernels, which the product calls from C alone: common/kernels/unit_tests.c."""

import ctypes
from functools import cache
from typing import Any

import numpy as np

from forefeel.common.kernels.library import kernels
from forefeel.common.kernels.record import Array, Record


@cache
def _kernel(name: str, result: Any = None) -> Any:  # noqa: ANN401 - of ctypes
    entry = kernels()[f"test_{name}"]
    entry.restype = result
    return entry


def _argument(value: float | Array | Record) -> object:
    if isinstance(value, Record):
        return ctypes.c_void_p(value.address)
    if isinstance(value, np.ndarray):
        assert value.flags.c_contiguous
        assert value.dtype == np.float64
        return ctypes.c_void_p(value.ctypes.data)
    return ctypes.c_int(value) if isinstance(value, int) else ctypes.c_double(value)


def call(name: str, *arguments: float | Array | Record) -> None:
    """Calls a kernel without a result; an int is passed as one, any other number as a double."""
    _kernel(name)(*map(_argument, arguments))


def number(name: str, *arguments: float | Array | Record) -> float:
    """Calls a kernel that returns a double."""
    return float(_kernel(name, ctypes.c_double)(*map(_argument, arguments)))


def count(name: str, *arguments: float | Array | Record) -> int:
    """Calls a kernel that returns an integer."""
    return int(_kernel(name, ctypes.c_long)(*map(_argument, arguments)))
