"""Whatever comes, the parser and the emulated stage go on, and the next whole line is heard."""

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.devices.zaber.emulator import ZaberDevice
from forefeel.devices.zaber.protocol import CommandEncoder, Parser, Reply
from tests.devices.test_zaber_protocol import line, reply

_SENTINEL = b"\r\n" + line(42, "4242")


def check_zaber(data: bytes) -> None:
    """No exception, a bounded buffer, and the line after it is heard; with checksums and without."""
    for checksums in (True, False):
        parser = Parser(checksums)
        parser.feed(data)
        assert len(parser._partial) <= 256
        assert parser.feed(_SENTINEL)[-1] == reply(42, "4242")


def check_zaber_device(data: bytes) -> None:
    """No exception; the emulated stage answers the next command."""
    device = ZaberDevice()
    device.receive(data, 0.0)
    device.advance(0.01)
    device.receive(b"\n" + CommandEncoder(1).encode(1, "get accel")[1], 0.011)
    answer = device.advance(0.012)
    assert answer.endswith(b"\r\n") and answer.splitlines()[-1].startswith(b"@01 1 00 OK")


def mutated(random: Random) -> bytes:
    """Valid lines of both directions, some bytes of them dropped, changed, repeated or swapped; or noise."""
    if random.random() < 0.2:
        return random.randbytes(random.randrange(600))
    encoder, words = (
        CommandEncoder(1),
        ("get pos", "move abs 100", "home", "set comm.alert 1", "warnings", "stop", ""),
    )
    lines = [line(n, str(random.randrange(10**6))) for n in range(3)]
    lines += [encoder.encode(1, random.choice(words))[1] for _ in range(3)]
    random.shuffle(lines)
    data = bytearray(b"".join(lines))
    for _ in range(random.randrange(1, 6)):
        at, end = sorted((random.randrange(len(data)), random.randrange(len(data))))
        match random.randrange(4):
            case 0:
                del data[at : at + random.randrange(1, 8)]
            case 1:
                data[at] = random.randrange(256)
            case 2:
                data[at:at] = data[at:end]
            case _:
                data[at:end] = data[at:end][::-1]
        data = data or bytearray(b"@")
    return bytes(data)


@given(st.binary(max_size=600))
def test_any_bytes(data: bytes) -> None:
    check_zaber(data)
    check_zaber_device(data)


@given(st.randoms(use_true_random=False))
def test_mutations(random: Random) -> None:
    data = mutated(random)
    check_zaber(data)
    check_zaber_device(data)


@pytest.mark.fuzz
@pytest.mark.timeout(600)
def test_100_000_byte_strings() -> None:
    random = Random(5)
    for _ in range(100_000):
        data = mutated(random)
        check_zaber(data)
        check_zaber_device(data)


def test_the_checks_would_notice() -> None:
    parser = Parser()
    found = parser.feed(_SENTINEL.replace(b"4242", b"4243"))
    assert not any(isinstance(each, Reply) for each in found)
