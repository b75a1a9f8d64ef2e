"""The stage driver against the emulated drive, in stepped time."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import pytest
from pydantic import ValidationError

from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.hardware.link import LinkState
from forefeel.devices.canopen import cia301
from forefeel.devices.cia402 import protocol as cia402
from forefeel.devices.cia402.driver import Cia402Stage
from forefeel.devices.cia402.emulator import SERIAL
from forefeel.devices.cia402.homing import Cia402Homing
from forefeel.devices.cia402.protocol import DriveState
from tests.devices.can_rig import COUNTS_PER_M, DRIVE, START_M, Rig, new_channel, rigged, stage_settings
from tests.devices.test_zaber_stage import calibration


def test_handshake_writes_what_safety_depends_on() -> None:
    with rigged("stage") as rig:
        value = rig.drive.value
        assert rig.stage.link.state is LinkState.READY
        assert f"serial {SERIAL:08X}" in rig.stage.link.identity
        assert value(cia402.ABORT_OPTION) == cia402.ABORT_QUICK_STOP
        assert value(cia402.QUICK_STOP_OPTION) == cia402.STAY_IN_QUICK_STOP
        assert value(cia301.HEARTBEAT_CONSUMER) == 127 << 16 | 150
        assert (value(cia402.SOFT_LIMIT_LOW), value(cia402.SOFT_LIMIT_HIGH)) == (-2000, 120_000)
        assert (value(cia402.PERIOD_VALUE), value(cia402.PERIOD_EXPONENT)) == (20, -3)
        assert rig.drive.model.state is DriveState.ENABLED
        assert cia402.FAULT_RESET not in rig.words
        assert rig.drive.model.position_m == pytest.approx(START_M, abs=2e-6)


def test_stage_follows_within_travel_and_velocity_and_stops_at_the_end() -> None:
    with rigged("stage", stage={"max_velocity_m_s": 0.1}) as rig:
        assert rig.stage.command(0.2, 0.0, rig.time.now_ns()) == 0.12
        rig.go(0.03, 0.15)
        assert 0.02 < rig.drive.model.position_m <= START_M + 0.1 * 0.16
        assert rig.stage.read(rig.time.now_ns()).position_m == pytest.approx(
            rig.drive.model.position_m, abs=4e-3
        )
        rig.stage.hold(rig.time.now_ns())
        rig.time.run(0.2)
        assert abs(rig.drive.model.velocity_m_s) < 1e-5
        rig.stage.close()
        rig.time.run(0.1)
        assert rig.drive.model.state is DriveState.QUICK_STOP


@pytest.mark.parametrize(
    ("fault", "repair", "says"),
    [
        ("drive_fault", "free", "emergency 2310|'fault"),
        ("stuck", "free", "following error|emergency 8611"),
        ("unplug", "plug", "no TPDO"),
    ],
)
def test_nothing_moves_after_a_fault_until_rearmed(fault: str, repair: str, says: str) -> None:
    with rigged("stage") as rig:
        rig.go(0.02, 0.1)
        rig.drive.provoke(fault)
        with pytest.raises(DeviceError, match=says):
            rig.go(0.12, 2.0)
        rig.time.run(0.3)
        assert rig.drive.model.velocity_m_s == 0.0
        rig.drive.provoke(repair)
        rig.until(rig.stage, LinkState.CONFIGURED)
        counters = rig.stage.link.counters
        assert counters["faults"] >= 1 and (fault != "drive_fault" or counters["emergencies"] >= 1)
        there_m, words = rig.drive.model.position_m, len(rig.words)
        refused: list[Callable[[], object]] = [
            lambda: rig.stage.command(0.1, 0.0, 0), lambda: rig.stage.read(0), lambda: rig.stage.hold(0)
        ]  # fmt: skip
        for call in refused:
            with pytest.raises(DeviceError, match=says):
                call()
        rig.time.run(0.2)
        assert set(rig.words[words:]) == {cia402.QUICK_STOP} and rig.drive.model.position_m == there_m
        rig.stage.rearm()
        rig.time.run_until(lambda: rig.drive.model.state is DriveState.ENABLED)
        assert (cia402.FAULT_RESET in rig.words) is (fault != "unplug")
        rig.time.run(0.1)
        assert rig.drive.model.position_m == pytest.approx(there_m, abs=1e-5)
        rig.go(there_m + 0.002, 0.3)
        assert rig.drive.model.position_m == pytest.approx(there_m + 0.002, abs=5e-4)


def test_cut_bus_stops_the_drive_by_itself() -> None:
    with rigged("stage") as rig:
        rig.go(0.03, 0.1)
        rig.drive.provoke("unplug")
        assert "no TPDO" in rig.fault_of(rig.stage)
        with pytest.raises(DeviceError, match=r"link is closed|no TPDO"):
            rig.stage.rearm()
        rig.time.run_until(lambda: rig.drive.model.state is DriveState.QUICK_STOP)


def test_unplugged_adapter_fails_both_drivers_of_a_bus_and_serves_both_again() -> None:
    with rigged("stage", "cell") as rig:
        (network,) = rig.time.networks
        vars(network._bus)["gone"] = True
        assert "gone" in rig.fault_of(rig.stage) and "gone" in rig.fault_of(rig.cell)
        for driver in (rig.stage, rig.cell):
            rig.until(driver, LinkState.CONFIGURED)
            driver.rearm()
        rig.time.run_until(lambda: rig.drive.model.state is DriveState.ENABLED)
        assert rig.readings(0.5)
        assert rig.drive.model.position_m == pytest.approx(START_M, abs=1e-5)


def test_drive_that_stays_faulty_is_a_new_fault() -> None:
    with rigged("stage") as rig:
        rig.drive.provoke("drive_fault")
        rig.fault_of(rig.stage)
        rig.until(rig.stage, LinkState.CONFIGURED)
        rig.drive.model.fail(0x5400, broken=True)
        rig.stage.rearm()
        assert "stays in 'fault'" in rig.fault_of(rig.stage)


def test_drive_in_a_fault_is_refused_at_the_start() -> None:
    with rigged() as rig:
        rig.drive.model.fail(0x2310)
        with pytest.raises(DeviceError, match="drive in 'fault' while enabling"):
            rig.stage.open()
        assert cia402.FAULT_RESET not in rig.words


def without(rig: Rig, index: int) -> None:
    """Both devices have no such object."""
    for device in (rig.drive, rig.transducer):
        device._node.object_dictionary.indices.pop(index, None)


@pytest.mark.parametrize(
    ("changed", "missing", "says"),
    [
        ({"node_id": 9}, 0, "node 9 on virtual .*: no answer; expected a CiA 402 device"),
        ({"node_id": 6}, 0, "a CiA 404 device, expected CiA 402"),
        ({"travel_m": (0.05, 0.1)}, 0, "it is at 0.01 m, expected within travel_m"),
        ({"counts_per_m": 1e12, "travel_m": (0.0, 0.1)}, 0, "does not fit"),
        ({}, cia402.ABORT_OPTION.index, "writing 6007:00 is refused .*check node_id and driver"),
    ],
)
def test_drive_not_of_the_settings_is_refused(changed: dict[str, Any], missing: int, says: str) -> None:
    with rigged(stage=changed) as rig:
        without(rig, missing)
        with pytest.raises(DeviceSetupError, match=says) as caught:
            rig.stage.open()
        assert "\n" not in str(caught.value)
        assert rig.drive.model.position_m == START_M and cia402.ENABLE not in rig.words


def test_homing_that_does_not_fit_into_its_object_is_refused() -> None:
    changed = {"counts_per_m": 1e9, "homing": {"acceleration_m_s2": 10.0}}
    refused = pytest.raises(DeviceSetupError, match="609A:00 = 10000000000: does not fit")
    with rigged(stage=changed) as rig, refused:
        Cia402Homing(rig.stage._settings, rig.time).__enter__()


def test_answers_that_are_cut_short_are_none() -> None:
    with rigged() as rig:
        send = rig.drive._bus.send

        def cut(msg: can.Message, timeout: float | None = None) -> None:
            msg.data = msg.data[:2]
            msg.dlc = len(msg.data)
            send(msg, timeout)

        rig.drive._bus.send = cut  # type: ignore[method-assign]
        with pytest.raises(DeviceSetupError, match="no answer; expected a CiA 402 device"):
            Cia402Homing(rig.stage._settings, rig.time).__enter__()


def test_calibration_must_be_of_this_drive(tmp_path: Path) -> None:
    of = {"driver": "cia402", "native_per_m": COUNTS_PER_M, "zero": 5000.0, "travel_m": [-0.002, 0.12]}
    with rigged(stage={"calibration": calibration(tmp_path, **of, serial="00000001")}) as rig:
        with pytest.raises(DeviceSetupError, match="serial = '00000001'"):
            rig.stage.open()
        calibration(tmp_path, **of, serial=f"{SERIAL:08X}")
        rig.stage.open()
        assert rig.stage.read(rig.time.now_ns()).position_m == pytest.approx(START_M - 0.005, abs=1e-5)


@pytest.mark.parametrize("changed", [{"node_id": 127}, {"sync_hz": 300}, {"heartbeat_s": 0.01}])
def test_settings_that_can_not_be_are_refused(changed: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        stage_settings(new_channel(), **changed)


def test_second_driver_of_a_node_is_refused() -> None:
    with rigged("stage") as rig:
        with pytest.raises(DeviceSetupError, match=f"node {DRIVE} .*one driver for each node"):
            Cia402Stage(rig.stage._settings, rig.time).open()
        assert rig.stage.link.state is LinkState.READY


def test_drive_homes_onto_its_switch_and_runs_over_its_travel() -> None:
    homing = {"method": 17, "home_m": -0.0045, "search_velocity_m_s": 0.05, "acceleration_m_s2": 1.0}
    with rigged(stage={"homing": homing, "travel_m": (0.0, 0.02)}) as rig:
        with Cia402Homing(rig.stage._settings, rig.time) as found:
            assert found.home() == pytest.approx(4500, abs=100)
            low, high = found.travel_ends(0.02)
            assert high - low == pytest.approx(0.02 * COUNTS_PER_M, abs=100)
        rig.time.run(0.1)
        assert rig.drive.model.state is DriveState.QUICK_STOP
