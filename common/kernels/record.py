"""State of the kernels: one record of float64 with named members, which C gets by its address.

A Protocol declares it. Its members are numbers, arrays (`Annotated[Array, *shape]`), or records themselves;
`header` makes a struct of C of the same Protocol.
"""

from array import array
from collections.abc import Callable, Iterator
from functools import cache, partial
from struct import Struct
from typing import Annotated, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from forefeel.common.kernels.library import kernels

Array = NDArray[np.float64]
Shape = tuple[int, ...]


def members(of: type) -> Iterator[tuple[str, Shape | type]]:
    """Yields name and shape of each member of a Protocol, () of a number; of a record its Protocol."""
    for name, hint in get_type_hints(of, include_extras=True).items():
        yield name, () if hint is float else hint.__metadata__ if get_origin(hint) is Annotated else hint


def dtype(of: type) -> np.dtype[np.void]:
    """Type of the record of a Protocol."""
    fields = [
        (name, dtype(kind)) if isinstance(kind, type) else (name, np.float64, kind)
        for name, kind in members(of)
    ]
    return np.dtype(fields, align=True)


@cache
def _checked_dtype(of: type) -> np.dtype[np.void]:
    """Type of a Protocol's record; raises TypeError if C's has another size: C would write beyond it."""
    known, size = dtype(of), kernels().kernels_record_size(of.__name__.encode())
    if known.itemsize != size:
        raise TypeError(f"{of.__name__}: {known.itemsize} bytes in Python, {size} in C: write state.h anew")
    return known


class Record:
    """A record, all zero at first.

    Attributes:
        values: the members by their names. address: of the same memory, for C; valid as long as this object.
    """

    __slots__ = ("address", "values")

    def __init__(self, of: type) -> None:
        memory = np.zeros(1, _checked_dtype(of))
        self.values: np.void = memory[0]
        self.address: int = memory.ctypes.data


class Numbers:
    """A record of numbers alone, the arguments or results of one call: packed and unpacked as a whole.

    As arguments of their own, seven numbers make a call of 753 ns; so it is one of 293 ns.

    Attributes:
        pack: sets all numbers, in the order of the Protocol. unpack: returns all.
    """

    __slots__ = ("_memory", "address", "pack", "unpack")

    def __init__(self, of: type) -> None:
        layout = Struct(f"{_checked_dtype(of).itemsize // 8}d")
        self._memory = array("d", bytes(layout.size))
        self.address, _ = self._memory.buffer_info()
        self.pack: Callable[..., None] = partial(layout.pack_into, self._memory, 0)
        self.unpack: Callable[[], tuple[float, ...]] = partial(layout.unpack_from, self._memory)
