"""The host's state machine of a drive, over every statusword that there is."""

import pytest

from forefeel.common.errors import DeviceError
from forefeel.devices.cia402 import protocol as cia402
from forefeel.devices.cia402.protocol import (
    DriveMachine,
    DriveState,
    Phase,
    drive_state,
    interpolation_period,
)

STATUSWORD = {state: bits for state, (_, bits) in cia402.PATTERNS.items()}
EVERY_WORD = range(1 << 16)
EVERY_LOW_BYTE = [high << 8 | low for high in (0x00, 0x92, 0xFF) for low in range(256)]


def machine_in(phase: Phase) -> DriveMachine:
    machine = DriveMachine(patience=10)
    machine.step(STATUSWORD[DriveState.DISABLED])
    if phase is Phase.RESETTING:
        machine.rearm()
    elif phase is not Phase.PASSIVE:
        machine.enable()
    if phase is Phase.FOLLOWING:
        machine.step(STATUSWORD[DriveState.ENABLED])
    assert machine.phase is phase
    return machine


def step(machine: DriveMachine, statusword: int) -> int | None:
    """None: a fault."""
    try:
        return machine.step(statusword)
    except DeviceError:
        return None


def test_states_are_told_apart() -> None:
    seen = {drive_state(word) for word in EVERY_WORD}
    assert seen == {*DriveState, None}
    for word in EVERY_WORD:
        assert drive_state(word) is drive_state(word & 0x6F)  # so the low byte stands for all words below
    for word in range(256):
        fitting = [s for s, (mask, bits) in cia402.PATTERNS.items() if word & mask == bits]
        assert len(fitting) <= 1
        assert drive_state(word) is (fitting[0] if fitting else None)


@pytest.mark.parametrize("phase", Phase)
def test_only_rearming_resets_a_fault_and_only_one(phase: Phase) -> None:
    for word in EVERY_LOW_BYTE:
        machine = machine_in(phase)
        words = [step(machine, word) for _ in range(8)]
        resets = [w for w in words if w is not None and w & cia402.FAULT_RESET]
        if phase is Phase.RESETTING and drive_state(word) is DriveState.FAULT:
            assert resets == [cia402.FAULT_RESET] * len(resets)
            assert len(resets) >= 1
        else:
            assert not resets, f"{word:04X}"


def test_a_reset_is_a_rising_edge() -> None:
    machine = DriveMachine(patience=10)
    machine.rearm()
    fault = STATUSWORD[DriveState.FAULT]
    words = [machine.step(fault) for _ in range(4)]
    assert words == [cia402.QUICK_STOP, cia402.FAULT_RESET, cia402.QUICK_STOP, cia402.FAULT_RESET]


def test_passive_is_quick_stop_whatever_the_drive_says() -> None:
    machine = DriveMachine(patience=10)
    assert {machine.step(word) for word in EVERY_LOW_BYTE} == {cia402.QUICK_STOP}
    assert machine.phase is Phase.PASSIVE


def test_following_ends_for_good_at_anything_else() -> None:
    for word in EVERY_LOW_BYTE:
        machine = machine_in(Phase.FOLLOWING)
        if drive_state(word) is DriveState.ENABLED:
            assert step(machine, word) == cia402.ENABLE
            continue
        assert step(machine, word) is None
        assert machine.phase is Phase.PASSIVE
        assert machine.step(STATUSWORD[DriveState.ENABLED]) == cia402.QUICK_STOP


def test_enabling_goes_by_every_state() -> None:
    machine = machine_in(Phase.ENABLING)
    said = [machine.step(STATUSWORD[s]) for s in (DriveState.DISABLED, DriveState.READY)]
    said += [machine.step(STATUSWORD[s]) for s in (DriveState.SWITCHED_ON, DriveState.ENABLED)]
    assert said == [cia402.SHUTDOWN, cia402.SWITCH_ON, cia402.ENABLE, cia402.ENABLE]
    assert machine.phase is Phase.FOLLOWING


@pytest.mark.parametrize("state", [DriveState.FAULT, DriveState.FAULT_REACTION])
def test_enabling_refuses_a_fault(state: DriveState) -> None:
    machine = machine_in(Phase.ENABLING)
    with pytest.raises(DeviceError, match=state.value):
        machine.step(STATUSWORD[state])
    assert machine.phase is Phase.PASSIVE


def test_patience_ends() -> None:
    machine = DriveMachine(patience=3)
    machine.enable()
    for _ in range(3):
        assert machine.step(STATUSWORD[DriveState.NOT_READY]) == cia402.DISABLE_VOLTAGE
    with pytest.raises(DeviceError, match="stays in 'not ready to switch on'"):
        machine.step(STATUSWORD[DriveState.NOT_READY])
    assert machine.phase is Phase.PASSIVE


@pytest.mark.parametrize(
    ("rate_hz", "expected"), [(250, (4, -3)), (500, (2, -3)), (1000, (1, -3)), (400, (25, -4)), (300, None)]
)
def test_interpolation_period(rate_hz: int, expected: tuple[int, int] | None) -> None:
    assert interpolation_period(rate_hz) == expected
