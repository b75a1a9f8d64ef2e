"""The library of kernels, loaded once, with the interpreter lock held during every call.

For every other thread one call is one indivisible step: `ctypes.PyDLL`, unlike `CDLL`, does not release the
lock. C checks no argument: callers pass addresses of a `record.Record`, and arrays of equal lengths.
"""

import ctypes
from collections.abc import Mapping
from functools import cache
from typing import Any

from forefeel.common.errors import InputError
from forefeel.common.kernels.build import FOLDER, LIBRARY, sources_sha256

_ADDRESS, _LONG, _DOUBLE = ctypes.c_void_p, ctypes.c_long, ctypes.c_double
_ENTRIES: Mapping[str, tuple[Any, ...]] = {
    "kernels_record_size": (_LONG, ctypes.c_char_p),
    "evaluator_move": (None, _ADDRESS, _ADDRESS),
    "evaluator_receive": (None, _ADDRESS, _ADDRESS),
    "evaluator_predict": (None, _ADDRESS, _ADDRESS, _ADDRESS),
    "evaluator_moved_s": (_DOUBLE, _ADDRESS),
    "learner_take": (_LONG, _ADDRESS, _ADDRESS, _ADDRESS),
    "learner_publish": (None, _ADDRESS, _ADDRESS),
    "prandtl_element": (None, *[_ADDRESS] * 2, _LONG),
    "bristle": (None, *[_ADDRESS] * 3, _LONG),
    "lag": (None, *[_ADDRESS] * 2, _DOUBLE, _ADDRESS, _LONG),
    "gap": (None, *[_ADDRESS] * 6, _LONG),
    "oscillator": (None, *[_ADDRESS] * 7, _LONG),
    "slip": (None, *[_ADDRESS] * 8, _LONG),
    "path_normal_equations": (None, *[_ADDRESS] * 6, _LONG),
}
"""Type of the result, then of the arguments."""


@cache
def kernels() -> ctypes.PyDLL:
    """Loads the compiled library and declares the types of its functions.

    Raises:
        InputError: it is not built, not of the sources beside it, or not of this machine.
    """
    if not LIBRARY.exists():
        raise InputError(f"{LIBRARY}: the kernels are not built: make demo")
    try:
        library = ctypes.PyDLL(str(LIBRARY))
    except OSError as error:
        raise InputError(f"the kernels can not be loaded: {error}: make demo") from error
    library.kernels_sources_sha256.restype = ctypes.c_char_p
    # without sources there is nothing that could be newer; an older library may lack an entry
    built_from = library.kernels_sources_sha256().decode()
    if any(FOLDER.glob("*.c")) and built_from != sources_sha256(FOLDER):
        raise InputError(f"{LIBRARY}: the kernels are older than their source: make demo")
    for name, (result, *arguments) in _ENTRIES.items():
        entry = library[name]
        entry.restype, entry.argtypes = result, arguments
        setattr(library, name, entry)
    return library
