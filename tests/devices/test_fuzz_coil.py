"""Whatever comes, the parser of the coil's link goes on, and the next whole frame is found."""

from collections import Counter
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.devices.coil.protocol import MAX_BUFFER, CoilIdentity, CoilParser, encode
from tests.devices.test_coil_frames import COMMAND, IDENTITY, STATE

_VALID = encode(STATE) + encode(COMMAND) + encode(IDENTITY) + encode(STATE)


def check_coil(data: bytes) -> None:
    """No exception, a bounded buffer, and both of two frames that follow but for what was begun before."""
    counters = Counter[str]()
    parser = CoilParser(counters)
    for at in range(0, len(data), 61):
        for frame in parser.feed(data[at : at + 61]):
            again = CoilParser(Counter()).feed(encode(frame))
            assert again == [frame] or isinstance(frame, CoilIdentity)  # longer texts than ours are read
        assert len(parser._buffer) <= MAX_BUFFER
    assert parser.feed(encode(STATE) + encode(COMMAND))[-2:] == [STATE, COMMAND]


def mutated(rng: Random) -> bytes:
    """Random bytes, or frames with bytes changed, left out and put in."""
    if rng.random() < 0.3:
        return rng.randbytes(rng.randrange(700))
    data = bytearray(_VALID)
    for _ in range(rng.randrange(1, 8)):
        at = rng.randrange(len(data))
        match rng.randrange(4):
            case 0:
                data[at] = rng.randrange(256)
            case 1:
                del data[at : at + rng.randrange(20)]
            case 2:
                data[at:at] = rng.randbytes(rng.randrange(20))
            case _:
                data[at:at] = _VALID[rng.randrange(len(_VALID)) :]
    return bytes(data) or b"\0"


@given(st.binary(max_size=1500))
def test_fuzz(data: bytes) -> None:
    check_coil(data)


def test_fuzz_of_frames() -> None:
    rng = Random(5)
    for _ in range(300):
        check_coil(mutated(rng))


@pytest.mark.fuzz
@pytest.mark.timeout(600)
def test_fuzz_in_full() -> None:
    rng = Random(4)
    for _ in range(100_000):
        check_coil(mutated(rng))
