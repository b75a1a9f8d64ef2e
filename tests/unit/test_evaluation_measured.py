"""The evaluation on recordings that others measured."""

import os
from pathlib import Path

import numpy as np
import pytest

from forefeel.common.recording.tabular import load_recording
from forefeel.diagnosis.evaluation.arrivals import DelayedLink
from forefeel.diagnosis.evaluation.evaluate import evaluate, prepare

DATA = os.environ.get("FOREFEEL_DATA")
WITH_FORCE = (
    "emps_train",
    "emps_test",
    "silverbox_train",
    "silverbox_test_arrow",
    "seal_o_ring_1bar",
    "seal_o_ring_3bar",
    "presliding_friction",
)


@pytest.mark.skipif(not DATA, reason="FOREFEEL_DATA names no folder with measured recordings")
@pytest.mark.parametrize("name", ["presliding_friction", "seal_o_ring_3bar"])
def test_every_method_has_a_finite_score_and_the_hold_is_numpys(name: str) -> None:
    recording = load_recording(Path(DATA or "") / f"{name}.csv")
    evaluated = evaluate(prepare(recording, DelayedLink(0.3)), None)
    time_s, force_n = recording.time_s, recording.force_n
    assert force_n is not None
    newest = np.searchsorted(time_s, time_s - 0.3, side="right") - 1
    rows = time_s - time_s[0] >= 3.3
    error = force_n[newest[rows]] - force_n[rows]
    assert evaluated.scores["zoh"].size.rms_n == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-9)
    for score in evaluated.scores.values():
        assert score.diverged_at_s is None
        assert np.isfinite(score.size.rms_n or np.nan)
