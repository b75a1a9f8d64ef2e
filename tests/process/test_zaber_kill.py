"""The device has no watchdog: what becomes of the stage when its host is killed."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from forefeel.devices.zaber.emulator import ZaberDevice
from tests.devices.pty_thread import PtyThread
from tests.devices.zaber_rig import MODEL, settings
from tests.waiting import wait_until
from tests.witness import Witness, as_other_work

pytestmark = pytest.mark.usefixtures("ahead_of_other_work")
LEAD_S, FASTEST_M_S, HARDEST_M_S2 = 0.06, 0.1, 2.0
_HOST = """
import sys, time
from forefeel.devices.zaber.settings import ZaberSettings
from forefeel.devices.zaber.driver import ZaberStage
from forefeel.common.runtime.realtime import prepare_thread
prepare_thread(30)  # as a daemon
stage = ZaberStage(ZaberSettings.model_validate_json(sys.argv[1]))
stage.open()
start_ns = time.monotonic_ns()
while True:
    now_ns = time.monotonic_ns()
    stage.command(0.01 + 0.05 * (now_ns - start_ns) * 1e-9, 0.05, now_ns)
    time.sleep(0.001)
"""


def test_a_killed_host_leaves_the_stage_at_rest_within_the_lead_and_it_stays(
    tmp_path: Path, witness: Witness
) -> None:
    device = ZaberDevice(MODEL)
    path = list[tuple[float, float, float, float]]()
    device.moved = lambda *step: path.append(step)
    chosen = {
        "lead_s": LEAD_S, "max_velocity_m_s": FASTEST_M_S, "max_acceleration_m_s2": HARDEST_M_S2
    }  # fmt: skip
    with PtyThread(device, tmp_path) as port:
        wanted = settings(port=port.path, **chosen).model_dump_json()
        with as_other_work():
            host = subprocess.Popen([sys.executable, "-c", _HOST, wanted], cwd=Path(__file__).parents[2])
        try:
            wait_until(
                lambda: (path and path[-1][1] > 0.02 and path[-1][2] > 0.01) or host.poll() is not None,
                what="the stage's way",
            )
            assert host.poll() is None
        finally:
            killed = len(path) - 1
            host.send_signal(signal.SIGKILL)
            host.wait()
        wait_until(lambda: path[-1][0] - path[killed][0] > 2.0)
    after = path[killed:]
    assert {v for t, _, v, _ in after if t - after[0][0] > 1.5} == {0.0}
    with witness.timely(0.03):
        assert abs(path[killed][2]) > 0.01, "it moved when the host was killed"
        _at_rest_in_time(after)


def _at_rest_in_time(after: list[tuple[float, float, float, float]]) -> None:
    """A full reach is covered in lead + v / A; 30 ms for bytes that were under way."""
    start_s, start_m, _, _ = after[0]
    moving = [t for t, _, v, _ in after if v != 0.0]
    assert moving[-1] - start_s <= LEAD_S + FASTEST_M_S / HARDEST_M_S2 + 0.03
    assert 0.0 < after[-1][1] - start_m <= FASTEST_M_S * (LEAD_S + 0.03)
