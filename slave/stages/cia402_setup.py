"""The handshake of a CiA 402 drive: who it is, and everything that its safety depends on written by us."""

from collections.abc import Callable
from datetime import date

from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.hardware import cia402
from forefeel.common.hardware.calibration import StageCalibration, stage_calibration
from forefeel.common.hardware.can_network import HOST_NODE
from forefeel.common.hardware.cia301 import (
    HEARTBEAT_CONSUMER,
    HEARTBEAT_PRODUCER_MS,
    RPDO1,
    START,
    SYNC_PERIOD_US,
    TPDO1,
    Pdo,
    heartbeat_consumer,
    pdo_off,
)
from forefeel.common.hardware.cia402 import DriveState, drive_state
from forefeel.common.hardware.sdo import RemoteDevice
from forefeel.slave.stages.scale import PositionScale
from forefeel.slave.stages.settings import Cia402Settings

_FOLLOWING_PERIODS = 5
_SWITCH_OFF = [(transmit, number) for transmit in (False, True) for number in (2, 3, 4)]


def command_pdo(node: int) -> Pdo:
    """Controlword and target, applied at every SYNC."""
    return Pdo(False, 1, RPDO1 + node, 1, (cia402.CONTROLWORD, cia402.TARGET_POSITION))


def state_pdo(node: int) -> Pdo:
    """Statusword and position, at every SYNC."""
    return Pdo(True, 1, TPDO1 + node, 1, (cia402.STATUSWORD, cia402.POSITION_ACTUAL))


def calibration_of(settings: Cia402Settings, serial: str) -> StageCalibration | None:
    """The calibration that the settings name.

    Raises:
        ConfigurationError: it is of another device, or out of date.
    """
    path = settings.calibration
    if path is None:
        return None
    return stage_calibration(
        path, settings.driver, serial, date.today(), settings.travel_m, settings.native_per_m
    )


def scale_of(settings: Cia402Settings, calibration: StageCalibration | None) -> PositionScale:
    """Of the calibration if there is one, else of the settings."""
    if calibration is None:
        return PositionScale(0.0, settings.sign * settings.counts_per_m)
    return PositionScale(calibration.zero, settings.sign * calibration.native_per_m)


def checked(settings: Cia402Settings) -> None:
    """Refuses what the settings alone show to be impossible, with DeviceSetupError."""
    where = f"cia402 node {settings.node_id}"
    if settings.node_id == HOST_NODE:
        raise DeviceSetupError(f"{where}: expected 1 to {HOST_NODE - 1}; {HOST_NODE} is our own heartbeat")
    if cia402.interpolation_period(settings.sync_hz) is None:
        raise DeviceSetupError(
            f"{where}: sync_hz = {settings.sync_hz}: expected a period in tenths of a millisecond"
        )
    if settings.heartbeat_s < 1.0 / settings.sync_hz:
        raise DeviceSetupError(
            f"{where}: heartbeat_s = {settings.heartbeat_s:g}: expected at least 1 / sync_hz = "
            f"{1.0 / settings.sync_hz:g}"
        )


def configure(
    device: RemoteDevice, settings: Cia402Settings, scale: PositionScale, pause: Callable[[float], None]
) -> float:
    """Writes and reads back the whole configuration, in PRE-OPERATIONAL, and starts it; where the drive is.

    Raises:
        DeviceError: no answer, or an object that is needed is refused.
        DeviceSetupError: it is no drive for us.
    """
    if not int(device.read(cia402.SUPPORTED_MODES)) & cia402.CSP_SUPPORTED:
        raise DeviceSetupError(
            f"{device.name}: no cyclic synchronous position (6502); expected a drive with it"
        )
    _exchanged(device, settings)
    _timing(device, settings)
    _protection(device, settings, scale)
    _mode(device, cia402.CSP, pause)
    actual_m = scale.metres(device.read(cia402.POSITION_ACTUAL))
    _within_travel(device, settings, actual_m)
    device.order(START)
    return actual_m


def require_homing(device: RemoteDevice, settings: Cia402Settings) -> None:
    """Asks and tells the drive how it is to be homed; nothing moves.

    Raises:
        DeviceSetupError: it can not be homed, or not so, or is in a fault.
    """
    homing, per_m = settings.homing, settings.counts_per_m
    if not int(device.read(cia402.SUPPORTED_MODES)) & cia402.HOMING_SUPPORTED:
        raise DeviceSetupError(f"{device.name}: no homing (6502); home it with its maker's tool")
    if drive_state(int(device.read(cia402.STATUSWORD))) is DriveState.FAULT:
        raise DeviceSetupError(
            f"{device.name}: the drive is in a fault; expected none: clear it at the drive"
        )
    wanted = (
        (cia402.HOMING_METHOD, homing.method, "method"),
        (cia402.HOMING_SEARCH_SPEED, round(homing.search_velocity_m_s * per_m), "search_velocity_m_s"),
        (cia402.HOMING_ZERO_SPEED, round(homing.zero_velocity_m_s * per_m), "zero_velocity_m_s"),
        (cia402.HOMING_ACCELERATION, round(homing.acceleration_m_s2 * per_m), "acceleration_m_s2"),
    )
    for entry, value, name in wanted:
        if not device.offer(entry, value) or device.read(entry) != value:
            raise DeviceSetupError(
                f"{device.name}: stage.homing.{name} = {getattr(homing, name):g} is refused ({entry}); "
                "expected what the drive can do"
            )


def configure_homing(device: RemoteDevice, settings: Cia402Settings, pause: Callable[[float], None]) -> None:
    """As `configure`, for the mode of homing. The software limits stay: they belong to the count before.

    Raises:
        DeviceError, DeviceSetupError: as `configure`.
    """
    _exchanged(device, settings)
    _timing(device, settings)
    _watched(device, settings, settings.counts_per_m)
    _mode(device, cia402.HOMING, pause)
    device.order(START)


def _exchanged(device: RemoteDevice, settings: Cia402Settings) -> None:
    for transmit, number in _SWITCH_OFF:
        device.offer(*pdo_off(transmit, number, settings.node_id))
    device.write_all(command_pdo(settings.node_id).parameters())
    device.write_all(state_pdo(settings.node_id).parameters())


def _timing(device: RemoteDevice, settings: Cia402Settings) -> None:
    period = cia402.interpolation_period(settings.sync_hz)
    assert period is not None, "checked() refuses it"
    device.write(cia402.PERIOD_EXPONENT, period[1])
    device.write(cia402.PERIOD_VALUE, period[0])
    device.offer(SYNC_PERIOD_US, round(1e6 / settings.sync_hz))
    device.write(HEARTBEAT_PRODUCER_MS, round(settings.heartbeat_s * 1e3))
    device.write(HEARTBEAT_CONSUMER, heartbeat_consumer(HOST_NODE, 3.0 * settings.heartbeat_s))


def _protection(device: RemoteDevice, settings: Cia402Settings, scale: PositionScale) -> None:
    low, high = scale.ends(settings.travel_m)
    device.write(cia402.SOFT_LIMIT_LOW, low)
    device.write(cia402.SOFT_LIMIT_HIGH, high)
    _watched(device, settings, abs(scale.per_m))


def _watched(device: RemoteDevice, settings: Cia402Settings, per_m: float) -> None:
    """What the drive does by itself: a lost host and a following error stop it."""
    device.write(cia402.ABORT_OPTION, cia402.ABORT_QUICK_STOP)
    device.write(cia402.QUICK_STOP_OPTION, cia402.STAY_IN_QUICK_STOP)
    device.write(cia402.FOLLOWING_WINDOW, round(settings.following_error_m * per_m))
    device.write(cia402.FOLLOWING_TIMEOUT_MS, round(1e3 * _FOLLOWING_PERIODS / settings.sync_hz))


def _mode(device: RemoteDevice, mode: int, pause: Callable[[float], None]) -> None:
    device.write(cia402.MODE, mode)
    for _ in range(30):
        shown = int(device.read(cia402.MODE_DISPLAY))
        if shown == mode:
            return
        pause(0.01)
    raise DeviceError(f"{device.name}: mode {shown} is displayed, expected {mode}")


def _within_travel(device: RemoteDevice, settings: Cia402Settings, actual_m: float) -> None:
    (low, high), slack_m = settings.travel_m, settings.following_error_m
    if not low - slack_m <= actual_m <= high + slack_m:
        raise DeviceSetupError(
            f"{device.name}: it is at {actual_m:.4g} m, expected within travel_m = [{low:g}, {high:g}]; "
            "home it, or `forefeel calibrate stage`"
        )
