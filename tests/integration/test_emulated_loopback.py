"""The whole service over real byte protocols: emulated devices in processes of their own."""

import json
from pathlib import Path

import numpy as np
import pytest

from common.recording.mcap_reader import read_run
from common.topics import FORCE
from forefeel.loopback.command import run_loopback
from forefeel.loopback.plan import Wish


@pytest.mark.parametrize(
    ("hardware", "device_hz"),
    [("emulated-serial", 800.0), pytest.param("emulated-can", 250.0, marks=pytest.mark.soak)],
)
def test_the_service_arms_and_answers_once_for_each_reading(
    tmp_path: Path, hardware: str, device_hz: float
) -> None:
    report = run_loopback(Wish(seed=1, duration_s=4.0, hardware=hardware), tmp_path / "out", False, False)
    assert report.armed_share is not None and report.armed_share > 0.9
    run = read_run(tmp_path / "out" / "recording.mcap")
    forces = [message for message in run.messages(FORCE) if message.valid]
    stamps = np.array([message.stamp_ns for message in forces])
    assert np.all(np.diff(stamps) > 0)
    assert 1e9 / np.median(np.diff(stamps)) == pytest.approx(device_hz, rel=0.05)
    assert np.ptp([message.position_m for message in forces]) > 0.005
    assert np.ptp([message.force_n for message in forces]) > 0.05
    assert (
        json.loads((tmp_path / "out" / "report.json").read_text())["metadata"]["run"]["hardware"] == hardware
    )
