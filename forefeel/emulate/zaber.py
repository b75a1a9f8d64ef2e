"""An emulated Zaber stage that speaks ASCII, at the level of its bytes. Pure in time.

It takes what the device takes: message ids, checksums where a command carries one, addresses and broadcast,
`get` and `set`, motions, `warnings`, alerts; it rejects with the device's reasons. Full enough for the
manufacturer's own library (`zaber-motion`) with native units.
"""

import re
from collections import Counter
from collections.abc import Callable

from forefeel.common.errors import ConfigurationError
from forefeel.common.hardware.zaber import SPEED_DATA, WARNINGS, is_fault, lrc
from forefeel.emulate.zaber_axis import STEP_S, AxisMode, ZaberAxis
from forefeel.emulate.zaber_settings import SettingRejectedError, ZaberModel, ZaberRegister, whole

Moved = Callable[[float, float, float, float], None]
_ENDS = re.compile(rb"[\r\n]")
_MAX_LINE = 128
_GRAVITY = list(WARNINGS)


class ZaberDevice:
    """A stage of one axis (see `EmulatedDevice`).

    Attributes:
        moved: called on each step of 1 ms with (t_s, x_m, v_m_s, a_m_s2).
        counts: `commands`, `ignored` lines (noise, bad checksums), `rejected`, `moves`, `stops`.
    """

    faults = "drive_fault", "stuck", "free", "power_cycle"

    def __init__(self, model: ZaberModel = ZaberModel(), moved: Moved | None = None) -> None:  # noqa: B008 - frozen
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
        """See `EmulatedDevice`."""
        self._live(t_s)
        *lines, partial = _ENDS.split(self._partial + data)
        self._partial = partial if len(partial) <= _MAX_LINE else b""
        for line in filter(None, lines):
            self._line(line)

    def advance(self, t_s: float) -> bytes:
        """See `EmulatedDevice`."""
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
    """Takes a leading number off the words."""
    return int(words.pop(0)) if words and words[0].isdecimal() else None


def _message_id(words: list[str]) -> str:
    found = _number(words)
    return "" if found is None else f"{found:02d} "
