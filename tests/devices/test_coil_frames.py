from collections import Counter
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.messages import SafetyState
from forefeel.devices.coil.protocol import (
    MAX_BUFFER,
    Button,
    CoilCommand,
    CoilIdentity,
    CoilParser,
    CoilState,
    Flag,
    Frame,
    Identify,
    encode,
)

STATE = CoilState(65_535, 4_294_967_295, -123_456, 58_000, Button.DEADMAN, Flag.NOT_HOMED, -1500)
COMMAND = CoilCommand(258, -1500, SafetyState.ARMED, 12_300, True)
IDENTITY = CoilIdentity(2, 20, 1000, 1000, 1500, 2_000_000, "forefeel-coil", "A17", "2.0")

# made by other programs: bit by bit from the definitions of COBS and CRC-16/CCITT-FALSE; by firmware/handle
GOLDEN: list[tuple[Frame, str]] = [
    (STATE, "000e01ffffffffffffc01dfeff90e20107010824fac28f00"),
    (COMMAND, "000902020124fa040c30010401845800"),
    (Identify(2, 20, 2000), "000403021405d007e53000"),
    (IDENTITY, "00040402140ae803e803dc0580841e190d666f72656665656c2d636f696c0341313703322e308ca800"),
]


@pytest.mark.parametrize(("frame", "wire"), GOLDEN)
def test_golden_frames(frame: Frame, wire: str) -> None:
    assert encode(frame).hex() == wire
    assert CoilParser(Counter()).feed(bytes.fromhex(wire)) == [frame]


def test_an_unknown_place_a_dark_lamp_and_texts_that_are_too_long() -> None:
    parser = CoilParser(Counter())
    dark = CoilCommand(1, 0, None, None, False)
    long = IDENTITY._replace(name="x" * 40, serial="é", firmware="")
    assert parser.feed(encode(dark) + encode(long)) == [
        dark,
        long._replace(name="x" * 32, serial="?"),
    ]


def test_numbers_that_do_not_fit_are_clamped() -> None:
    (found,) = CoilParser(Counter()).feed(encode(COMMAND._replace(current_ma=40_000, stage_um=-(2**40))))
    assert found == COMMAND._replace(current_ma=32_767, stage_um=-(2**31) + 1)


@given(st.lists(st.integers(1, 30), min_size=1), st.integers(0, 2**32))
def test_frames_survive_any_split(sizes: list[int], seed: int) -> None:
    counters = Counter[str]()
    parser, rng = CoilParser(counters), Random(seed)
    sent = [STATE._replace(sequence=i, counts=rng.randrange(-(2**31) + 1, 2**31)) for i in range(20)]
    stream = b"".join(map(encode, sent))
    found, at = list[Frame](), 0
    while at < len(stream):
        size = sizes[at % len(sizes)]
        found += parser.feed(stream[at : at + size])
        at += size
    assert found == sent
    assert not +counters


def test_one_byte_that_is_wrong_anywhere_costs_exactly_one_frame() -> None:
    """The delimiters included, and a byte that becomes a delimiter."""
    sent = [STATE._replace(sequence=i) for i in range(3)]
    wires = [encode(frame) for frame in sent]
    for at in range(len(wires[1])):
        for wrong in {0x00, 0x01, 0x55, 0xFF, wires[1][at] ^ 0x80} - {wires[1][at]}:
            counters = Counter[str]()
            broken = bytearray(wires[1])
            broken[at] = wrong
            found = CoilParser(counters).feed(wires[0] + bytes(broken) + wires[2])
            assert found == [sent[0], sent[2]]
            assert sum(counters.values()) >= 1


@pytest.mark.parametrize("length", [MAX_BUFFER + 1, 5000])
def test_noise_without_an_end_is_not_kept_and_costs_no_frame_after_it(length: int) -> None:
    counters = Counter[str]()
    parser = CoilParser(counters)
    for _ in range(length):
        assert parser.feed(b"\x07") == []
        assert len(parser._buffer) <= MAX_BUFFER
    assert parser.feed(encode(STATE)) == [STATE]
    assert counters == {"oversized": 1}


def test_a_frame_of_another_length_or_kind_is_counted_though_its_checksum_is_right() -> None:
    from cobs import cobs

    from forefeel.devices.coil.protocol import crc_ccitt_false

    counters = Counter[str]()
    parser = CoilParser(counters)
    for payload in (
        b"\x01abc",
        b"\x09",
        b"\x02" + bytes(9),
        b"\x04\x01\x14\x00\xd0\x07\xff",
        b"\x02\0\0\0\0\x63" + bytes(5),
    ):
        wire = cobs.encode(payload + crc_ccitt_false(payload).to_bytes(2, "little")) + b"\0"
        assert parser.feed(wire) == []
    assert counters == {"unknown_frame": 5}
