"""CiA 404: units, PDOs, and the published SDO bytes answered by our transducer."""

import math

import pytest

from forefeel.devices.cia404 import protocol as cia404
from tests.devices.can_rig import CELL

STRAIN = 0xFA010100  # micrometres per metre


def test_unit_has_the_published_bytes() -> None:
    """Of a Baumer DST strain sensor, from its CANopen manual."""
    assert cia404.UNIT.pack(STRAIN) == bytes.fromhex("00 01 01 FA")


@pytest.mark.parametrize(
    ("code", "newton"),
    [(0x00210000, 1.0), (0x03210000, 1e3), (0xFD210000, 1e-3), (0x00220000, None), (0xFA010100, None)],
)
def test_units_of_force(code: int, newton: float | None) -> None:
    assert cia404.newton_per_unit(code) == (None if newton is None else pytest.approx(newton))


def test_what_can_not_be_a_reading() -> None:
    pdo = cia404.reading_pdo(CELL)
    assert cia404.measured(pdo, bytes(4)) is None
    for status in range(1, 256):
        assert cia404.Measured(1.0, status).flaws
    assert not cia404.Measured(1.0, 0).flaws
    assert cia404.Measured(1.0, 3).flaws == ("not_valid", "overrange")
    assert cia404.Measured(-1.0, 5).flaws == ("not_valid", "underrange")
    assert cia404.Measured(1.0, 0x48).flaws == ("unknown_status",)
    nan = cia404.measured(pdo, cia404.PROCESS_VALUE.pack(math.nan) + b"\0")
    assert nan is not None
    assert nan.flaws == ("not_a_number",)
