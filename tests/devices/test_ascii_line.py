"""Lines of numbers: which are believed, what is counted."""

import pytest

from forefeel.devices.ascii_line.protocol import LineParser, Unit, encode_line, parse_line


def numbers(parser: LineParser, data: bytes) -> list[float]:
    return [line.number for line in parser.feed(data)]


def begun(unit: Unit = "newton") -> LineParser:
    parser = LineParser(unit)
    parser.begin()
    return parser


@pytest.mark.parametrize(
    ("line", "unit", "number"),
    [
        (b"1.25", "newton", 1.25),
        (b" -0.5 N ", "newton", -0.5),
        (b"+3", "newton", 3.0),
        (b"2345", "millipound_force", 2345.0),
        (b"HX711 reading: 8400", "counts", 8400.0),
        (b"-8388608", "counts", -8388608.0),
        (b"12 N", "counts", None),
        (b"1.2.3", "newton", None),
        (b"1.2 1.3", "newton", None),
        (b"one reading:\t1.2\t| average:\t1.1", "counts", None),
        (b"nan", "newton", None),
        (b"inf", "newton", None),
        (b"1e5", "newton", None),
        (b"A", "millipound_force", None),
        (b"1234567890123", "counts", None),
        ("１２".encode(), "newton", None),
        (b"\xff12", "newton", None),
    ],
)
def test_lines(line: bytes, unit: Unit, number: float | None) -> None:
    assert parse_line(line, unit) == number


def test_the_first_line_is_cut_and_dropped() -> None:
    parser = LineParser("newton")
    assert numbers(parser, b"5\r\n1.5\r\n2.5\r") == [1.5, 2.5]
    assert parser.counters == {"junk_lines": 1, "junk_bytes": 1, "lines": 2}


def test_lines_cut_anywhere_come_whole() -> None:
    stream = b"".join(encode_line(each / 8, "newton") for each in range(50))
    for size in (1, 2, 7, 8, 64):
        parser = begun()
        got = [each for at in range(0, len(stream), size) for each in numbers(parser, stream[at : at + size])]
        assert got == [each / 8 for each in range(50)]
        assert parser.counters["junk_lines"] == 0


def test_an_endless_line_is_bounded_and_counted() -> None:
    parser = begun()
    for _ in range(1000):
        assert parser.feed(b"1" * 50) == []
        assert len(parser._buffer) <= 64
    assert numbers(parser, b"1\r\n2.5\r\n") == [2.5]
    assert parser.counters["junk_bytes"] == 50_001


def test_two_lines_that_lost_their_end_are_no_number() -> None:
    parser = begun()
    assert numbers(parser, b"12.50001.2500\r\n3.0000\r\n") == [3.0]
    assert parser.counters["junk_lines"] == 1
