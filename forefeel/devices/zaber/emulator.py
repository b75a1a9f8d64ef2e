"""An emulated Zaber stage that speaks ASCII, at the level of its bytes. Pure in time.

It takes what the device takes: message ids, checksums where a command carries one, addresses and broadcast,
`get` and `set`, motions, `warnings`, alerts; it rejects with the device's reasons. Full enough for the
manufacturer's own library (`zaber-motion`) with native units.
"""

import re
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from enum import Enum
from math import copysign, sqrt
from pathlib import Path

from forefeel.common.errors import ConfigurationError
from forefeel.devices.emulation.bench import (
    TRAVEL_M,
    Emulation,
    SerialBench,
    Surroundings,
    moved,
)
from forefeel.devices.zaber.protocol import ACCELERATION_DATA, SPEED_DATA, WARNINGS, is_fault, lrc
from forefeel.devices.zaber.settings import ZaberSettings

# --- The axis of an emulated Zaber stage: trapezoidal motion in steps of 1 ms, homing, stalls. Pure.
STEP_S = 0.001  # s, step of the emulated motion
_STALL_S = 0.05  # s for which the motor stands before it gives up with FS
_NEAR = 1e-6  # microsteps


class AxisMode(Enum):
    IDLE = "idle"
    POSITION = "position"
    VELOCITY = "velocity"
    HOME = "home"
    STOP = "stop"


class ZaberAxis:
    """Positions in microsteps from the home sensor; `reported` from what the axis takes for its home.

    Attributes:
        maximum_speed, acceleration: limits, in microsteps/s and /s^2.
        limits: where it may go, in reported microsteps.
        flags: the warning flags that are set.
        stuck: whether something blocks it.
        ended: called when a motion has ended.
    """

    def __init__(self, ends: tuple[float, float], position: float, homed: bool) -> None:
        self.position, self.velocity, self.change = position, 0.0, 0.0
        self.maximum_speed, self.acceleration, self.homing_speed = 1.0, 1.0, 1.0
        self.limits = ends
        self.flags: set[str] = set()
        self.stuck = False
        self.enabled = True
        self.ended: Callable[[], None] | None = None
        self.motion = AxisMode.IDLE
        self._ends = ends
        self._reference = 0.0
        self._goal = 0.0
        self._stalled_s = 0.0
        if not homed:
            self.lose_reference()

    @property
    def reported(self) -> float:
        return self.position - self._reference

    @property
    def busy(self) -> bool:
        return self.motion is not AxisMode.IDLE

    def lose_reference(self) -> None:
        """As after power was off: it takes where it is for zero, and says so."""
        self._reference = self.position
        self.motion, self.velocity = AxisMode.IDLE, 0.0
        self.flags = {"WR"}
        self.enabled = True

    def place(self, reported: float) -> None:
        """It is told where it is: a reference, but no home."""
        self._reference = self.position - reported
        self.flags = self.flags - {"WR"} | {"WH"}

    def begin(self, motion: AxisMode, goal: float = 0.0) -> None:
        """A motion: to a reported position, at a velocity, to the home sensor, or to rest."""
        if self.busy:
            self.flags.add("NI")
        else:
            self.flags.discard("NI")
        self.motion, self._goal = motion, goal

    def disable(self, flag: str) -> None:
        """The driver is off: the axis comes to rest and takes no motion."""
        self.enabled = False
        self.flags.add(flag)
        if self.busy:
            self.begin(AxisMode.STOP)

    def step(self) -> None:
        """Moves the axis on by `STEP_S`."""
        before = self.velocity
        if self.busy:
            self._move()
        self.change = (self.velocity - before) / STEP_S

    def _move(self) -> None:
        wanted, most = self._wanted(), self.acceleration * STEP_S
        self.velocity = max(self.velocity - most, min(self.velocity + most, wanted))
        if self.velocity and (self.stuck or self._beyond(self.position + self.velocity * STEP_S)):
            self._stall()
            return
        self._stalled_s = 0.0
        self.position += self.velocity * STEP_S
        if self.velocity == wanted == 0.0:
            self._end()

    def _wanted(self) -> float:
        """The velocity in microsteps/s that the motion asks for."""
        if self.motion is AxisMode.STOP:
            return 0.0
        if self.motion is AxisMode.HOME:
            return self._towards(-self.position, self.homing_speed)
        if self.motion is AxisMode.POSITION:
            return self._towards(self._goal - self.reported, self.maximum_speed)
        room = self.limits[1 if self._goal > 0 else 0] - self.reported
        return self._towards(room, abs(self._goal)) if room * self._goal > 0 else 0.0

    def _towards(self, distance: float, fastest: float) -> float:
        """The largest velocity, of at most `fastest`, that comes to rest in that distance.

        Braking in steps of dt from v covers at most v^2 / 2A + v dt / 2 + A dt^2 / 8; one step is to land.
        """
        way, brake = abs(distance), self.acceleration * STEP_S
        if way < _NEAR:
            return 0.0
        if way <= brake * STEP_S:
            return copysign(min(fastest, way / STEP_S), distance)
        room = way - 0.125 * brake * STEP_S
        largest = sqrt(0.25 * brake * brake + 2.0 * self.acceleration * room) - 0.5 * brake
        return copysign(min(fastest, largest), distance)

    def _beyond(self, position: float) -> bool:
        margin = 0.01 * (self._ends[1] - self._ends[0])
        outward = self.velocity if position > 0.5 * sum(self._ends) else -self.velocity
        return outward > 0 and not self._ends[0] - margin <= position <= self._ends[1] + margin

    def _stall(self) -> None:
        self.velocity = 0.0
        self._stalled_s += STEP_S
        if self.motion is AxisMode.STOP:
            self._end()
        elif self._stalled_s >= _STALL_S:
            self.flags.add("FS")
            self._stalled_s = 0.0
            self._end()

    def _end(self) -> None:
        if self.motion is AxisMode.HOME and "FS" not in self.flags:
            self._reference = 0.0
            self.flags -= {"WR", "WH"}
        self.motion = AxisMode.IDLE
        if self.ended is not None:
            self.ended()


# --- The settings of an emulated Zaber stage, with their ranges, and what its axis takes from them. Pure.
_WHOLE = re.compile(r"-?\d{1,12}")
_FAR_MICROSTEPS = 1_000_000_000  # microsteps, bound of the settings `limit.min` and `limit.max`


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
            return -_FAR_MICROSTEPS, int(self._values["limit.max"])
        if name == "limit.max":
            return int(self._values["limit.min"]), _FAR_MICROSTEPS
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


# --- An emulated Zaber stage that speaks ASCII, at the level of its bytes. Pure in time.
Moved = Callable[[float, float, float, float], None]
_ENDS = re.compile(rb"[\r\n]")
_MAX_LINE_BYTES = 128  # bytes of a command without its end that are kept
_GRAVITY = list(WARNINGS)


class ZaberDevice:
    """A stage of one axis (see `EmulatedDevice`).

    Attributes:
        moved: called on each step of 1 ms with (t_s, x_m, v_m_s, a_m_s2).
        counts: `commands`, `ignored` lines (noise, bad checksums), `rejected`, `moves`, `stops`.
    """

    faults = "drive_fault", "stuck", "free", "power_cycle"

    def __init__(self, model: ZaberModel = ZaberModel(), moved: Moved | None = None) -> None:
        self.model, self.moved = model, moved
        self.counts: Counter[str] = Counter()
        step_m = model.microstep_m
        low, high = (round(end_m / step_m) for end_m in model.limits_m)
        self.axis = ZaberAxis((low, high), round(model.start_m / step_m), model.homed)
        self.axis.ended = self._ended
        self._steps = 0
        self._partial, self._sent = b"", bytearray()
        self._register = ZaberRegister(model, self.axis)
        self._commands: dict[str, Callable[[int, list[str]], str]] = {
            "": lambda _, __: "0",
            "get": self._get,
            "set": self._set,
            "move": self._move,
            "home": lambda _, args: self._begin(args, AxisMode.HOME),
            "stop": self._stop,
            "estop": self._estop,
            "warnings": self._warnings,
            "driver": self._driver,
            "tools": self._tools,
            "system": self._system,
        }

    def motion(self) -> tuple[float, float, float]:
        """(x in m from the home sensor, v in m/s, a in m/s^2), in the device's own direction."""
        axis, step_m = self.axis, self.model.microstep_m
        return axis.position * step_m, axis.velocity * step_m, axis.change * step_m

    def receive(self, data: bytes, t_s: float) -> None:
        self._live(t_s)
        *lines, partial = _ENDS.split(self._partial + data)
        self._partial = partial if len(partial) <= _MAX_LINE_BYTES else b""
        for line in filter(None, lines):
            self._line(line)

    def advance(self, t_s: float) -> bytes:
        self._live(t_s)
        sent, self._sent = bytes(self._sent), bytearray()
        return sent

    def provoke(self, fault: str) -> None:
        """`drive_fault`: the driver goes off (FD); `stuck`: something blocks it until `free`; `power_cycle`:
        it has forgotten where it is.
        """
        if fault == "drive_fault":
            self.axis.disable("FD")
        elif fault in ("stuck", "free"):
            self.axis.stuck = fault == "stuck"
        elif fault == "power_cycle":
            self._restart()
        else:
            raise ConfigurationError(f"fault {fault!r}: expected {', '.join(self.faults)} of a Zaber stage")

    def _live(self, t_s: float) -> None:
        while (self._steps + 1) * STEP_S <= t_s + 1e-9:
            self._steps += 1
            self.axis.step()
            if self.moved is not None:
                self.moved(self._steps * STEP_S, *self.motion())

    # --- lines ---

    def _line(self, line: bytes) -> None:
        _, slash, rest = line.partition(b"/")
        body, colon, checksum = rest.rpartition(b":")
        if not slash or not rest.isascii():
            self.counts["ignored"] += 1
            return
        if colon and checksum != b"%02X" % lrc(body):
            self.counts["ignored"] += 1
            return
        self._command((body if colon else rest).decode("ascii").split())

    def _command(self, words: list[str]) -> None:
        address, axis = _number(words), _number(words)
        message_id = "" if axis is None else _message_id(words)
        if address not in (0, None, self.model.address):
            return
        self.counts["commands"] += 1
        try:
            data, flag = self._do(axis or 0, words), "OK"
        except SettingRejectedError as reason:
            self.counts["rejected"] += 1
            data, flag = str(reason), "RJ"
        self._send(f"@{self.model.address:02d} {axis or 0} {message_id}{flag} {self._status()} {data}")

    def _do(self, axis: int, words: list[str]) -> str:
        if axis > 1:
            raise SettingRejectedError("BADAXIS")
        name, *args = words or [""]
        if name not in self._commands:
            raise SettingRejectedError("BADCOMMAND")
        return self._commands[name](axis, args)

    def _status(self) -> str:
        flags = sorted(self.axis.flags, key=_GRAVITY.index)
        return f"{'BUSY' if self.axis.busy else 'IDLE'} {flags[0] if flags else '--'}"

    def _send(self, text: str) -> None:
        line = text.encode("ascii")
        if self._register.is_on("comm.checksum"):
            line += b":%02X" % lrc(line[1:])
        self._sent += line + b"\r\n"

    def _ended(self) -> None:
        if self._register.is_on("comm.alert"):
            self._send(f"!{self.model.address:02d} 1 {self._status()}")

    # --- settings and motion ---

    def _get(self, axis: int, args: list[str]) -> str:
        del axis
        return self._register.get(args)

    def _set(self, axis: int, args: list[str]) -> str:
        self._register.set(axis, args)
        return "0"

    def _move(self, axis: int, args: list[str]) -> str:
        del axis
        kind, *rest = args or [""]
        low, high = self.axis.limits
        if kind == "vel":
            return self._begin([], AxisMode.VELOCITY, whole(rest) / SPEED_DATA)
        if kind in ("min", "max"):
            return self._begin(rest, AxisMode.POSITION, low if kind == "min" else high)
        if kind not in ("abs", "rel"):
            raise SettingRejectedError("BADCOMMAND")
        goal = whole(rest) + (self.axis.reported if kind == "rel" else 0)
        if not low <= goal <= high:
            raise SettingRejectedError("BADDATA")
        return self._begin([], AxisMode.POSITION, goal)

    def _begin(self, args: list[str], motion: AxisMode, goal: float = 0.0) -> str:
        if args:
            raise SettingRejectedError("BADDATA")
        if not self.axis.enabled:
            raise SettingRejectedError("DRIVERDISABLED")
        self.counts["moves"] += 1
        self.axis.begin(motion, goal)
        return "0"

    def _stop(self, axis: int, args: list[str]) -> str:
        del axis
        if args:
            raise SettingRejectedError("BADDATA")
        self.counts["stops"] += 1
        self.axis.begin(AxisMode.STOP)
        return "0"

    def _estop(self, axis: int, args: list[str]) -> str:
        self._stop(axis, args)
        self.axis.velocity = 0.0
        return "0"

    # --- the rest ---

    def _warnings(self, axis: int, args: list[str]) -> str:
        del axis
        if args not in ([], ["clear"]):
            raise SettingRejectedError("BADDATA")
        flags = sorted(self.axis.flags, key=_GRAVITY.index)
        if args:
            self.axis.flags -= {flag for flag in flags if flag == "FS" or not (is_fault(flag))}
        return " ".join([f"{len(flags):02d}", *flags])

    def _driver(self, axis: int, args: list[str]) -> str:
        del axis
        if args == ["disable"]:
            self.axis.disable("FD")
        elif args == ["enable"]:
            self.axis.enabled = True
            self.axis.flags.discard("FD")
        else:
            raise SettingRejectedError("BADDATA")
        return "0"

    def _tools(self, axis: int, args: list[str]) -> str:
        del axis
        if args[:1] != ["echo"]:
            raise SettingRejectedError("BADCOMMAND")
        return " ".join(args[1:]) or "0"

    def _system(self, axis: int, args: list[str]) -> str:
        if axis:
            raise SettingRejectedError("DEVICEONLY")
        if args not in (["restart"], ["reset"]):
            raise SettingRejectedError("BADCOMMAND")
        self._restart()
        return "0"

    def _restart(self) -> None:
        self._partial = b""
        self.axis.lose_reference()


def _number(words: list[str]) -> int | None:
    return int(words.pop(0)) if words and words[0].isdecimal() else None


def _message_id(words: list[str]) -> str:
    found = _number(words)
    return "" if found is None else f"{found:02d} "


# --- the emulator of a YAML file ---

_BEHIND_M = 0.001  # m, how far the stage's own limits lie beyond the travel of the settings


def build(settings: ZaberSettings, around: Surroundings, leave: ExitStack) -> SerialBench:
    """Builds the emulated stage, with the vessel in front of it, for `Emulation`."""
    low_m, high_m = sorted(settings.sign * end_m for end_m in settings.travel_m)
    model = ZaberModel(
        address=settings.device,
        microstep_m=settings.microstep_m,
        limits_m=(low_m - _BEHIND_M, high_m + _BEHIND_M),
        start_m=settings.sign * around.world.stage.start_m,
    )
    return SerialBench(
        ZaberDevice(model, moved(around, settings.sign, leave)), Path(settings.port), settings.baud
    )


EMULATION = Emulation({"microstep_m": 1e-7, "travel_m": TRAVEL_M}, build)
