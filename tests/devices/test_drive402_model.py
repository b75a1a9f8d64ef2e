"""The emulated drive without a bus, in virtual time."""

import pytest

from forefeel.devices.cia402 import protocol as cia402
from forefeel.devices.cia402.emulator import FOLLOWING, HEARTBEAT_LOST, DriveModel
from forefeel.devices.cia402.protocol import DriveState
from tests.devices.can_rig import COUNTS_PER_M, START_M, mechanics

SYNC_S = 0.004


def enabled(**changed: int) -> DriveModel:
    model = DriveModel(mechanics(), COUNTS_PER_M, rate_hz=1000)
    model.mode = cia402.CSP
    for name, value in changed.items():
        setattr(model, name, value)
    model.target(model.position)
    for word in (cia402.SHUTDOWN, cia402.SWITCH_ON, cia402.ENABLE):
        model.control(word)
    assert model.state is DriveState.ENABLED
    return model


def drive(model: DriveModel, from_s: float, seconds: float, velocity_m_s: float) -> float:
    """Streams a ramp; when it ended."""
    for i in range(round(seconds / SYNC_S)):
        t_s = from_s + i * SYNC_S
        model.advance(t_s)
        model.target(round((START_M + velocity_m_s * (t_s + SYNC_S)) * COUNTS_PER_M))
        model.sync(t_s)
    return from_s + seconds


@pytest.mark.parametrize("state", [DriveState.FAULT, DriveState.FAULT_REACTION])
def test_only_a_rising_edge_ends_a_fault(state: DriveState) -> None:
    for word in range(256):
        model = enabled()
        model.state = state
        model.control(word & ~cia402.FAULT_RESET)
        assert model.state is state
        model.control(word)
        left = state is DriveState.FAULT and word & cia402.FAULT_RESET
        assert model.state is (DriveState.DISABLED if left else state)
        model.control(word)
        assert model.state is not DriveState.ENABLED


def test_it_follows_a_ramp_closely() -> None:
    model = enabled()
    end_s = drive(model, 0.0, 0.5, 0.1)
    model.advance(end_s)
    assert model.position_m == pytest.approx(START_M + 0.05, abs=0.1 * 2 * SYNC_S)
    assert model.velocity_m_s == pytest.approx(0.1, rel=0.02)


def test_a_target_far_away_is_jumped_at_by_the_drive() -> None:
    model = DriveModel(mechanics(), COUNTS_PER_M)
    model.mode = cia402.CSP
    model.target(60_000)
    for word in (cia402.SHUTDOWN, cia402.SWITCH_ON, cia402.ENABLE):
        model.control(word)
    model.advance(0.05)
    assert model.velocity_m_s > 0.3, "the emulated drive must punish a host that does not start at actual"


@pytest.mark.parametrize(
    ("option", "after"),
    [(0, DriveState.ENABLED), (1, DriveState.FAULT), (2, DriveState.DISABLED), (3, DriveState.QUICK_STOP)],
)
def test_what_the_abort_option_says(option: int, after: DriveState) -> None:
    model = enabled(abort_option=option, quick_stop_option=cia402.STAY_IN_QUICK_STOP)
    t_s = drive(model, 0.0, 0.2, 0.2)
    model.lose_host()
    model.advance(t_s + 0.1)
    assert model.state is after
    assert abs(model.velocity_m_s) < 1e-3
    assert model.alarms == ([HEARTBEAT_LOST] if option == 1 else [])


def test_quick_stop_takes_no_longer_than_its_deceleration() -> None:
    model = enabled(quick_stop_option=cia402.STAY_IN_QUICK_STOP)
    t_s = drive(model, 0.0, 0.2, 0.2)
    model.advance(t_s)
    at_m = model.position_m
    model.control(cia402.QUICK_STOP)
    model.advance(t_s + 0.2 / 20.0 + 0.002)
    assert model.velocity_m_s == 0.0
    assert model.position_m - at_m <= 0.2**2 / (2 * 20.0) + 0.2 * 0.002


def test_stuck_is_a_following_error() -> None:
    model = enabled(window=2000)
    model.timeout_s = 0.02
    model.stuck = True
    drive(model, 0.0, 0.2, 0.1)
    assert model.state is DriveState.FAULT
    assert model.alarms == [FOLLOWING]
    assert model.position_m == START_M


def test_soft_limits() -> None:
    model = enabled()
    model.soft_limits = 0, 12_000
    end_s = drive(model, 0.0, 0.3, 0.1)
    model.advance(end_s)
    assert model.position_m == pytest.approx(0.012, abs=1e-4)
    assert model.statusword & cia402.LIMIT_ACTIVE


def test_every_step_is_told() -> None:
    told: list[tuple[float, float, float, float]] = []
    model = DriveModel(
        mechanics(), COUNTS_PER_M, rate_hz=1000, moved=lambda t, x, v, a: told.append((t, x, v, a))
    )
    model.advance(0.0505)
    assert len(told) == 50
    assert told[-1] == pytest.approx((0.05, START_M, 0.0, 0.0))
