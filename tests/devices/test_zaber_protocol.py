"""Bytes of the Zaber ASCII protocol. Golden lines: the vendor's examples, and what its own library sent."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.devices.zaber.protocol import (
    WARNINGS,
    CommandEncoder,
    Parser,
    Reply,
    is_fault,
    lrc,
    parse,
)

# recorded from zaber-motion 10.2 on a raw terminal; the first is the example of zproto's own test
GOLDEN = [
    b"/01 tools echo:8F",
    b"/1 1 00 get pos:2C",
    b"/1 1 01 home:34",
    b"/1 1 02:FC",
    b"/1 1 03 move abs 1000:ED",
    b"/1 1 08 move vel 1000:D7",
    b"/1 1 11 stop:16",
    b"/1 1 16 warnings:6E",
]


def framed(body: bytes) -> bytes:
    return body + b":%02X" % lrc(body[1:]) + b"\r\n"


def reply(number: int, data: str = "0") -> Reply:
    return Reply(1, 1, number % 100, True, True, "", data)


def line(number: int, data: str = "0") -> bytes:
    return framed(f"@01 1 {number % 100:02d} OK BUSY -- {data}".encode())


@pytest.mark.parametrize("golden", GOLDEN)
def test_checksum_of_lines_that_others_made(golden: bytes) -> None:
    body, _, checksum = golden.rpartition(b":")
    assert lrc(body[1:]) == int(checksum, 16)


def test_commands_are_those_of_the_design_and_of_the_vendors_library() -> None:
    encoder = CommandEncoder(1)
    assert encoder.encode(1, "home") == (0, b"/1 1 00 home:35\n")
    assert encoder.encode(1, "home") == (1, b"/1 1 01 home:34\n")
    assert encoder.encode(1, "") == (2, b"/1 1 02:FC\n")
    assert encoder.encode(1, "move abs 1000") == (3, b"/1 1 03 move abs 1000:ED\n")


def test_ids_roll_over() -> None:
    encoder = CommandEncoder(7)
    ids = [encoder.encode(0, "get pos")[0] for _ in range(201)]
    assert ids[99:102] == [99, 0, 1] and len(set(ids)) == 100


@given(st.integers(-(10**9), 10**9), st.integers(0, 99), st.integers(1, 99))
def test_a_number_whose_colon_is_damaged_is_no_longer_number(goal: int, skipped: int, device: int) -> None:
    encoder = CommandEncoder(device)
    for _ in range(skipped):
        encoder.encode(1, "")
    _, sent = encoder.encode(1, f"move abs {goal}")
    text = sent.decode()
    for damage in "0123456789", ("",):
        for other in damage:
            *_, number = text.rstrip().replace(":", other).split(" ")
            assert not number.lstrip("-").isdigit()


def test_replies_are_read_and_alerts_are_noise() -> None:
    parser = Parser()
    sent = [
        framed(b"@01 1 07 OK BUSY -- 0"),
        framed(b"@02 0 RJ IDLE WR BADDATA"),
        framed(b"!01 1 IDLE FS"),
    ]
    assert parser.feed(b"".join(sent)) == [
        Reply(1, 1, 7, True, True, "", "0"),
        Reply(2, 0, None, False, False, "WR", "BADDATA"),
    ]
    assert set(parser.dropped) == {"noise"}


def test_a_missing_checksum_is_accepted_only_where_that_is_asked_for_and_a_wrong_one_never() -> None:
    bare = b"@01 1 07 OK BUSY -- 1000"
    assert parse(bare, checksums=True) == "bad_checksum"
    assert isinstance(parse(bare, checksums=False), Reply)
    for checksums in (True, False):
        assert parse(framed(bare).strip().replace(b"1000", b"9000"), checksums) == "bad_checksum"


@given(st.integers(0, 10**9), st.data())
def test_no_damaged_byte_gives_another_reply(position: int, data: st.DataObject) -> None:
    whole = line(5, str(position))
    at = data.draw(st.integers(0, len(whole) - 1))
    byte = data.draw(st.integers(0, 255).filter(lambda b: b != whole[at]))
    found = Parser().feed(whole[:at] + bytes([byte]) + whole[at + 1 :] + b"\n")
    assert found in ([], [reply(5, str(position))])


@given(st.lists(st.integers(1, 9), max_size=30))
def test_bytes_come_in_any_pieces(cuts: list[int]) -> None:
    parser, stream = Parser(), b"".join(line(number) for number in range(5))
    found: list[Reply] = []
    for cut in [*cuts, len(stream)]:
        found += parser.feed(stream[:cut])
        stream = stream[cut:]
    assert found == [reply(number) for number in range(5)]


@pytest.mark.parametrize(
    ("noise", "reason", "lost"),
    [
        (b"\xff\x00garbage", "noise", 0),
        (b"garbage\n", "noise", 0),
        (b"@01 1 99 OK ID", "bad_checksum", 0),
        (b"@01 1 99 OK IDLE -- 1:00\r\n", "bad_checksum", 0),
        (framed(b"@01 1 99 OKAY IDLE -- 1"), "malformed", 0),
        (b"@" + b"0" * 300, "overlong", 1),
        (b"@" + b"0" * 300 + b"\r\n", "overlong", 0),
    ],
)
def test_what_is_dropped_is_counted_and_the_next_line_is_heard(noise: bytes, reason: str, lost: int) -> None:
    parser = Parser()
    found = parser.feed(noise) + parser.feed(line(1)) + parser.feed(line(2))
    assert found == [reply(number) for number in (1, 2)][lost and 1 - lost :]
    assert set(parser.dropped) >= {reason}


@pytest.mark.parametrize("flag", WARNINGS)
def test_faults_are_what_forbids_motion(flag: str) -> None:
    harmless = {"WV", "WT", "WS", "WM", "WP", "NI"}
    assert is_fault(flag) is (flag not in harmless)
