"""Any bytes into python-can's slcan on our port, and into the emulated adapter."""

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.devices.canopen.hub import SlcanAdapter
from tests.devices.test_slcan import MemoryPort, bus_on, received

STREAM = b"t1856000102030405\rt0050\rT18DAF1108FFFFFFFFFFFFFFFF\r"
GOOD = [(0x185, bytes(range(6))), (0x5, b""), (0x18DAF110, b"\xff" * 8)]


def check_slcan(data: bytes) -> None:
    """Nothing raises, memory is bounded, frames are valid, and what follows is delivered."""
    port = MemoryPort()
    bus, cut = bus_on(port), len(data) // 2
    for can_id, frame in received(port, bus, data[:cut], data[cut:]):
        assert len(frame) <= 8 and can_id <= 0x1FFFFFFF
    assert len(bus._lines._rest) <= 64
    assert received(port, bus, b"\r" + STREAM)[-len(GOOD) :] == GOOD
    bus.shutdown()
    adapter = SlcanAdapter(1_000_000)
    adapter.receive(data)
    adapter.receive(b"\rC\rS8\rO\r")
    assert adapter.open
    assert len(adapter.receive(STREAM)[0]) == len(GOOD)


@given(st.binary(max_size=200))
def test_any_bytes(data: bytes) -> None:
    check_slcan(data)


@given(st.integers(0, 2**32))
def test_damaged_streams(seed: int) -> None:
    check_slcan(mutated(Random(seed)))


@pytest.mark.fuzz
def test_100_000_byte_strings() -> None:
    random = Random(5)
    for i in range(100_000):
        check_slcan(random.randbytes(random.randrange(80)) if i % 2 else mutated(random))


def mutated(random: Random) -> bytes:
    """A valid stream with some bytes changed, lost, doubled."""
    data = bytearray(STREAM)
    for _ in range(random.randrange(1, 6)):
        at = random.randrange(len(data))
        what = random.randrange(4)
        if what == 0:
            data[at] = random.randrange(256)
        elif what == 1:
            del data[at : at + random.randrange(1, 8)]
        elif what == 2:
            data[at:at] = random.choice([b"\r", b"t", b"T1", b"\x07", b"\xff", b"9"])
        else:
            data[at:at] = data[: random.randrange(20)]
        data = data or bytearray(b"t")
    return bytes(data)
