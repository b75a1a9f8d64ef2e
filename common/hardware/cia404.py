"""Force transducers after CiA 404: objects, units, and the TPDO that carries force and status. Pure."""

from math import isfinite
from typing import NamedTuple

from common.hardware.cia301 import TPDO1, Entry, Pdo

PROFILE = 404
SENSOR_TYPE = Entry(0x6110, 1, "H")
OPERATING_MODE = Entry(0x6112, 1, "B")
AUTOZERO = Entry(0x6125, 1, "I")
PROCESS_VALUE = Entry(0x6130, 1, "f")
UNIT = Entry(0x6131, 1, "I")
DIGITS = Entry(0x6132, 1, "B")
STATUS = Entry(0x6150, 1, "B")

ZERO = int.from_bytes(b"zero", "little")
"""What 6125 takes: the device tares itself. Wears its flash, may time out; the product tares in software."""

NOT_VALID, OVER, UNDER = 1, 2, 4
"""Bits of 6150."""

_NEWTON = 0x21  # CiA 303-2
_PREFIX, _NUMERATOR, _DENOMINATOR = 24, 16, 8


def unit_code(prefix: int, numerator: int, denominator: int = 0) -> int:
    """6131 after CiA 303-2: 10^prefix numerator / denominator."""
    return (prefix & 0xFF) << _PREFIX | numerator << _NUMERATOR | denominator << _DENOMINATOR


NEWTON = unit_code(0, _NEWTON)
MICROMETRE_PER_METRE = unit_code(-6, 0x01, 0x01)


def newton_per_unit(code: int) -> float | None:
    """How many N the unit is; None: it is no unit of force."""
    if code & 0x00FF_FFFF != NEWTON:
        return None
    prefix = code >> _PREFIX
    return 10.0 ** (prefix - 256 if prefix > 127 else prefix)


def reading_pdo(node: int, every: int = 1) -> Pdo:
    """The first TPDO: process value and status at every so-and-so-many-th SYNC."""
    return Pdo(True, 1, TPDO1 + node, every, (PROCESS_VALUE, STATUS))


class Measured(NamedTuple):
    """What one TPDO says, in the unit of 6131."""

    value: float
    status: int

    @property
    def valid(self) -> bool:
        """Whether the device believes it, and it is a number."""
        return self.status == 0 and isfinite(self.value)


def measured(pdo: Pdo, data: bytes | bytearray) -> Measured | None:
    """What a TPDO says; None: it has another length."""
    values = pdo.unpack(data)
    return None if values is None else Measured(values[0], int(values[1]))
