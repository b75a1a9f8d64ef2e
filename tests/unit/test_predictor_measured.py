"""The predictor on recordings that others measured. The bounds leave 15 % to what it does today."""

from pathlib import Path

import numpy as np
import pytest

from forefeel.common.recording.loading import load_recording
from tests.unit.predictor_samples import Sample, replayed, scored

DELAY_S = 0.3
BOUNDS = {
    "seal_o_ring_3bar": 0.225,
    "presliding_friction": 0.099,
    "emps_test": 0.170,
}
"""rms as a share of that of the zero-order hold."""


@pytest.mark.parametrize("name", BOUNDS)
def test_error_and_band(name: str, data_dir: Path) -> None:
    recording = load_recording(data_dir / f"{name}.csv")
    assert recording.force_n is not None
    cut = slice(0, 20_000)
    sample = Sample(recording.time_s[cut], recording.position_m[cut], recording.force_n[cut])
    said, rows = replayed(sample, DELAY_S), scored(sample, DELAY_S)
    error_n, zoh_n = (said.force - sample.f)[rows], (said.held - sample.f)[rows]
    rms_n, zoh_rms_n = said.rms(sample.f, rows), said.zoh_rms(sample.f, rows)
    assert np.abs(error_n).max() <= 1.1 * np.abs(zoh_n).max()
    inside = ((said.low <= sample.f) & (sample.f <= said.high))[rows]
    assert 0.93 <= np.mean(inside) <= 0.97
    assert np.mean((said.high - said.low)[rows]) <= 5.0 * rms_n
    assert rms_n <= BOUNDS[name] * zoh_rms_n
