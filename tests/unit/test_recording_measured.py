"""Recordings that others measured, as they are."""

import os
from pathlib import Path

import pytest

from forefeel.common.recording.tabular import load_recording

DATA = os.environ.get("FOREFEEL_DATA")


@pytest.mark.skipif(not DATA, reason="FOREFEEL_DATA names no folder with measured recordings")
@pytest.mark.parametrize(
    ("name", "samples", "segments", "rate_hz", "with_force"),
    [
        ("emps_train", 24841, 1, 1000, True),
        ("emps_test", 24841, 1, 1000, True),
        ("silverbox_train", 30000, 1, 610.35, True),
        ("silverbox_test_arrow", 40400, 1, 610.35, True),
        ("seal_o_ring_1bar", 7139, 2, 100, True),
        ("seal_o_ring_3bar", 7834, 3, 100, True),
        ("presliding_friction", 12000, 1, 200, True),
        ("human_motion", 3466, 12, 62.5, False),
    ],
)
def test_measured_recordings(
    name: str, samples: int, segments: int, rate_hz: float, with_force: bool
) -> None:
    recording = load_recording(Path(DATA or "") / f"{name}.csv")
    assert len(recording) == samples
    assert len(recording.segments()) == segments
    assert recording.rate_hz == pytest.approx(rate_hz, rel=1e-3)
    assert (recording.force_n is not None) == with_force
