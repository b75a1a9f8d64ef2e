"""The Bota stream: the published layout, damage, resynchronisation."""

from math import inf, nan
from random import Random

import pytest

from forefeel.devices.bota.protocol import FRAME_BYTES, BotaFrame, BotaParser, encode

GOLDEN = bytes.fromhex(
    "aa"  # header
    "0200"  # status: overrange
    "0000803f" "000000c0" "0000003f"  # forces 1, -2, 0.5 N
    "0000803e" "00000000" "000080bf"  # torques 0.25, 0, -1 N m
    "04030201"  # 0x01020304 us
    "0000c841"  # 25 degrees
    "ae5b"  # CRC-16/X-25, low byte first
)  # fmt: skip
FRAME = BotaFrame(2, 1.0, -2.0, 0.5, 0.25, 0.0, -1.0, 0x01020304, 25.0)


def crc_by_bits(data: bytes) -> int:
    """CRC-16/X-25 as the catalogue defines it: reflected 1021, start and end FFFF."""
    crc = 0xFFFF
    for byte in data:
        for bit in range(8):
            odd = (crc ^ byte >> bit) & 1
            crc = crc >> 1 ^ (0x8408 if odd else 0)
    return crc ^ 0xFFFF


def frames(count: int) -> list[BotaFrame]:
    random = Random(5)
    return [
        FRAME._replace(status=0, fz_n=random.randrange(-999, 999) / 8, t_us=n * 1250) for n in range(count)
    ]


def test_the_published_layout() -> None:
    assert crc_by_bits(b"123456789") == 0x906E
    assert len(GOLDEN) == FRAME_BYTES == 37
    assert int.from_bytes(GOLDEN[-2:], "little") == crc_by_bits(GOLDEN[1:-2])
    assert encode(FRAME) == GOLDEN
    assert BotaParser().feed(GOLDEN) == [FRAME]


def test_frames_cut_anywhere_come_whole() -> None:
    stream = b"".join(map(encode, frames(20)))
    for size in (1, 2, 36, 37, 38, 100):
        parser = BotaParser()
        got = [each for at in range(0, len(stream), size) for each in parser.feed(stream[at : at + size])]
        assert got == frames(20)
        assert parser.counters == {"frames": 20, "resynchronised": 0}


@pytest.mark.parametrize("at", range(FRAME_BYTES))
def test_one_damaged_byte_costs_one_frame(at: int) -> None:
    sent = frames(3)
    stream = bytearray(b"".join(map(encode, sent)))
    stream[FRAME_BYTES + at] ^= 0xAA if at else 0x01  # also makes a header where a zero was
    parser = BotaParser()
    assert parser.feed(bytes(stream)) == [sent[0], sent[2]]
    assert parser.counters["junk_bytes"] == FRAME_BYTES
    assert parser.counters["resynchronised"] == 1


def test_it_begins_in_the_middle_of_a_frame_and_of_headers() -> None:
    sent = frames(2)
    parser = BotaParser()
    stream = b"\xaa" * 500 + encode(sent[0])[11:] + encode(sent[0]) + encode(sent[1])
    assert parser.feed(stream) == sent
    assert parser.counters["junk_bytes"] == 500 + 26
    assert parser.counters["bad_checksum"] >= 500


def test_a_dropped_byte_costs_one_frame() -> None:
    sent = frames(4)
    whole = [encode(each) for each in sent]
    parser = BotaParser()
    assert parser.feed(whole[0] + whole[1][:20] + whole[1][21:] + whole[2] + whole[3]) == [sent[0], *sent[2:]]


def test_what_is_no_measurement() -> None:
    good = FRAME._replace(status=0)
    assert good.valid
    assert good._replace(status=0xFFF0).valid, "reserved bits mean nothing"
    for bit, name in enumerate(("app_took_too_long", "overrange", "invalid", "raw")):
        flawed = good._replace(status=1 << bit)
        assert not flawed.valid
        assert flawed.flags == (name,)
    for number in (nan, inf, -inf):
        for bad in (
            good._replace(fx_n=number),
            good._replace(mz_n_m=number),
            good._replace(temperature_c=number),
        ):
            (got,) = BotaParser().feed(encode(bad))
            assert not got.finite
            assert not got.valid
