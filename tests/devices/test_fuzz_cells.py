"""Any bytes: no exception, bounded buffers, resynchronised within one frame."""

from collections.abc import Callable
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.devices.ascii_line.protocol import COUNTS_RANGE, LineParser, Unit, encode_line
from forefeel.devices.bota.protocol import FRAME_BYTES, BotaFrame, BotaParser, encode

_A = BotaFrame(0, 1.0, 2.0, 3.0, 0.5, 0.25, 0.125, 1000, 25.0)
_B = _A._replace(fz_n=-3.0, t_us=2250)
_UNITS: tuple[Unit, ...] = ("newton", "millipound_force", "counts")
_CASES = 100_000


def check_bota(data: bytes) -> None:
    """Two frames behind any bytes are found, both of them."""
    parser = BotaParser()
    cut = len(data) // 3
    in_data = parser.feed(data[:cut]) + parser.feed(data[cut:])
    assert len(parser._buffer) < FRAME_BYTES
    assert parser.feed(encode(_A) + encode(_B)) == [_A, _B]
    assert not parser._buffer
    total = len(data) + 2 * FRAME_BYTES
    assert parser.counters["junk_bytes"] + FRAME_BYTES * parser.counters["frames"] == total
    at_once = BotaParser().feed(data + encode(_A) + encode(_B))
    assert repr(at_once) == repr([*in_data, _A, _B]), "how it was cut does not matter"


def check_lines(data: bytes) -> None:
    """Behind the next line end the next line is found."""
    for unit in _UNITS:
        parser = LineParser(unit)
        cut = len(data) // 3
        got = parser.feed(data[:cut]) + parser.feed(data[cut:])
        assert len(parser._buffer) <= 64
        assert all(abs(each.number) < 1e12 for each in got)
        got += parser.feed(b"\r\n")
        assert [each.number for each in parser.feed(encode_line(1234.0, unit))] == [1234.0]
        assert parser.counters["lines"] == len(got) + 1


CHECKS = pytest.mark.parametrize("check", [check_bota, check_lines])


def _mutated(random: Random) -> bytes:
    """A valid stream that was cut, glued, flipped and repeated; or plain noise."""
    if random.random() < 0.2:
        return random.randbytes(random.randrange(120))
    parts = []
    for _ in range(random.randrange(1, 5)):
        frame = _A._replace(
            status=random.randrange(1 << 16), fz_n=random.gauss(0, 9), t_us=random.getrandbits(32)
        )
        low, high = COUNTS_RANGE
        lines = encode_line(random.uniform(low, high), random.choice(_UNITS)) * 3
        part = bytearray(encode(frame) if random.random() < 0.6 else lines)
        for _ in range(random.randrange(4)):
            at = random.randrange(len(part))
            part[at : at + random.randrange(2)] = random.randbytes(random.randrange(3))
            if not part:
                part = bytearray(b"\xaa")
        parts.append(bytes(part[random.randrange(len(part)) if random.random() < 0.2 else 0 :]))
    return b"".join(parts)


@CHECKS
@given(
    st.lists(st.one_of(st.binary(max_size=60), st.just(encode(_A)), st.just(b"\xaa"), st.just(b"1.25\r\n")))
)
def test_quick(check: Callable[[bytes], None], parts: list[bytes]) -> None:
    check(b"".join(parts))


@CHECKS
def test_mutations(check: Callable[[bytes], None]) -> None:
    random = Random(11)
    for _ in range(300):
        check(_mutated(random))


@pytest.mark.fuzz
@pytest.mark.timeout(900)
@CHECKS
def test_full(check: Callable[[bytes], None]) -> None:
    random = Random(12)
    for _ in range(_CASES):
        check(_mutated(random))
