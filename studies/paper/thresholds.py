"""The error beside what a finger can feel.

The just noticeable difference of a force is 7 to 10 % of it; near zero the absolute threshold of 29 to 44 mN
counts instead. Both apply to what the hand is shown, after force scaling.
"""

from typing import Literal

import numpy as np

from forefeel.studies.paper.contact import Array
from forefeel.studies.paper.replay import RunPredictions
from forefeel.studies.paper.results import ThresholdRow, error_size

RELATIVE = 0.07, 0.10  # share of the force, strict and lenient just noticeable difference (see above)
ABSOLUTE_N = 0.029, 0.044  # N, strict and lenient absolute threshold of a finger (see above)

Method = Literal["zoh", "paper", "product"]
METHODS: tuple[Method, ...] = ("zoh", "paper", "product")


def share_unfelt(error_n: Array, force_n: Array, absolute_n: float, relative: float) -> float | None:
    """Share of the samples whose error is below the larger of both thresholds; None without a sample."""
    if not len(error_n):
        return None
    return float(np.mean(np.abs(error_n) < np.maximum(absolute_n, relative * np.abs(force_n))))


def threshold_rows(made: RunPredictions) -> list[ThresholdRow]:
    """One row per method of a run on the simulated bench."""
    return [_row(made, method) for method in METHODS]


def _row(made: RunPredictions, method: Method) -> ThresholdRow:
    run, rows = made.run, made.scored
    force_n = run.force_scale * run.force_n[rows]
    shown_n = run.force_scale * made.method(method)[rows]

    def share(absolute_n: float, relative: float) -> float | None:
        return share_unfelt(shown_n - force_n, force_n, absolute_n, relative)

    return ThresholdRow(
        instrument=run.instrument,
        style=run.style,
        method=method,
        force_scale=run.force_scale,
        scored_s=made.scored_s,
        error_at_hand=error_size(shown_n, force_n),
        strict_share=share(ABSOLUTE_N[0], RELATIVE[0]),
        lenient_share=share(ABSOLUTE_N[1], RELATIVE[1]),
        absolute_share=share(ABSOLUTE_N[0], 0.0),
        relative_share=share(0.0, RELATIVE[0]),
    )
