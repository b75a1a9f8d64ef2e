"""Force transducers after CiA 404: objects, units, and the TPDO that carries force and status. Pure.

What is certain, and from where (the profile itself was not at hand):

- Index and type of 6131, and the order of its bytes (prefix in the highest, numerator, denominator, 0): SDO
  bytes in the manual of Baumer's DSRT strain sensor.
- Newton is 21 hex, metre 01, and a prefix is the power of ten in two's complement: CiA DR-303-2, tables 4.1
  and 4.3.
- 6150 is UNSIGNED8; bit 0 not valid, bit 1 positive, bit 2 negative overload, an overload sets bit 0 as well
  (03, 05), all other bits are reserved: manuals of esd's CAN-CBX-Pt100 and CAN-CBX-THERMO. FMS' EMGZ480
  has the same bits in an INTEGER16 that no PDO carries: such a device refuses the mapping, and is refused.

So nothing but 0 is a valid status: a bit that is not in the table is a flaw of its own.
"""

from math import isfinite
from typing import NamedTuple

from forefeel.devices.canopen.cia301 import TPDO1, ObjectEntry, Pdo

PROFILE = 404  # device profile, the lower half of object 1000
PROCESS_VALUE = ObjectEntry(0x6130, 1, "f")
UNIT = ObjectEntry(0x6131, 1, "I")
STATUS = ObjectEntry(0x6150, 1, "B")

NOT_VALID, OVER, UNDER = 1, 2, 4  # bits of 6150, see above
_FLAWS = {NOT_VALID: "not_valid", OVER: "overrange", UNDER: "underrange"}

NEWTON = 0x0021_0000  # 6131 after CiA 303-2: prefix 10^0, numerator 21


def newton_per_unit(code: int) -> float | None:
    """Newtons in the unit; None: it is no unit of force."""
    if code & 0x00FF_FFFF != NEWTON:
        return None
    prefix = code >> 24
    return 10.0 ** (prefix - 256 if prefix > 127 else prefix)


def reading_pdo(node: int) -> Pdo:
    """The first TPDO: process value and status at every SYNC."""
    return Pdo(True, 1, TPDO1 + node, 1, (PROCESS_VALUE, STATUS))


class Measured(NamedTuple):
    """A received TPDO: the process value in the unit of 6131, and the status of 6150."""

    value: float
    status: int

    @property
    def flaws(self) -> tuple[str, ...]:
        """Flaws: `not_valid`, `overrange`, `underrange`, `unknown_status`, `not_a_number`."""
        flaws = [name for bit, name in _FLAWS.items() if self.status & bit]
        if self.status & ~(NOT_VALID | OVER | UNDER):
            flaws.append("unknown_status")
        return (*flaws, *(() if isfinite(self.value) else ("not_a_number",)))


def measured(pdo: Pdo, data: bytes | bytearray) -> Measured | None:
    """Decodes a TPDO; None where it has another length."""
    values = pdo.unpack(data)
    return None if values is None else Measured(values[0], int(values[1]))
