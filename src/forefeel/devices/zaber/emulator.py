"""An emulated Zaber stage that speaks ASCII, at the level of its bytes. Pure in time.

It has what our driver and its calibration use: message ids, checksums where a command carries one, addresses
and broadcast, `get` and `set`, `move abs`, `min` and `max`, `home`, `stop`, `warnings`; it rejects
with the device's reasons. The manufacturer's own library (`zaber-motion`) drives it, too.
"""

import re
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from enum import Enum, auto
from math import copysign, sqrt
from pathlib import Path

from forefeel.devices.emulation.bench import TRAVEL_M, Emulation, SerialBench, Surroundings, moved
from forefeel.devices.zaber.protocol import ACCELERATION_DATA, SPEED_DATA, WARNINGS, is_fault, lrc
from forefeel.devices.zaber.settings import ZaberSettings

STEP_S = 0.001  # s, step of the emulated motion
_STALL_S = 0.05  # s for which the motor stands before it gives up with FS
_NEAR = 1e-6  # microsteps


class AxisMode(Enum):
    IDLE = auto()
    POSITION = auto()
    HOME = auto()
    STOP = auto()


class ZaberAxis:
    """Trapezoidal motion in steps of 1 ms. Positions in microsteps from the home sensor; `reported` from what
    the axis takes for its home.

    Attributes:
        maximum_speed, homing_speed, acceleration: limits, in microsteps/s and /s^2.
        limits: where it may go, in reported microsteps.
        flags: the warning flags that are set.
        stuck: whether something blocks it.
    """

    def __init__(self, limits: tuple[float, float], position: float) -> None:
        self.limits, self.position = limits, position
        self.velocity = self.change = self._reference = self._goal = self._stalled_s = 0.0
        self.maximum_speed = self.acceleration = self.homing_speed = 1.0
        self.flags: set[str] = set()
        self.stuck, self.enabled = False, True
        self.motion = AxisMode.IDLE

    @property
    def reported(self) -> float:
        return self.position - self._reference

    @property
    def busy(self) -> bool:
        return self.motion is not AxisMode.IDLE

    def lose_reference(self) -> None:
        """Acts as after power was off: takes its position for zero, with WR set."""
        self._reference = self.position
        self.motion, self.velocity = AxisMode.IDLE, 0.0
        self.flags, self.enabled = {"WR"}, True

    def begin(self, motion: AxisMode, goal: float = 0.0) -> None:
        """Begins a motion: to a reported position, to the home sensor, or to rest; NI if another was on."""
        self.flags = self.flags | {"NI"} if self.busy else self.flags - {"NI"}
        self.motion, self._goal = motion, goal

    def step(self) -> None:
        before = self.velocity
        if self.busy:
            self._move()
        self.change = (self.velocity - before) / STEP_S

    def _move(self) -> None:
        """Advances velocity and position by 1 ms; stalls if stuck, ends a motion at rest at its goal."""
        wanted, most = self._wanted(), self.acceleration * STEP_S
        self.velocity = max(self.velocity - most, min(self.velocity + most, wanted))
        if self.velocity and self.stuck:
            self._stall()
            return
        self._stalled_s = 0.0
        self.position += self.velocity * STEP_S
        if self.velocity == wanted == 0.0:
            self._end()

    def _wanted(self) -> float:
        """The velocity in microsteps/s that the motion asks for: the largest that comes to rest at its goal.

        Braking in steps of dt from v covers at most v^2 / 2A + v dt / 2 + A dt^2 / 8; one step is to land.
        """
        if self.motion is AxisMode.STOP:
            return 0.0
        homing = self.motion is AxisMode.HOME
        distance = -self.position if homing else self._goal - self.reported
        way, brake = abs(distance), self.acceleration * STEP_S
        if way < _NEAR:
            return 0.0
        largest = way / STEP_S
        if way > brake * STEP_S:
            room = way - 0.125 * brake * STEP_S
            largest = sqrt(0.25 * brake * brake + 2.0 * self.acceleration * room) - 0.5 * brake
        return copysign(min(self.homing_speed if homing else self.maximum_speed, largest), distance)

    def _stall(self) -> None:
        """Sets the velocity to 0; after 50 ms ends the motion and sets FS; a stop ends at once, without."""
        self.velocity = 0.0
        self._stalled_s += STEP_S
        if self._stalled_s >= _STALL_S and self.motion is not AxisMode.STOP:
            self.flags.add("FS")
        if self._stalled_s >= _STALL_S or self.motion is AxisMode.STOP:
            self._stalled_s = 0.0
            self._end()

    def _end(self) -> None:
        if self.motion is AxisMode.HOME and "FS" not in self.flags:
            self._reference = 0.0
            self.flags -= {"WR", "WH"}
        self.motion = AxisMode.IDLE


@dataclass(frozen=True, slots=True)
class ZaberModel:
    """Constants of an emulated stage. `limits_m`: travel, home is at 0; `start_m`: its position; `homed`: it
    has a reference; `has_checksums`: its replies can carry checksums.
    """

    address: int = 1
    serial: int = 73451
    microstep_m: float = 1e-7
    limits_m: tuple[float, float] = (0.0, 0.1)
    start_m: float = 0.0
    homed: bool = True
    has_checksums: bool = True
    max_velocity_m_s: float = 1.0
    max_acceleration_m_s2: float = 100.0


class RejectedCommandError(Exception):
    """A command that the device does not take; the text is its reason, BADDATA for example."""


Moved = Callable[[float, float, float, float], None]
_ENDS = re.compile(rb"[\r\n]")
_MAX_LINE_BYTES = 128  # bytes of a command without its end that are kept
_WHOLE = re.compile(r"-?\d{1,12}")
_GRAVITY = list(WARNINGS)


class ZaberDevice:
    """A stage of one axis (see `EmulatedDevice`).

    Attributes:
        moved: called on each step of 1 ms with (t_s, x_m, v_m_s, a_m_s2).
        counts: `ignored` lines (noise, bad checksums).
    """

    faults = "drive_fault", "stuck", "free", "power_cycle"

    def __init__(self, model: ZaberModel = ZaberModel(), moved: Moved | None = None) -> None:
        self.model, self.moved = model, moved
        self.counts: Counter[str] = Counter()
        per_m = 1.0 / model.microstep_m
        low, high = (round(end_m * per_m) for end_m in model.limits_m)
        self.axis = ZaberAxis((low, high), round(model.start_m * per_m))
        if not model.homed:
            self.axis.lose_reference()
        self._steps = 0
        self._partial, self._sent = b"", bytearray()
        speed, acceleration = per_m * SPEED_DATA, per_m * ACCELERATION_DATA
        self._fixed = {"device.id": "50081", "system.serial": f"{model.serial}", "version": "7.10"}
        self._settings = {
            "limit.approach.maxspeed": round(0.02 * speed),
            "maxspeed": round(0.05 * speed),
            "accel": round(acceleration),
        }
        if model.has_checksums:
            self._settings["comm.checksum"] = 0
        fastest = round(model.max_velocity_m_s * speed)
        self._ranges = {
            "maxspeed": (1, fastest),
            "limit.approach.maxspeed": (1, fastest),
            "accel": (1, round(model.max_acceleration_m_s2 * acceleration)),
        }
        self._apply()
        self._commands: dict[str, Callable[[list[str]], str]] = {
            "": lambda _: "0",
            "get": self._get,
            "set": self._set,
            "move": self._move,
            "home": lambda args: self._begin(args, AxisMode.HOME),
            "stop": self._stop,
            "warnings": self._warnings,
            "driver": self._driver,
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
        """Begins a fault: `drive_fault`: the driver goes off (FD); `stuck`: the axis is blocked until `free`;
        any other (`power_cycle`): it loses its reference.
        """
        if fault == "drive_fault":
            self.axis.enabled = False
            self.axis.flags.add("FD")
            if self.axis.busy:
                self.axis.begin(AxisMode.STOP)
        elif fault in ("stuck", "free"):
            self.axis.stuck = fault == "stuck"
        else:
            self._partial = b""
            self.axis.lose_reference()

    def _live(self, t_s: float) -> None:
        while (self._steps + 1) * STEP_S <= t_s + 1e-9:
            self._steps += 1
            self.axis.step()
            if self.moved is not None:
                self.moved(self._steps * STEP_S, *self.motion())

    # --- lines ---

    def _line(self, line: bytes) -> None:
        """Runs one command line and appends the reply to what is sent, a rejection too. Ignores and counts
        noise and wrong checksums; ignores commands to other addresses.
        """
        _, slash, rest = line.partition(b"/")
        body, colon, checksum = rest.rpartition(b":")
        if not slash or not rest.isascii() or (colon and checksum != b"%02X" % lrc(body)):
            self.counts["ignored"] += 1
            return
        words = (body if colon else rest).decode("ascii").split()
        address, axis = _number(words), _number(words)
        message_id = None if axis is None else _number(words)
        if address not in (0, None, self.model.address):
            return
        try:
            data, flag = self._do(axis or 0, words), "OK"
        except RejectedCommandError as reason:
            data, flag = str(reason), "RJ"
        tag = "" if message_id is None else f"{message_id:02d} "
        status = f"{'BUSY' if self.axis.busy else 'IDLE'} {(self._flags() or ['--'])[0]}"
        answer = f"@{self.model.address:02d} {axis or 0} {tag}{flag} {status} {data}".encode("ascii")
        if self._settings.get("comm.checksum"):
            answer += b":%02X" % lrc(answer[1:])
        self._sent += answer + b"\r\n"

    def _do(self, axis: int, words: list[str]) -> str:
        """Runs a command; returns the data of its reply. RejectedCommandError: an axis above 1, an unknown
        command, or wrong arguments.
        """
        if axis > 1:
            raise RejectedCommandError("BADAXIS")
        name, *args = words or [""]
        if name not in self._commands:
            raise RejectedCommandError("BADCOMMAND")
        return self._commands[name](args)

    def _flags(self) -> list[str]:
        return sorted(self.axis.flags, key=_GRAVITY.index)

    # --- settings and motion ---

    def _get(self, args: list[str]) -> str:
        """Returns a setting, position or limit as text. RejectedCommandError: any other name."""
        low, high = self.axis.limits
        shown = {"pos": round(self.axis.reported), "limit.min": low, "limit.max": high}
        known = {**self._fixed, **self._settings, **shown}
        if len(args) != 1 or args[0] not in known:
            raise RejectedCommandError("BADCOMMAND")
        return f"{known[args[0]]}"

    def _set(self, args: list[str]) -> str:
        """Sets a setting to a whole number and applies it to the axis; returns `0`. RejectedCommandError: an
        unknown setting, or a value out of its range.
        """
        name = args[0] if args else ""
        if name not in self._settings:
            raise RejectedCommandError("BADCOMMAND")
        low, high = self._ranges.get(name, (0, 1))
        self._settings[name] = _whole(args[1:], low, high)
        self._apply()
        return "0"

    def _apply(self) -> None:
        settings, axis = self._settings, self.axis
        axis.maximum_speed = settings["maxspeed"] / SPEED_DATA
        axis.homing_speed = settings["limit.approach.maxspeed"] / SPEED_DATA
        axis.acceleration = settings["accel"] / ACCELERATION_DATA

    def _move(self, args: list[str]) -> str:
        """Begins a motion to an end of the travel (`min`, `max`) or to a position (`abs`); returns `0`.
        RejectedCommandError: another kind, a position beyond the limits, or the driver is off.
        """
        kind, *rest = args or [""]
        low, high = self.axis.limits
        if kind in ("min", "max"):
            return self._begin(rest, AxisMode.POSITION, low if kind == "min" else high)
        if kind != "abs":
            raise RejectedCommandError("BADCOMMAND")
        return self._begin([], AxisMode.POSITION, _whole(rest, low, high))

    def _begin(self, args: list[str], motion: AxisMode, goal: float = 0.0) -> str:
        """Begins a motion; returns the reply's data, `0`. RejectedCommandError: `args`, or the driver off."""
        if args:
            raise RejectedCommandError("BADDATA")
        if not self.axis.enabled:
            raise RejectedCommandError("DRIVERDISABLED")
        self.axis.begin(motion, goal)
        return "0"

    def _stop(self, args: list[str]) -> str:
        if args:
            raise RejectedCommandError("BADDATA")
        self.axis.begin(AxisMode.STOP)
        return "0"

    def _warnings(self, args: list[str]) -> str:
        """Returns the number and names of the flags that are set, the gravest first. With `clear` it then
        clears FS and those that are no faults. RejectedCommandError: any other argument.
        """
        if args not in ([], ["clear"]):
            raise RejectedCommandError("BADDATA")
        flags = self._flags()
        if args:
            self.axis.flags -= {flag for flag in flags if flag == "FS" or not is_fault(flag)}
        return " ".join([f"{len(flags):02d}", *flags])

    def _driver(self, args: list[str]) -> str:
        if args != ["enable"]:
            raise RejectedCommandError("BADDATA")
        self.axis.enabled = True
        self.axis.flags.discard("FD")
        return "0"


def _number(words: list[str]) -> int | None:
    return int(words.pop(0)) if words and words[0].isdecimal() else None


def _whole(args: list[str], low: float, high: float) -> int:
    """The one whole number of a command within its range."""
    if len(args) != 1 or not _WHOLE.fullmatch(args[0]) or not low <= int(args[0]) <= high:
        raise RejectedCommandError("BADDATA")
    return int(args[0])


_BEHIND_M = 0.001  # m, how far the stage's own limits lie beyond the travel of the settings


def build(settings: ZaberSettings, around: Surroundings, leave: ExitStack) -> SerialBench:
    """Builds the emulated stage on the port of the settings, for `Emulation`; the port is not opened yet. Its
    own limits lie 1 mm beyond the travel; its motion moves the simulated vessel.
    """
    low_m, high_m = sorted(settings.sign * end_m for end_m in settings.travel_m)
    model = ZaberModel(
        address=settings.device,
        microstep_m=settings.microstep_m,
        limits_m=(low_m - _BEHIND_M, high_m + _BEHIND_M),
        start_m=settings.sign * around.world.stage.start_m,
    )
    device = ZaberDevice(model, moved(around, settings.sign, leave))
    return SerialBench(device, Path(settings.port), settings.baud)


EMULATION = Emulation({"microstep_m": 1e-7, "travel_m": TRAVEL_M}, build)
