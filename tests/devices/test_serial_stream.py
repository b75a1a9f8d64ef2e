"""Writing to a serial port that takes its time: a pty with a full buffer."""

import os
import select
from collections.abc import Iterator
from threading import Event, Thread

import pytest

from forefeel.common.errors import DeviceError
from forefeel.devices.shared import stream as streams
from forefeel.devices.shared.settings import SerialSettings
from forefeel.devices.shared.stream import SerialStream

SENT = b"\x55" * 30_000


@pytest.fixture
def line() -> Iterator[tuple[int, SerialStream]]:
    """The other end, and the port."""
    other, end = os.openpty()
    stream = SerialStream(SerialSettings(port=os.ttyname(end), baud=115200))
    yield other, stream
    stream.close()
    os.close(other)
    os.close(end)


class SlowReader:
    """Takes half a kilobyte each 20 ms; ended before its descriptor may become another's."""

    def __init__(self, number: int) -> None:
        self.found, self._number, self._ended = bytearray(), number, Event()
        self._thread = Thread(target=self._run)

    def __enter__(self) -> "SlowReader":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ended.wait(0.02):
            if select.select([self._number], [], [], 0)[0]:
                self.found += os.read(self._number, 512)

    def wait_for(self, count: int) -> None:
        """At most 10 s."""
        for _ in range(1000):
            if len(self.found) >= count or self._ended.wait(0.01):
                return


def test_what_goes_on_is_no_failure_however_long_it_takes(line: tuple[int, SerialStream]) -> None:
    """In all it takes more than a second, twice what a port may take nothing at all."""
    other, stream = line
    with SlowReader(other) as reader:
        stream.write(SENT)
        reader.wait_for(len(SENT))
    assert bytes(reader.found) == SENT


def test_a_port_that_takes_nothing_is_said(
    line: tuple[int, SerialStream], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(streams, "_WRITE_S", 0.05)
    _, stream = line
    with pytest.raises(DeviceError, match=r"takes no bytes for 0\.05 s"):
        stream.write(b"\x55" * 1_000_000)


def test_a_closed_port_is_said(line: tuple[int, SerialStream]) -> None:
    _, stream = line
    stream.close()
    with pytest.raises(DeviceError, match="gone while writing"):
        stream.write(b"\x55")
