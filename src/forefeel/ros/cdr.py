"""CDR bytes of the ROS messages that go over both wires, with the name and the type hash of each.

Little-endian XCDR1: primitives are aligned to their size, counted from behind the head of four bytes.
"""

import struct
from collections.abc import Iterable, Sequence
from functools import cache
from typing import NamedTuple

from forefeel.common.errors import CodecError

_HEAD = b"\x00\x01\x00\x00"  # CDR_LE of RTPS 2.3, table 10.3
_MOST_BYTES = 4096  # of a command; the longest of ours is a tenth
_NS_PER_S = 1_000_000_000


class RosType(NamedTuple):
    """Name and hash (REP 2016) of a message type; both are the same from ROS 2 Humble to Lyrical, where
    Humble knows no hash.
    """

    name: str
    hash: str

    @property
    def dds_name(self) -> str:
        package, kind, name = self.name.split("/")
        return f"{package}::{kind}::dds_::{name}_"


WRENCH_STAMPED = RosType(
    "geometry_msgs/msg/WrenchStamped",
    "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77",
)
JOINT_STATE = RosType(
    "sensor_msgs/msg/JointState", "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"
)
DIAGNOSTIC_ARRAY = RosType(
    "diagnostic_msgs/msg/DiagnosticArray",
    "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
)
OPERATING_STATE = RosType(
    "crtk_msgs/msg/OperatingState", "RIHS01_5cc57eea589b217fe5194bf2735b91d4a7f2dd5ac1245ae657f7ea7590c2c80e"
)
STRING_STAMPED = RosType(
    "crtk_msgs/msg/StringStamped", "RIHS01_83efb802e6596e03f69ac322e3231037329946f2bd13ed48874d97f5b8f5db1d"
)


class RosHeader(NamedTuple):
    """Header of std_msgs: ns since 1970, and the frame."""

    stamp_ns: int
    frame_id: str


class DiagnosticStatus(NamedTuple):
    """Status of diagnostic_msgs. `level`: 0 ok, 1 warning, 2 error, 3 stale."""

    level: int
    name: str
    message: str
    hardware_id: str
    values: Sequence[tuple[str, str]]


@cache
def _form(codes: str) -> tuple[struct.Struct, int]:
    """Layout of primitives of one size, and that size."""
    return struct.Struct(f"<{codes}"), struct.calcsize(f"={codes[0]}")


class _Writer:
    """Builds the CDR bytes of a message, its header first; `done` returns them."""

    def __init__(self, header: RosHeader) -> None:
        self._bytes = bytearray()
        seconds, nanoseconds = divmod(header.stamp_ns, _NS_PER_S)
        self.put("iI", seconds, nanoseconds).text(header.frame_id)

    def put(self, codes: str, *values: float) -> "_Writer":
        """Appends primitives of one size."""
        form, size = _form(codes)
        self._bytes += bytes(-len(self._bytes) % size) + form.pack(*values)
        return self

    def text(self, text: str) -> "_Writer":
        """Appends length and bytes of a string, which ends in a zero and has no other."""
        encoded = text.encode(errors="replace").replace(b"\0", b"?") + b"\0"
        self.put("I", len(encoded))
        self._bytes += encoded
        return self

    def doubles(self, values: Sequence[float]) -> "_Writer":
        """Appends a sequence; an empty one is its length alone, without padding."""
        self.put("I", len(values))
        return self.put("d" * len(values), *values) if values else self

    def done(self) -> bytes:
        return _HEAD + self._bytes


def wrench_stamped(header: RosHeader, force_n: float) -> bytes:
    """A force along z of the frame, without a torque."""
    return _Writer(header).put("dddddd", 0.0, 0.0, force_n, 0.0, 0.0, 0.0).done()


def joint_state(header: RosHeader, name: str, position: float, velocity: float | None = None) -> bytes:
    """State of one joint; what is not known is left out, as sensor_msgs asks."""
    writer = _Writer(header).put("I", 1).text(name).doubles((position,))
    return writer.doubles(() if velocity is None else (velocity,)).doubles(()).done()


def operating_state(header: RosHeader, state: str, is_homed: bool, is_busy: bool) -> bytes:
    return _Writer(header).text(state).put("??", is_homed, is_busy).done()


def diagnostic_array(stamp_ns: int, statuses: Iterable[DiagnosticStatus]) -> bytes:
    listed = list(statuses)
    writer = _Writer(RosHeader(stamp_ns, "")).put("I", len(listed))
    for status in listed:
        writer.put("B", status.level).text(status.name).text(status.message).text(status.hardware_id)
        writer.put("I", len(status.values))
        for key, value in status.values:
            writer.text(key).text(value)
    return writer.done()


class _Reader:
    """Reads what `_Writer` writes. CodecError: the bytes end early, or are none of that."""

    def __init__(self, payload: bytes) -> None:
        if payload[:2] != _HEAD[:2] or len(payload) > _MOST_BYTES:
            raise CodecError(f"{len(payload)} bytes are no CDR_LE of at most {_MOST_BYTES}")
        self._bytes, self._at = payload[4:], 0
        self.take("iI")
        self.text()

    def take(self, codes: str) -> tuple[float, ...]:
        """Aligns, then reads the values of struct `codes` of one size. CodecError: the bytes end before."""
        form, size = _form(codes)
        self._at += -self._at % size
        try:
            values = form.unpack_from(self._bytes, self._at)
        except struct.error as error:
            raise CodecError(f"CDR: {error}") from error
        self._at += form.size
        return values

    def length(self) -> int:
        """Length of what follows, which takes a byte an item at least."""
        number = int(self.take("I")[0])
        if number > len(self._bytes) - self._at:
            raise CodecError(f"CDR: {number} items in {len(self._bytes)} bytes")
        return number

    def text(self) -> str:
        end = self.length() + self._at
        encoded, self._at = self._bytes[self._at : end], end
        return encoded.rstrip(b"\0").decode(errors="replace")

    def doubles(self) -> tuple[float, ...]:
        number = self.length()
        return self.take("d" * number) if number else ()


def read_string_stamped(payload: bytes) -> str:
    """The text of a StringStamped. CodecError: the bytes are none."""
    return _Reader(payload).text()


def read_joint_state(payload: bytes) -> tuple[float, float]:
    """Position and velocity of a JointState of one joint, 0 where no velocity is given. CodecError: the bytes
    are none, or of another number of joints.
    """
    reader = _Reader(payload)
    for _ in range(reader.length()):
        reader.text()
    positions, velocities = reader.doubles(), reader.doubles()
    if len(positions) != 1 or len(velocities) > 1:
        raise CodecError(f"JointState of {len(positions)} positions: expected one joint")
    return positions[0], velocities[0] if velocities else 0.0
