"""Homing of a CiA 402 drive, its host and the emulated drive, both pure, in virtual time."""

from collections.abc import Callable

import pytest

from forefeel.common.errors import DeviceError
from forefeel.devices.cia402 import protocol as cia402
from forefeel.devices.cia402.driver import DriveCycle, Readback
from forefeel.devices.cia402.emulator import DriveModel, HomingPhase
from forefeel.devices.cia402.homing import HomingCycle
from forefeel.devices.cia402.protocol import PATTERNS, DriveState, Phase
from forefeel.devices.shared.stage import Setpoint
from tests.devices.can_rig import COUNTS_PER_M, START_M, mechanics

SYNC_S = 0.004
ENABLED = PATTERNS[DriveState.ENABLED][1]
ATTAINED, REACHED = cia402.HOMING_ATTAINED, cia402.TARGET_REACHED


def hosted(method: int, patience: int = 5000) -> HomingCycle:
    standing = Setpoint(SYNC_S, (-1.0, 1.0), 0.1, 1.0)
    return HomingCycle(DriveCycle(SYNC_S, 0.02, standing), method, patience)


def drive(method: int) -> DriveModel:
    model = DriveModel(mechanics(), COUNTS_PER_M, rate_hz=1000)
    model.objects |= {
        cia402.MODE: cia402.HOMING, cia402.HOME_OFFSET: -500, cia402.HOMING_METHOD: method,
        cia402.FOLLOWING_WINDOW: 2000, cia402.FOLLOWING_TIMEOUT_MS: 20, cia402.HOMING_SEARCH_SPEED: 50_000,
        cia402.HOMING_ZERO_SPEED: 1000, cia402.HOMING_ACCELERATION: 1_000_000,
    }  # fmt: skip
    model.homing.switches_m = 0.005, 0.02
    return model


def home(model: DriveModel, host: HomingCycle, each: Callable[[float], object] = lambda _: None) -> float:
    """Both together until it is done; when."""
    for i in range(5000):
        t_s = i * SYNC_S
        model.advance(t_s)
        each(t_s)
        word = host.step(Readback(i, model.statusword, 0.0, 0.0), True, None)
        if host.done:
            return t_s
        model.control(word)
    raise AssertionError("it never ends")


@pytest.mark.parametrize(("method", "edge_m"), [(17, 0.005), (18, 0.02), (35, START_M), (37, START_M)])
@pytest.mark.parametrize("start_m", [START_M, 0.003, 0.022])
def test_the_edge_is_the_reference_wherever_it_starts(method: int, edge_m: float, start_m: float) -> None:
    model = drive(method)
    model._servo.position_m = start_m
    home(model, hosted(method))
    at_m = start_m if method in cia402.HERE else edge_m
    assert model.position == pytest.approx(-500 + (model.position_m - at_m) * COUNTS_PER_M, abs=2)
    assert model.position_m == pytest.approx(at_m, abs=1e-4)
    assert model.velocity_m_s == pytest.approx(0.0, abs=1e-4)


def test_homed_again_it_has_to_move_again() -> None:
    model = drive(17)
    home(model, hosted(17))
    again, model._t_s = hosted(17), 0.0
    assert model.statusword & (ATTAINED | REACHED) == ATTAINED | REACHED
    with pytest.raises(DeviceError, match="too long"):  # a drive that ignores the start
        frozen = model.statusword
        for i in range(9000):
            again.step(Readback(i, frozen, 0.0, 0.0), True, None)
            assert not again.done


def test_a_switch_that_does_not_answer() -> None:
    model = drive(17)
    model.homing.switches_m = -1.0, 1.0
    with pytest.raises(DeviceError, match="reports an error of homing"):
        home(model, hosted(17))
    assert model.homing.phase is HomingPhase.FAILED
    assert abs(model.velocity_m_s) < 0.01


def test_something_in_the_way_is_a_following_error() -> None:
    model = drive(17)

    def block(t_s: float) -> None:
        model.stuck = t_s > 0.1

    with pytest.raises(DeviceError, match="drive in 'fault"):
        home(model, hosted(17), block)


def test_who_takes_the_start_away_interrupts_it() -> None:
    model = drive(17)

    def disturb(t_s: float) -> None:
        if t_s > 0.1:
            model.control(cia402.ENABLE)

    with pytest.raises(DeviceError, match="homing was interrupted"):
        home(model, hosted(17), disturb)


def test_it_is_not_started_before_the_drive_is_enabled_and_never_without_it() -> None:
    host = hosted(37)
    for state in (DriveState.DISABLED, DriveState.READY, DriveState.SWITCHED_ON):
        for i in range(5):
            word = host.step(Readback(i, PATTERNS[state][1], 0.0, 0.0), True, None)
            assert not word & cia402.HOMING_START
    assert host._cycle.machine.phase is Phase.ENABLING
    host.step(Readback(9, ENABLED | REACHED, 0.0, 0.0), True, None)
    assert host.step(Readback(10, ENABLED | REACHED, 0.0, 0.0), True, None) & cia402.HOMING_START
    with pytest.raises(DeviceError, match="drive in 'switch on disabled' while following"):
        host.step(Readback(11, PATTERNS[DriveState.DISABLED][1], 0.0, 0.0), True, None)
