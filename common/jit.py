"""Compilation of numeric kernels to machine code by numba, kept beside the source between runs.

A kernel holds the interpreter lock from its first to its last instruction, so that for every other thread
one call is one indivisible step. With `FOREFEEL_JIT=0` in the environment (or numba's own
`NUMBA_DISABLE_JIT=1`) every kernel is plain Python, which a debugger can enter. It gives the same results
some 20 times as slowly.

The state of kernels is one numpy record with named fields, which a kernel gets by one pointer. A Protocol
declares it, whose members are the fields, and `record` makes the dtype of it. Kernels read and write
`state.field`; a field that is itself a record nests.
"""

import hashlib
import os
from collections.abc import Callable
from contextlib import suppress
from functools import cache, wraps
from pathlib import Path
from typing import Annotated, Any, TypeVar, cast, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
F = TypeVar("F", bound=Callable[..., Any])
Field = tuple[str, Any] | tuple[str, Any, tuple[int, ...]]

COMPILED = os.environ.get("FOREFEEL_JIT", "1") != "0" and os.environ.get("NUMBA_DISABLE_JIT", "0") == "0"
_KEPT = "*.nbi", "*.nbc"
"""Files that numba keeps in `__pycache__`: an index and the code of each kernel."""
_WITH_KERNELS = "common/estimation", "common/causes"
_STAMP = "common/__pycache__/kernels.sha256"


def kernel(function: F) -> F:
    """Compiles at the first call; later processes load the result. Rounding stays that of Python's floats."""
    return _compiled(function, fastmath=False)


def fast_kernel(function: F) -> F:
    """Compiles like `kernel`; sums may be reordered, so that they use the processor's wide registers."""
    return _compiled(function, fastmath={"reassoc", "contract", "nsz"})


def _compiled(function: F, fastmath: bool | set[str]) -> F:
    """Makes a numba function that is compiled at its first call and kept on the disk; plain Python where
    `COMPILED` is false. First removes stale code. `fastmath`: what numba may do to sums, False: nothing.
    """
    if not COMPILED:
        return _plain(function)
    import numba  # noqa: PLC0415 - not needed for plain Python

    _remove_stale_code()
    return cast(F, numba.njit(cache=True, fastmath=fastmath)(function))


def _plain(function: F) -> F:
    """Makes records `recarray`s: they have attributes in numba, in numpy only so."""

    @wraps(function)
    def call(*arguments: object) -> object:
        return function(*map(_with_attributes, arguments))

    return cast(F, call)


def _with_attributes(argument: object) -> object:
    if isinstance(argument, np.ndarray) and argument.dtype.names is not None:
        return argument.view(np.recarray)
    return argument


@cache
def _remove_stale_code() -> None:
    """Deletes all code that numba has kept where a kernel's source has changed; once in a process.

    Numba takes what it kept for fresh as long as the kernel's own file is unchanged, though the code of every
    kernel that it calls is in there. Where the folder can not be written, as in a container, nothing changes.
    """
    package = Path(__file__).parents[1]  # forefeel/, by its links: not resolved
    folders = [package / name for name in _WITH_KERNELS]
    sources = b"\0".join(path.read_bytes() for folder in folders for path in sorted(folder.rglob("*.py")))
    digest, stamp = hashlib.sha256(sources).hexdigest(), package / _STAMP
    with suppress(OSError):
        if stamp.exists() and stamp.read_text(encoding="ascii") == digest:
            return
        for path in (path for folder in folders for pattern in _KEPT for path in folder.rglob(pattern)):
            path.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(digest, encoding="ascii")


def record(of: type) -> np.dtype[np.void]:
    """The record of a class by its annotations: float, Annotated[Array, *shape], or a class like it."""
    return np.dtype(
        [_field(name, hint) for name, hint in get_type_hints(of, include_extras=True).items()], align=True
    )


def _field(name: str, hint: Any) -> Field:  # noqa: ANN401 - a type hint
    if hint is float:
        return name, np.float64
    if get_origin(hint) is Annotated:
        return name, np.float64, hint.__metadata__
    return name, record(hint)


def zeros(dtype: np.dtype[np.void]) -> NDArray[np.void]:
    """One record, all zero, as an array of length 1: kernels take that and index it."""
    return np.zeros(1, dtype)
