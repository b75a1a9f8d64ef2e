"""State of compiled kernels: one numpy record with named fields, which a kernel gets by one pointer.

A state is declared twice, as numpy and the type checker each want it: as a dtype by `record`, and as a
Protocol whose members are the fields. Kernels read and write `state.field`; a field that is itself a record
nests.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Field = tuple[str, Any] | tuple[str, Any, tuple[int, ...]]


def record(scalars: str, *others: Field) -> np.dtype[np.void]:
    """A record of the named float64 `scalars` (parted by blanks) and of `others`: (name, type, shape)."""
    fields: list[Field] = [(name, np.float64) for name in scalars.split()]
    return np.dtype([*fields, *others], align=True)


def floats(name: str, *shape: int) -> Field:
    """A field that is an array of float64."""
    return name, np.float64, shape


def zeros(dtype: np.dtype[np.void]) -> NDArray[np.void]:
    """One record, all zero, as an array of length 1: kernels take that and index it."""
    return np.zeros(1, dtype)
