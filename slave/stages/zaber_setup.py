"""The handshake with a Zaber stage: who it is, how it is set up, whether it knows where it is."""

from collections.abc import Callable
from datetime import date
from typing import NamedTuple

from forefeel.common.clock import Clock
from forefeel.common.errors import ConfigurationError, DeviceError, DeviceSetupError
from forefeel.common.hardware.calibration import StageCalibration, stage_calibration
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.common.hardware.settings import SerialSettings
from forefeel.common.hardware.streams import ByteStream
from forefeel.common.hardware.zaber import (
    ACCELERATION_DATA,
    DRIVER_OFF,
    SPEED_DATA,
    UNHOMED,
    in_words,
    is_fault,
)
from forefeel.slave.stages.scale import PositionScale
from forefeel.slave.stages.settings import ZaberSettings
from forefeel.slave.stages.zaber_talk import RejectedError, SilenceError, ZaberTalk

OpenStream = Callable[[SerialSettings], ByteStream]
_ROUNDING = 1.0  # microsteps


class ConfiguredStage(NamedTuple):
    """A stage that has been identified and set up. `limits`: of the device, in microsteps; `calibration`: as
    it was loaded.
    """

    talk: ZaberTalk
    serial: str
    scale: PositionScale
    limits: tuple[int, int]
    calibration: StageCalibration | None = None


def link_name(settings: ZaberSettings) -> str:
    """For texts."""
    return f"stage zaber_ascii on {settings.port}"


def connect(
    settings: ZaberSettings, clock: Clock, link: DeviceLink, stream: ByteStream, today: date
) -> ConfiguredStage:
    """From an open stream to a stage that has been identified and set up; nothing moves.

    Raises:
        DeviceSetupError: silent, another device, wrong baud rate, no checksums, a limit that it does not
            take, or a calibration of another stage.
    """
    talk = ZaberTalk(stream, clock, (settings.device, settings.axis), settings.baud, link)
    try:
        serial = link.serial = _identify(talk, settings, link)
        link.advance(LinkState.IDENTIFIED)
        calibration = _calibration(settings, serial, today)
        scale = _scale(settings, calibration)
        _limit(talk, settings, scale)
        low, high = (round(talk.number(f"get {name}")) for name in ("limit.min", "limit.max"))
    except DeviceSetupError:
        raise
    except DeviceError as error:
        raise DeviceSetupError(f"{error}; expected a stage that takes its settings") from error
    return ConfiguredStage(talk, serial, scale, (low, high), calibration)


def require_travel(device: ConfiguredStage, settings: ZaberSettings) -> None:
    """Raises DeviceSetupError unless the device's own limits let it go wherever it may be sent."""
    low, high = device.scale.ends(settings.travel_m)
    lowest, highest = device.limits
    if low < lowest - _ROUNDING or high > highest + _ROUNDING:
        ends_m = sorted(device.scale.metres(end) for end in device.limits)
        raise DeviceSetupError(
            f"{link_name(settings)}: stage.travel_m = [{settings.travel_m[0]:g}, {settings.travel_m[1]:g}]: "
            f"expected within [{ends_m[0]:g}, {ends_m[1]:g}], the limits in the stage"
        )


def require_homed(talk: ZaberTalk, link: DeviceLink) -> None:
    """Raises DeviceSetupError for a stage that does not know where it is: absolute targets mean nothing."""
    unhomed = sorted(UNHOMED & set(flags(talk)))
    if unhomed:
        raise DeviceSetupError(
            f"{link.name}: {in_words(unhomed[0])}; expected a homed stage: run `forefeel calibrate stage`"
        )


def clear_faults(talk: ZaberTalk, link: DeviceLink) -> None:
    """Acknowledges old faults; to be called on an explicit act only.

    Raises:
        DeviceSetupError: one that stays.
    """
    talk.ask("warnings clear")
    if DRIVER_OFF & set(flags(talk)):
        talk.ask("driver enable")
    left = [flag for flag in flags(talk) if is_fault(flag) and flag not in UNHOMED]
    if left:
        raise DeviceSetupError(f"{link.name}: {in_words(left[0])}; expected a stage without faults")


def flags(talk: ZaberTalk) -> list[str]:
    """The warning flags that are set, the gravest first."""
    return talk.ask("warnings").split()[1:]


def _identify(talk: ZaberTalk, settings: ZaberSettings, link: DeviceLink) -> str:
    """The serial number; read with checksums, as everything but the first answer is."""
    try:
        device_id = _device_id(talk)
    except SilenceError as error:
        raise DeviceSetupError(_why_silent(talk, settings)) from error
    _checksums_on(talk, settings)
    serial, version = talk.ask("get system.serial", axis=0), talk.ask("get version", axis=0)
    link.identity = f"Zaber device id {device_id}, serial {serial}, firmware {version}"
    return serial


def _device_id(talk: ZaberTalk) -> str:
    try:
        return talk.ask("get device.id", axis=0)
    except RejectedError:  # firmware 6 calls it otherwise
        return talk.ask("get deviceid", axis=0)


def _why_silent(talk: ZaberTalk, settings: ZaberSettings) -> str:
    expected = f"expected Zaber device {settings.device} in ASCII at {settings.baud} baud"
    if talk.others:
        found = f"answers come from device {min(talk.others)}"
    elif talk.parser.dropped.total():
        found = "bytes that are no Zaber ASCII: another device, or another baud rate"
    else:
        found = "silence: no power, another baud rate, or another device"
    return f"{link_name(settings)}: {found}; {expected}"


def _scale(settings: ZaberSettings, calibration: StageCalibration | None) -> PositionScale:
    if calibration is None:
        return PositionScale(0.0, settings.sign / settings.microstep_m)
    return PositionScale(calibration.zero, settings.sign * calibration.native_per_m)


def _calibration(settings: ZaberSettings, serial: str, today: date) -> StageCalibration | None:
    if settings.calibration is None:
        return None
    try:
        return stage_calibration(
            settings.calibration, settings.driver, serial, today, settings.travel_m, settings.native_per_m
        )
    except ConfigurationError as error:
        raise DeviceSetupError(str(error)) from error


def _limit(talk: ZaberTalk, settings: ZaberSettings, scale: PositionScale) -> None:
    """Speed and acceleration as the settings have them."""
    per_m = abs(scale.per_m)
    limits = {
        "maxspeed": (settings.max_velocity_m_s * per_m * SPEED_DATA, "max_velocity_m_s"),
        "accel": (settings.max_acceleration_m_s2 * per_m * ACCELERATION_DATA, "max_acceleration_m_s2"),
    }
    for name, (value, key) in limits.items():
        try:
            _ensure(talk, name, max(1, int(value)))
        except RejectedError as error:
            if error.reason != "BADDATA":
                raise
            raise DeviceSetupError(
                f"{link_name(settings)}: stage.{key} = {getattr(settings, key):g}: rejected "
                f"({error.reason}), expected what the stage can do"
            ) from error


def _checksums_on(talk: ZaberTalk, settings: ZaberSettings) -> None:
    """From here on a reply without a checksum is none."""
    try:
        _ensure(talk, "comm.checksum", 1, axis=0)
        talk.parser.checksums = True
        talk.ask("get comm.checksum", axis=0)
    except (RejectedError, SilenceError) as error:
        why = f"rejected, {error.reason}" if isinstance(error, RejectedError) else "replies come without"
        raise DeviceSetupError(
            f"{link_name(settings)}: checksums stay off ({why}); expected a device with comm.checksum "
            "(without it a damaged digit is a valid position)"
        ) from error


def _ensure(talk: ZaberTalk, name: str, value: int, axis: int | None = None) -> None:
    """Sets what is not so yet: the device writes every `set` to its flash."""
    if talk.number(f"get {name}", axis) != value:
        talk.ask(f"set {name} {value}", axis)
