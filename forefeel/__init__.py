"""Contact force now, not after the network; and what a simulation of it leaves out.

    import forefeel as ff

    rec = ff.load("run.csv")
    d = ff.diagnose(rec)
    print(d, d.verdict)
    e = ff.evaluate(rec, delay_s=0.3)

See `forefeel.library` and `forefeel.cell`. They are imported when they are used: a stop imports none of it.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from forefeel.cell import Axis, Cell, connect
    from forefeel.library import (
        Cause,
        Diagnosis,
        Evaluation,
        Model,
        Predictor,
        Recording,
        diagnose,
        evaluate,
        load,
    )

    __version__: str

_CELL = "Axis", "Cell", "connect"
__all__ = [
    "Axis",
    "Cause",
    "Cell",
    "Diagnosis",
    "Evaluation",
    "Model",
    "Predictor",
    "Recording",
    "__version__",
    "connect",
    "diagnose",
    "evaluate",
    "load",
]


def __getattr__(name: str) -> object:
    if name == "__version__":
        return import_module("importlib.metadata").version("forefeel")
    if name in __all__:
        return getattr(import_module("forefeel.cell" if name in _CELL else "forefeel.library"), name)
    raise AttributeError(f"module 'forefeel' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
