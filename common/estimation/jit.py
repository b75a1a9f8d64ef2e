"""Compilation of numeric kernels to machine code, kept beside the source between runs.

A kernel holds the interpreter lock from its first to its last instruction, so that for every other thread
one call is one indivisible step.

Numba takes what it kept for fresh as long as the kernel's own file is unchanged, though the code of every
kernel that it calls is in there. Here it is fresh as long as neither a source file of this package nor the
kernel's own has changed.
"""

import hashlib
import linecache
from collections.abc import Callable, Iterator
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def _sources(folder: Traversable) -> Iterator[bytes]:
    """The source files in `folder` and below, always in the same order."""
    for entry in sorted(folder.iterdir(), key=lambda entry: entry.name):
        if entry.is_dir():
            yield from _sources(entry)
        elif entry.name.endswith(".py"):
            yield entry.read_bytes()


_SOURCES = hashlib.sha256(b"\0".join(_sources(files(__package__ or "")))).hexdigest()


def kernel(function: F) -> F:
    """Compiles at the first call; later processes load the result. Rounding stays that of Python's floats."""
    return _kept(cast(F, numba.njit(cache=True)(function)))


def fast_kernel(function: F) -> F:
    """As `kernel`; sums may be reordered, so that they use the processor's wide registers."""
    return _kept(cast(F, numba.njit(cache=True, fastmath={"reassoc", "contract", "nsz"})(function)))


def _kept(compiled: F) -> F:
    """`compiled`, with the stamp of all sources instead of its own; numba has no public way to say so."""
    own = "".join(linecache.getlines(cast(Any, compiled).py_func.__code__.co_filename))
    stamp = hashlib.sha256((_SOURCES + own).encode()).hexdigest()
    cast(Any, compiled)._cache._cache_file._source_stamp = stamp
    return compiled
