"""Made-up recordings for the tests of the evaluation."""

import numpy as np
from numpy.typing import NDArray

from forefeel.common.recording.recording import Recording

Floats = NDArray[np.float64]


def made_up(
    duration_s: float = 8.0,
    period_s: float = 0.01,
    gap_s: float = 0.4,
    uneven: float = 0.2,
    seed: int = 1,
    friction_n: float = 0.05,
) -> Recording:
    """Two sines against mass, damper, spring, friction and bias, with noise; a gap in the middle."""
    rng = np.random.default_rng(seed)
    n = round(duration_s / period_s)
    time_s = np.arange(n) * period_s + uneven * period_s * rng.uniform(-0.4, 0.4, n)
    time_s[n // 2 :] += gap_s
    w1, w2 = 2 * np.pi * 0.7, 2 * np.pi * 1.9
    x = 0.004 * np.sin(w1 * time_s) + 0.002 * np.sin(w2 * time_s + 1)
    v = 0.004 * w1 * np.cos(w1 * time_s) + 0.002 * w2 * np.cos(w2 * time_s + 1)
    a = -0.004 * w1**2 * np.sin(w1 * time_s) - 0.002 * w2**2 * np.sin(w2 * time_s + 1)
    force_n = 0.05 * a + 2.0 * v + 80.0 * x + 0.3 + rng.normal(0, 2e-3, n)
    force_n += friction_n * np.tanh(v / 1e-3)
    return recording(time_s, x, force_n)


def recording(time_s: Floats, position_m: Floats, force_n: Floats | None, name: str = "made-up") -> Recording:
    return Recording(name, time_s, position_m, force_n, source=f"{name}.csv")


def csv_text(of: Recording) -> str:
    """Canonical columns, every float as it is."""
    columns = [of.time_s, of.position_m] + ([] if of.force_n is None else [of.force_n])
    header = ["time_s", "position_m", "force_n"][: len(columns)]
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return "\n".join([",".join(header), *(",".join(map(repr, row)) for row in rows)]) + "\n"


def zoh_oracle(time_s: Floats, force_n: Floats, delay_s: float) -> Floats:
    """By the definition alone: the newest force stamped <= t - delay, NaN before the first."""
    zoh_n = np.full(len(time_s), np.nan)
    for k, t in enumerate(time_s):
        known = time_s <= t - delay_s
        if known.any():
            zoh_n[k] = force_n[known][-1]
    return zoh_n
