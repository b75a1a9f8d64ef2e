"""Checksums of the wire protocols."""

import binascii


def crc_ccitt_false(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 1021, start FFFF; of "123456789" it is 29B1."""
    return binascii.crc_hqx(data, 0xFFFF)


def _table() -> tuple[int, ...]:
    rows = []
    for byte in range(256):
        value = byte
        for _ in range(8):
            value = value >> 1 ^ (0x8408 if value & 1 else 0)
        rows.append(value)
    return tuple(rows)


_X25 = _table()


def crc_x25(data: bytes) -> int:
    """CRC-16/X-25: polynomial 1021 reflected, start and end FFFF; of "123456789" it is 906E."""
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ _X25[(crc ^ byte) & 0xFF]
    return crc ^ 0xFFFF
