"""What the slave publishes of its devices."""

from datetime import date

import pytest

from forefeel.common import topics
from forefeel.common.bus import Bus
from forefeel.common.hardware.calibration import LoadCellCalibration, StageCalibration
from forefeel.common.hardware.link import DeviceLink
from forefeel.common.messages import Calibration
from tests.unit.slave_rig import SESSION, SlaveRig

CELL = LoadCellCalibration(
    format="forefeel.load_cell_calibration/1", driver="bota_serial", serial="SN-7", date=date(2026, 3, 1),
    gain_n=1.02, zero=-0.25, residual_n=0.001, hysteresis_n=0.002, range_n=(0.0, 3.0),
    points=((0.0, 0.0), (1.0, 1.02)),
)  # fmt: skip
STAGE = StageCalibration(
    format="forefeel.stage_calibration/1", driver="zaber_ascii", serial="4711", date=date(2026, 3, 2),
    zero=5000.0, native_per_m=1e7, travel_m=(0.0, 0.12), repeatability_m=None,
)  # fmt: skip


@pytest.fixture
def rig() -> SlaveRig:
    return SlaveRig().connected()


def announced(rig: SlaveRig) -> list[Calibration]:
    heard = list[Calibration]()
    bus = Bus(rig.network.session(rig.clock), "cell", "insertion", rig.clock)
    bus.subscribe(topics.CALIBRATION, lambda message, _: heard.append(message))
    rig.axis.announce(rig.now_ns)
    return heard


def test_what_the_drivers_have_loaded_is_said_every_time(rig: SlaveRig) -> None:
    rig.load_cell.calibration, rig.stage.calibration = CELL, STAGE  # type: ignore[attr-defined]
    for _ in range(2):
        stage, cell = announced(rig)
        assert (stage.slot, stage.driver, stage.serial, stage.date) == (
            "stage", "zaber_ascii", "4711", "2026-03-02",
        )  # fmt: skip
        assert (stage.native_per_m, stage.zero, stage.repeatability_m) == (1e7, 5000.0, None)
        assert (stage.gain_n, stage.residual_n, stage.hysteresis_n) == (None, None, None)
        assert (cell.slot, cell.driver, cell.serial, cell.date) == (
            "load_cell", "bota_serial", "SN-7", "2026-03-01",
        )  # fmt: skip
        assert (cell.gain_n, cell.zero, cell.residual_n, cell.hysteresis_n) == (1.02, -0.25, 0.001, 0.002)
        assert (cell.native_per_m, cell.repeatability_m) == (None, None)
        assert {stage.session_id, cell.session_id} == {SESSION}


def test_what_the_drivers_counted_stands_among_the_counters_of_the_slave(rig: SlaveRig) -> None:
    assert not [name for name in rig.counters() if name.startswith(("stage_", "load_cell_"))]
    rig.stage.link, rig.load_cell.link = DeviceLink("stage"), DeviceLink("cell")  # type: ignore[attr-defined]
    rig.stage.link.counters["lost_replies"] = 3  # type: ignore[attr-defined]
    rig.load_cell.link.counters.update(bad_checksum=2, stuck=0)  # type: ignore[attr-defined]
    counted = {n: c for n, c in rig.counters().items() if n.startswith(("stage_", "load_cell_"))}
    assert counted == {"stage_lost_replies": 3, "load_cell_bad_checksum": 2}
