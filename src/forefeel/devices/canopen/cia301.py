"""Objects, identifiers, PDO parameters and emergencies of every CANopen device (CiA 301). Pure."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

SYNC = 0x080  # CAN identifier, the default of object 1005 (CiA 301)
EMERGENCY, TPDO1, RPDO1, HEARTBEAT = 0x080, 0x180, 0x200, 0x700  # + node
SDO_TO_DEVICE, SDO_TO_HOST = 0x600, 0x580  # + node
NMT = 0x000  # CAN identifier of network management (CiA 301)
START, ENTER_PREOPERATIONAL = 1, 128  # NMT commands (CiA 301)
OPERATIONAL = 5  # state in a heartbeat (CiA 301)
# bits 31 and 30 of a PDO's COB-ID: the PDO is not valid, remote frames are not allowed (CiA 301)
_PDO_OFF, _NO_REMOTE = 0x8000_0000, 0x4000_0000
_EMERGENCY = struct.Struct("<HB5s")


@dataclass(frozen=True, slots=True)
class ObjectEntry:
    """An entry of an object dictionary; `kind`: the letter of its type in `struct`."""

    index: int
    sub: int
    kind: str

    @property
    def size(self) -> int:
        return struct.calcsize("<" + self.kind)

    @property
    def mapping(self) -> int:
        """The entry as a PDO mapping names it: index, subindex, and bits (CiA 301)."""
        return self.index << 16 | self.sub << 8 | 8 * self.size

    def pack(self, value: float) -> bytes:
        """Little endian; struct.error when it does not fit."""
        return struct.pack("<" + self.kind, value if self.kind in "fd" else int(value))

    def unpack(self, data: bytes | bytearray) -> float:
        """The value, an int but for reals; ValueError for too few bytes (some devices send too many)."""
        if len(data) < self.size:
            raise ValueError(f"{self}: {len(data)} bytes, expected {self.size}")
        value: float = struct.unpack_from("<" + self.kind, data)[0]
        return value

    def __str__(self) -> str:
        return f"{self.index:04X}:{self.sub:02X}"


DEVICE_TYPE = ObjectEntry(0x1000, 0, "I")
ERROR_REGISTER = ObjectEntry(0x1001, 0, "B")
SYNC_PERIOD_US = ObjectEntry(0x1006, 0, "I")
HEARTBEAT_CONSUMER = ObjectEntry(0x1016, 1, "I")
HEARTBEAT_PRODUCER_MS = ObjectEntry(0x1017, 0, "H")
VENDOR, PRODUCT, REVISION, SERIAL = (ObjectEntry(0x1018, sub, "I") for sub in (1, 2, 3, 4))


def profile(device_type: int) -> int:
    return device_type & 0xFFFF


def heartbeat_consumer(node: int, timeout_s: float) -> int:
    """The value of 1016: the node that the device listens to, and for how long it may be silent."""
    return node << 16 | round(timeout_s * 1e3)


class Pdo(NamedTuple):
    """A PDO; `transmit`: from the device; `number` from 1; `kind` 1 to 240: at every so many SYNC."""

    transmit: bool
    number: int
    can_id: int
    kind: int
    entries: Sequence[ObjectEntry]

    @property
    def size(self) -> int:
        return sum(entry.size for entry in self.entries)

    def parameters(self) -> list[tuple[ObjectEntry, int]]:
        """Returns the (entry, value) pairs that set the PDO up, in the order in which to write them. The
        order is: PDO off, transmission type, mapping cleared, mapped entries, their number, PDO on.
        """
        communication, mapping = pdo_objects(self.transmit, self.number)
        can_id = self.can_id | (_NO_REMOTE if self.transmit else 0)
        return [
            (ObjectEntry(communication, 1, "I"), can_id | _PDO_OFF),
            (ObjectEntry(communication, 2, "B"), self.kind),
            (ObjectEntry(mapping, 0, "B"), 0),
            *((ObjectEntry(mapping, i, "I"), entry.mapping) for i, entry in enumerate(self.entries, start=1)),
            (ObjectEntry(mapping, 0, "B"), len(self.entries)),
            (ObjectEntry(communication, 1, "I"), can_id),
        ]

    def pack(self, *values: float) -> bytes:
        return b"".join(entry.pack(value) for entry, value in zip(self.entries, values, strict=True))

    def unpack(self, data: bytes | bytearray) -> tuple[float, ...] | None:
        """Decodes the values of a frame; None for another length than that of the mapping."""
        if len(data) != self.size:
            return None
        values, start = [], 0
        for entry in self.entries:
            values.append(entry.unpack(data[start : start + entry.size]))
            start += entry.size
        return tuple(values)


def pdo_objects(transmit: bool, number: int) -> tuple[int, int]:
    """The indices of a PDO's communication and mapping parameters."""
    base = 0x1800 if transmit else 0x1400
    return base + number - 1, base + 0x200 + number - 1


def pdo_off(transmit: bool, number: int, node: int) -> tuple[ObjectEntry, int]:
    """The entry and value that switch one of the first four PDOs off."""
    can_id = (TPDO1 if transmit else RPDO1) + 0x100 * (number - 1) + node
    return ObjectEntry(pdo_objects(transmit, number)[0], 1, "I"), can_id | _PDO_OFF


def emergency(data: bytes | bytearray) -> int | None:
    """The error code of an emergency frame; 0: no error any longer; None: it is none."""
    return int(_EMERGENCY.unpack(data)[0]) if len(data) == _EMERGENCY.size else None


def emergency_frame(code: int, register: int = 1) -> bytes:
    return _EMERGENCY.pack(code, register, b"")
