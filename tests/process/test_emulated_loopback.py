"""The whole service over real byte protocols: emulated devices in processes of their own."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from forefeel.common.recording.mcap_reader import read_run
from forefeel.common.topics import FORCE, SAFETY_EVENT
from forefeel.loopback.hardware import on_bench
from forefeel.loopback.plan import AXIS, LoopbackOptions, make_plan
from forefeel.loopback.real import run_real
from forefeel.report.summary import summarise
from tests.witness import WATCHDOG_S, Witness, check_stops


@pytest.mark.soak
@pytest.mark.parametrize(("hardware", "device_hz"), [("emulated-serial", 800.0), ("emulated-can", 250.0)])
def test_the_service_arms_and_answers_once_for_each_reading(
    tmp_path: Path, hardware: str, device_hz: float, witness_of_daemons: Witness
) -> None:
    plan = make_plan(LoopbackOptions(seed=1, duration_s=4.0, hardware=hardware))
    with TemporaryDirectory(prefix="forefeel-") as ports:
        bench = on_bench(plan, hardware, Path(ports), tmp_path, 1)
        run_real(bench.plan, tmp_path, lambda _done_s, _what: None, bench.emulators)
    run = read_run(tmp_path / "recording.mcap")
    share = summarise(run).armed_share
    check_stops(list(run.messages(AXIS, SAFETY_EVENT)))
    forces = [message for message in run.messages(AXIS, FORCE) if message.valid]
    stamps = np.array([message.stamp_ns for message in forces])
    assert np.all(np.diff(stamps) > 0)
    with witness_of_daemons.timely(WATCHDOG_S):
        assert share is not None and share > 0.9
        assert 1e9 / np.median(np.diff(stamps)) == pytest.approx(device_hz, rel=0.05)
        assert np.ptp([message.position_m for message in forces]) > 0.005
        assert np.ptp([message.force_n for message in forces]) > 0.05
