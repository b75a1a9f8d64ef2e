"""Any bytes into every parser: no exception, bounded buffers, and what follows is found."""

from collections import Counter
from collections.abc import Callable
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.devices.ascii_line.protocol import COUNTS_RANGE, LineParser, Unit, encode_line
from forefeel.devices.bota.protocol import FRAME_BYTES, BotaFrame, BotaParser
from forefeel.devices.bota.protocol import encode as encode_bota
from forefeel.devices.canopen.hub import SlcanAdapter
from forefeel.devices.coil.protocol import MAX_BUFFER, CoilIdentity, CoilParser, Frame
from forefeel.devices.coil.protocol import encode as encode_coil
from forefeel.devices.zaber.emulator import ZaberDevice
from forefeel.devices.zaber.protocol import CommandEncoder, Parser
from tests.devices.test_coil_frames import COMMAND, IDENTITY, STATE
from tests.devices.test_slcan import MemoryPort, bus_on, received
from tests.devices.test_zaber_protocol import line, reply

_A = BotaFrame(0, 1.0, 2.0, 3.0, 0.5, 0.25, 0.125, 1000, 25.0)
_B = _A._replace(fz_n=-3.0, t_us=2250)
_UNITS: tuple[Unit, ...] = ("newton", "millipound_force", "counts")
_SLCAN = b"t1856000102030405\rt0050\rT18DAF1108FFFFFFFFFFFFFFFF\r"
_SLCAN_FRAMES = [(0x185, bytes(range(6))), (0x5, b""), (0x18DAF110, b"\xff" * 8)]


def check_bota(data: bytes) -> None:
    """Two frames behind any bytes are found, both of them."""
    parser = BotaParser()
    cut = len(data) // 3
    in_data = parser.feed(data[:cut]) + parser.feed(data[cut:])
    assert len(parser._buffer) < FRAME_BYTES
    assert parser.feed(encode_bota(_A) + encode_bota(_B)) == [_A, _B]
    assert not parser._buffer
    total = len(data) + 2 * FRAME_BYTES
    assert parser.counters["junk_bytes"] + FRAME_BYTES * parser.counters["frames"] == total
    at_once = BotaParser().feed(data + encode_bota(_A) + encode_bota(_B))
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


def check_coil(data: bytes) -> None:
    """Both of two frames that follow are found, but for what was begun before."""
    parser = CoilParser(Counter())
    for at in range(0, len(data), 61):
        for frame in parser.feed(data[at : at + 61]):
            again = CoilParser(Counter()).feed(encode_coil(frame))
            assert again == [frame] or isinstance(frame, CoilIdentity)  # longer texts than ours are read
        assert len(parser._buffer) <= MAX_BUFFER
    assert parser.feed(encode_coil(STATE) + encode_coil(COMMAND))[-2:] == [STATE, COMMAND]


def check_zaber(data: bytes) -> None:
    """The line after it is heard, with checksums and without; the emulated stage answers the next command."""
    for checksums in (True, False):
        parser = Parser(checksums)
        parser.feed(data)
        assert len(parser._partial) <= 256
        assert parser.feed(b"\r\n" + line(42, "4242"))[-1] == reply(42, "4242")
    device = ZaberDevice()
    device.receive(data, 0.0)
    device.advance(0.01)
    device.receive(b"\n" + CommandEncoder(1).encode(1, "get accel")[1], 0.011)
    answer = device.advance(0.012)
    assert answer.endswith(b"\r\n") and answer.splitlines()[-1].startswith(b"@01 1 00 OK")


def check_slcan(data: bytes) -> None:
    """Frames are valid, what follows is delivered, and the emulated adapter goes on."""
    port = MemoryPort()
    bus, cut = bus_on(port), len(data) // 2
    for can_id, frame in received(port, bus, data[:cut], data[cut:]):
        assert len(frame) <= 8 and can_id <= 0x1FFFFFFF
    assert len(bus._lines._rest) <= 64
    assert received(port, bus, b"\r" + _SLCAN)[-len(_SLCAN_FRAMES) :] == _SLCAN_FRAMES
    bus.shutdown()
    adapter = SlcanAdapter()
    adapter.receive(data)
    adapter.receive(b"\rC\rS8\rO\r")
    assert adapter.open
    assert len(adapter.receive(_SLCAN)[0]) == len(_SLCAN_FRAMES)


def _bota(random: Random) -> bytes:
    frames = [
        _A._replace(status=random.getrandbits(16), fz_n=random.gauss(0, 9), t_us=random.getrandbits(32))
        for _ in range(random.randrange(1, 5))
    ]
    return b"".join(map(encode_bota, frames))


def _lines(random: Random) -> bytes:
    return b"".join(encode_line(random.uniform(*COUNTS_RANGE), random.choice(_UNITS)) for _ in range(6))


def _zaber(random: Random) -> bytes:
    encoder = CommandEncoder(1)
    words = "get pos", "move abs 100", "home", "set accel 1", "warnings", "stop", ""
    lines = [line(n, str(random.randrange(10**6))) for n in range(3)]
    lines += [encoder.encode(1, random.choice(words))[1] for _ in range(3)]
    random.shuffle(lines)
    return b"".join(lines)


def _coil(random: Random) -> bytes:
    frames: list[Frame] = [STATE, COMMAND, IDENTITY]
    return b"".join(encode_coil(random.choice(frames)) for _ in range(4))


CASES: list[tuple[Callable[[bytes], None], Callable[[Random], bytes]]] = [
    (check_bota, _bota), (check_lines, _lines), (check_coil, _coil), (check_zaber, _zaber),
    (check_slcan, lambda _: _SLCAN),
]  # fmt: skip
EVERY = pytest.mark.parametrize(("check", "valid"), CASES, ids=[check.__name__ for check, _ in CASES])


def mutated(random: Random, valid: bytes) -> bytes:
    """Noise, or a valid stream with bytes changed, left out, put in, repeated and turned round."""
    if random.random() < 0.2:
        return random.randbytes(random.randrange(700))
    data = bytearray(valid)
    for _ in range(random.randrange(1, 8)):
        at, end = sorted((random.randrange(len(data)), random.randrange(len(data))))
        match random.randrange(5):
            case 0:
                data[at] = random.randrange(256)
            case 1:
                del data[at : at + random.randrange(1, 20)]
            case 2:
                data[at:at] = random.choice([b"\r", b"t", b"\x07", b"\0", b"@", b"\xaa", random.randbytes(9)])
            case 3:
                data[at:at] = data[at:end]
            case _:
                data[at:end] = data[at:end][::-1]
        data = data or bytearray(b"\xaa")
    return bytes(data)


@EVERY
@given(data=st.binary(max_size=1000))
def test_any_bytes(check: Callable[[bytes], None], valid: object, data: bytes) -> None:
    check(data)


def run(check: Callable[[bytes], None], valid: Callable[[Random], bytes], seed: int, count: int) -> None:
    random = Random(seed)
    for _ in range(count):
        check(mutated(random, valid(random)))


@EVERY
def test_mutations(check: Callable[[bytes], None], valid: Callable[[Random], bytes]) -> None:
    run(check, valid, 11, 300)


@pytest.mark.fuzz
@pytest.mark.timeout(900)
@EVERY
def test_100_000_byte_strings(check: Callable[[bytes], None], valid: Callable[[Random], bytes]) -> None:
    run(check, valid, 12, 100_000)
