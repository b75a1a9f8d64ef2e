"""The picture of README.md, docs/assets/error-over-delay.svg: `python -m benchmarks.prediction_figure`.

It prints the tables of `benchmarks.prediction` at the picture's delays for the picture's methods, and draws
them.
"""

from collections.abc import Mapping
from pathlib import Path
from textwrap import fill

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from benchmarks.prediction import main
from forefeel.diagnosis.evaluation.delays import CLINICAL_DELAYS, CLINICAL_SOURCES

_UNIT_MS = 300.0  # the late force's error at this delay is 1
_LARGEST = 1.7  # methods that are further off leave the picture
_WORN: Mapping[str, tuple[str, str, str]] = {
    "zoh": ("#b4267a", "--", "late force"),
    "forefeel": ("#0868ac", "-", "forefeel"),
}
_OTHERS = ("#7a8797", "#c2410c", "#946200", "#007f5f")
_DELAYS_MS = "20,60,120,250,300,450,600"
_METHODS = "zoh", "paper", "mbk_bias", "kernel_ridge", "forefeel"
_PICTURE = Path(__file__).parents[1] / "docs" / "assets" / "error-over-delay.svg"


def relative(sizes_n: Mapping[tuple[str, float, str], float | None], method: str, delay_ms: float) -> float:
    """Geometric mean, over the recordings that have both, of a method's error over that of the late force at
    300 ms. `sizes_n`: by recording, delay in ms and method.
    """
    parts = [
        size_n / unit_n
        for (name, at_ms, of), size_n in sizes_n.items()
        if (at_ms, of) == (delay_ms, method) and size_n and (unit_n := sizes_n[name, _UNIT_MS, "zoh"])
    ]
    return float(np.exp(np.mean(np.log(parts))))


def draw(path: Path, sizes_n: Mapping[tuple[str, float, str], float | None]) -> None:
    """Writes the picture, the same bytes for the same numbers."""
    delays_ms = sorted({at_ms for _, at_ms, _ in sizes_n})
    n = len({name for name, _, _ in sizes_n})
    with mpl.rc_context({"svg.hashsalt": "forefeel", "svg.fonttype": "none", "font.size": 9}):
        figure = Figure(figsize=(8.0, 3.8), layout="constrained")
        axes = figure.subplots()
        others = iter(_OTHERS)
        for method in _METHODS:
            colour, dash, label = _WORN.get(method) or (next(others), ":", method)
            values = [relative(sizes_n, method, at_ms) for at_ms in delays_ms]
            axes.plot(delays_ms, values, dash, color=colour, marker="o", markersize=3, label=label)
        for (at_s, what), side in zip(CLINICAL_DELAYS, ("center", "center", "right", "left"), strict=True):
            axes.axvline(1e3 * at_s, color="0.75", linewidth=0.8, zorder=0)
            text = fill(f"{1e3 * at_s:g} ms: {what}", 24)
            axes.text(1e3 * at_s, 1.02 * _LARGEST, text, ha=side, va="bottom", size=7, color="0.3")
        axes.set(
            xlim=(0.0, max(delays_ms)), ylim=(0.0, _LARGEST), xlabel=f"round trip, ms   ({CLINICAL_SOURCES})",
            ylabel=f"error; late force at {_UNIT_MS:g} ms = 1\n(geometric mean of {n} recordings)",
        )  # fmt: skip
        figure.legend(loc="outside lower center", ncols=len(_METHODS))
        figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    rows = main(("--delays", _DELAYS_MS, "--methods", ",".join(_METHODS), "--demo"))
    known = [row for row in rows if row.kind == "recordings"]
    draw(_PICTURE, {(row.recording, round(1e3 * row.delay_s), row.method): row.rms_n for row in known})
