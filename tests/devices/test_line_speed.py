"""Bytes at another baud rate than they were sent: pure, and by the real drivers over a pseudo terminal."""

import os

import pytest

from forefeel.devices.emulation.pty import host_baud, misheard, set_baud

TEXT = b"/1 1 00 get pos:8D\n" * 3


@pytest.mark.parametrize("heard", [112_500, 115_200, 118_000])
def test_a_clock_that_is_a_little_off_does_not_matter(heard: int) -> None:
    assert misheard(TEXT, 115_200, heard) == TEXT


def test_what_a_uart_samples_at_another_rate() -> None:
    assert misheard(b"\xfe", 9600, 4800) == b"\xff"  # start 0, then 0 1 1 1 1 1 1 1
    assert misheard(b"\xff", 9600, 19_200) == b"\xfe"  # the start bit is that and the first one
    # ten times slower a whole byte is shorter than the start bit's first half
    assert misheard(b"\xff", 9600, 960) == b""
    # ten times faster a start bit alone is a byte without a stop bit, which Linux reads as 0
    assert misheard(b"\xff", 9600, 96_000) == b"\x00"


@pytest.mark.parametrize("heard", [300, 9600, 57_600, 230_400, 460_800, 2_000_000])
def test_no_line_survives_another_rate(heard: int) -> None:
    found = misheard(TEXT, 115_200, heard)
    assert b"get" not in found
    assert len(found) <= 10 * len(TEXT) * max(1.0, heard / 115_200)


@pytest.mark.parametrize("baud", [9600, 220_000, 2_000_000])
def test_the_rate_of_a_terminal_is_that_which_was_set(baud: int) -> None:
    master, end = os.openpty()
    try:
        set_baud(end, baud)
        assert host_baud(master) == host_baud(end) == baud
    finally:
        os.close(master)
        os.close(end)
    assert host_baud(end) is None
