"""Writes the checksum of boot2 into an RP2040 image and makes a UF2 file of it: `uf2.py IMAGE.bin IMAGE.uf2`.

The boot ROM starts the first 252 bytes only with their CRC-32 behind them (RP2040 data sheet 2.8.1.3.1:
polynomial 04C11DB7, start FFFFFFFF, not reflected). UF2: blocks of 512 bytes, github.com/microsoft/uf2.
"""

import struct
import sys
from pathlib import Path

BOOT2_BYTES, PAGE_BYTES, FLASH = 252, 256, 0x10000000
FAMILY_RP2040 = 0xE48BFF56


def crc32(data: bytes) -> int:
    """CRC-32/MPEG-2; of "123456789" it is 0376E6E7."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte << 24
        for _ in range(8):
            crc = (crc << 1 ^ (0x04C11DB7 if crc & 0x80000000 else 0)) & 0xFFFFFFFF
    return crc


def uf2(image: bytes) -> bytes:
    pages = [image[at : at + PAGE_BYTES].ljust(PAGE_BYTES, b"\0") for at in range(0, len(image), PAGE_BYTES)]
    blocks = []
    for number, page in enumerate(pages):
        address = FLASH + number * PAGE_BYTES
        head = 0x0A324655, 0x9E5D5157, 0x2000, address, PAGE_BYTES, number, len(pages), FAMILY_RP2040
        blocks.append(struct.pack("<8I", *head) + page.ljust(476, b"\0") + struct.pack("<I", 0x0AB16F30))
    return b"".join(blocks)


if __name__ == "__main__":
    source, target = map(Path, sys.argv[1:])
    boot, rest = source.read_bytes()[:BOOT2_BYTES], source.read_bytes()[PAGE_BYTES:]
    source.write_bytes(boot + struct.pack("<I", crc32(boot)) + rest)
    target.write_bytes(uf2(source.read_bytes()))
