"""The settings of an emulated Zaber stage, with their ranges, and what its axis takes from them. Pure."""

import re
from dataclasses import dataclass

from forefeel.common.hardware.zaber import ACCELERATION_DATA, SPEED_DATA
from forefeel.emulate.zaber_axis import ZaberAxis

_WHOLE = re.compile(r"-?\d{1,12}")
_FAR = 1_000_000_000


@dataclass(frozen=True, slots=True)
class ZaberModel:
    """What kind of stage it is. `limits_m`: travel, home is at 0; `start_m`: where it stands; `homed`:
    whether it knows that; `has_checksums`: whether it can put checksums on its replies.
    """

    address: int = 1
    device_id: int = 50081
    serial: int = 73451
    version: str = "7.10"
    microstep_m: float = 1e-7
    limits_m: tuple[float, float] = (0.0, 0.1)
    start_m: float = 0.0
    homed: bool = True
    has_checksums: bool = True
    max_velocity_m_s: float = 1.0
    max_acceleration_m_s2: float = 100.0


class SettingRejectedError(Exception):
    """A command that the device does not take; the text is its reason, BADDATA for example."""


class ZaberRegister:
    """What `get` and `set` reach."""

    def __init__(self, model: ZaberModel, axis: ZaberAxis) -> None:
        self._model, self._axis = model, axis
        low, high = (round(limit) for limit in axis.limits)
        self._values = {
            "device.id": f"{model.device_id}",
            "deviceid": f"{model.device_id}",
            "system.serial": f"{model.serial}",
            "version": model.version,
            "system.axiscount": "1",
            "system.access": "1",
            "system.voltage": "24.1",
            "comm.address": f"{model.address}",
            "comm.alert": "0",
            "comm.packet.size.max": "80",
            "comm.word.size.max": "50",
            "comm.command.packets.max": "1",
            "resolution": "64",
            "limit.min": f"{low}",
            "limit.max": f"{high}",
            "limit.approach.maxspeed": f"{self._speed_data(0.02)}",
            "maxspeed": f"{self._speed_data(0.05)}",
            "accel": f"{self._acceleration_data(1.0)}",
        }
        if model.has_checksums:
            self._values["comm.checksum"] = "0"
        self._apply()

    def is_on(self, name: str) -> bool:
        """Whether a setting is 1."""
        return self._values.get(name) == "1"

    def get(self, args: list[str]) -> str:
        """The data of `get`; RejectedError for what there is not."""
        if args == ["pos"]:
            return f"{round(self._axis.reported)}"
        if len(args) != 1 or args[0] not in self._values:
            raise SettingRejectedError("BADCOMMAND")
        return self._values[args[0]]

    def set(self, axis: int, args: list[str]) -> None:
        """`set` of one setting; RejectedError for what there is not, can not be set or is out of range."""
        name = args[0] if args else ""
        if name == "pos":
            self._axis.place(whole(args[1:]))
            return
        if name not in self._values:
            raise SettingRejectedError("BADCOMMAND")
        if axis and name.startswith(("comm.", "system.")):
            raise SettingRejectedError("DEVICEONLY")
        value = whole(args[1:])
        low, high = self._range(name)
        if not low <= value <= high:
            raise SettingRejectedError("BADDATA")
        self._values[name] = f"{value}"
        self._apply()

    def _range(self, name: str) -> tuple[int, int]:
        if name in ("comm.alert", "comm.checksum"):
            return 0, 1
        if name == "limit.min":
            return -_FAR, int(self._values["limit.max"])
        if name == "limit.max":
            return int(self._values["limit.min"]), _FAR
        if name in ("maxspeed", "limit.approach.maxspeed"):
            return 1, self._speed_data(self._model.max_velocity_m_s)
        if name == "accel":
            return 1, self._acceleration_data(self._model.max_acceleration_m_s2)
        return (1, 2) if name == "system.access" else (1, 0)

    def _speed_data(self, speed_m_s: float) -> int:
        return round(speed_m_s / self._model.microstep_m * SPEED_DATA)

    def _acceleration_data(self, acceleration_m_s2: float) -> int:
        return round(acceleration_m_s2 / self._model.microstep_m * ACCELERATION_DATA)

    def _apply(self) -> None:
        found, axis = self._values, self._axis
        axis.maximum_speed = int(found["maxspeed"]) / SPEED_DATA
        axis.homing_speed = int(found["limit.approach.maxspeed"]) / SPEED_DATA
        axis.acceleration = int(found["accel"]) / ACCELERATION_DATA
        axis.limits = (int(found["limit.min"]), int(found["limit.max"]))


def whole(args: list[str]) -> int:
    """The one whole number of a command; RejectedError where there is none."""
    if len(args) != 1 or _WHOLE.fullmatch(args[0]) is None:
        raise SettingRejectedError("BADDATA")
    return int(args[0])
