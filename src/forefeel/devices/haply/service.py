"""Messages of Haply's Inverse service, 3.1 and later: JSON over a WebSocket. Pure.

The service sends all that it knows when a client connects and when `FULL_STATE` asks for it (status and
configuration stand in these alone), and a state after each command. The shape is that which public clients
of the service read and write, not that of a specification.
"""

from math import sqrt

import msgspec

from forefeel.common.errors import DeviceError

Direction = tuple[float, float, float]

FULL_STATE = '{"session":{"force_render_full_state":{}}}'


class Vector(msgspec.Struct):
    """m, m/s or N in the coordinates of the device."""

    x: float
    y: float
    z: float

    def along(self, direction: Direction) -> float:
        return self.x * direction[0] + self.y * direction[1] + self.z * direction[2]

    @property
    def size(self) -> float:
        return sqrt(self.x * self.x + self.y * self.y + self.z * self.z)


class CursorState(msgspec.Struct):
    cursor_position: Vector
    cursor_velocity: Vector
    current_cursor_force: Vector = msgspec.field(default_factory=lambda: Vector(0.0, 0.0, 0.0))


class Inverse3Status(msgspec.Struct):
    ready: bool = True
    calibrated: bool = True
    power_supply: bool = True


class Inverse3(msgspec.Struct):
    device_id: str
    state: CursorState | None = None
    status: Inverse3Status | None = None


class GripState(msgspec.Struct):
    buttons: dict[str, bool] = msgspec.field(default_factory=dict)


class GripStatus(msgspec.Struct):
    awake: bool = True
    connected: bool = True


class VerseGrip(msgspec.Struct):
    state: GripState | None = None
    status: GripStatus | None = None


class ServiceMessage(msgspec.Struct):
    inverse3: list[Inverse3] = msgspec.field(default_factory=list)
    wireless_verse_grip: list[VerseGrip] = msgspec.field(default_factory=list)


_DECODER = msgspec.json.Decoder(ServiceMessage)


def decoded(text: str | bytes) -> ServiceMessage:
    """Decodes a message of the service. DeviceError: no JSON (a nan is none), or another shape."""
    try:
        return _DECODER.decode(text)
    except msgspec.MsgspecError as error:
        raise DeviceError(f"no message of the Inverse service: {error}") from error


def force_command(device_id: str, direction: Direction, force_n: float) -> str:
    """Encodes a force along `direction`; the service answers with its newest state."""
    x, y, z = (force_n * part for part in direction)
    commands = {"set_cursor_force": {"values": {"x": x, "y": y, "z": z}}}
    return msgspec.json.encode({"inverse3": [{"device_id": device_id, "commands": commands}]}).decode()
