"""Contact force now, not after the network; and what a simulation of it leaves out.

    import forefeel as ff

    rec = ff.load("run.csv")
    d = ff.diagnose(rec)
    print(d, d.verdict)
    e = ff.evaluate(rec, delay_s=0.3)

All quantities are SI; a rotation has rad for m and N m for N. Each name is imported when it is used: a stop
imports none of them.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from forefeel.cell import Axis, Cell, connect
    from forefeel.common.errors import ForefeelError, UnclearError
    from forefeel.common.estimation.predictor import Predictor
    from forefeel.common.recording.loading import load
    from forefeel.common.recording.recording import Recording
    from forefeel.diagnosis.excitation import Limits
    from forefeel.library import (
        Cause,
        Confirmation,
        Diagnosis,
        Evaluation,
        Investigation,
        Model,
        diagnose,
        diagnose_folder,
        evaluate,
        investigate,
    )

    __version__: str

_ELSEWHERE = {
    "Axis": "forefeel.cell",
    "Cell": "forefeel.cell",
    "ForefeelError": "forefeel.common.errors",
    "Predictor": "forefeel.common.estimation.predictor",
    "Recording": "forefeel.common.recording.recording",
    "UnclearError": "forefeel.common.errors",
    "Limits": "forefeel.diagnosis.excitation",
    "connect": "forefeel.cell",
    "load": "forefeel.common.recording.loading",
}
__all__ = [
    "Axis",
    "Cause",
    "Cell",
    "Confirmation",
    "Diagnosis",
    "Evaluation",
    "ForefeelError",
    "Investigation",
    "Limits",
    "Model",
    "Predictor",
    "Recording",
    "UnclearError",
    "__version__",
    "connect",
    "diagnose",
    "diagnose_folder",
    "evaluate",
    "investigate",
    "load",
]


def __getattr__(name: str) -> object:
    if name == "__version__":
        return import_module("importlib.metadata").version("forefeel")
    if name in __all__:
        return getattr(import_module(_ELSEWHERE.get(name, "forefeel.library")), name)
    raise AttributeError(f"module 'forefeel' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
