"""A handle that another program moves: the deadman is the stream of its positions."""

import socket
import stat
from collections.abc import Iterator
from math import inf, nan
from pathlib import Path

import pytest

from forefeel.common.errors import DeviceSetupError
from forefeel.devices.servo.driver import POSITION, ServoHandle
from forefeel.master.handle import HandleReading

MS = 1_000_000


class Bench:
    """The handle at 1 kHz, and a program that sends to it."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "servo.sock"
        self.handle = ServoHandle(self.path, stale_s=0.1)
        self.now_ns = 1000 * MS
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)

    def send(self, position_m: float, velocity_m_s: float = 0.0, age_ms: int = 0) -> None:
        stamp_ns = self.now_ns - age_ms * MS
        self.socket.sendto(POSITION.pack(stamp_ns, position_m, velocity_m_s), str(self.path))

    def tick(self, number: int = 1) -> HandleReading:
        for _ in range(number):
            reading = self.handle.read(self.now_ns)
            self.now_ns += MS
        return reading


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path)
    bench.handle.open()
    yield bench
    bench.handle.close()
    bench.handle.close()
    bench.socket.close()
    assert not bench.path.exists()


def test_the_first_position_is_taken_up_and_the_next_tick_presses(bench: Bench) -> None:
    assert bench.tick() == HandleReading(0.0, 0.0, False)
    bench.send(0.3, 0.1)
    assert bench.tick() == HandleReading(0.3, 0.0, False)
    assert bench.tick() == HandleReading(0.3 + 0.1 * 0.001, 0.1, True)


def test_a_position_is_carried_on_for_20_ms_and_let_go_after_100(bench: Bench) -> None:
    bench.send(0.3, 0.1)
    bench.tick(11)
    assert bench.tick() == HandleReading(0.3 + 0.1 * 0.011, 0.1, True)
    assert bench.tick(30) == HandleReading(0.3 + 0.1 * 0.02, 0.0, True)
    assert bench.tick(59).deadman
    assert bench.tick() == HandleReading(0.3, 0.0, False)
    assert not bench.tick(1000).deadman


def test_after_a_pause_it_is_released_for_a_tick_at_the_new_place(bench: Bench) -> None:
    bench.send(0.3)
    bench.tick(200)
    bench.send(0.9)
    assert bench.tick() == HandleReading(0.9, 0.0, False)
    assert bench.tick() == HandleReading(0.9, 0.0, True)


def test_what_waited_too_long_moves_nothing(bench: Bench) -> None:
    bench.send(0.3, age_ms=101)
    assert not bench.tick(5).deadman


@pytest.mark.parametrize(
    "data",
    [
        b"",
        POSITION.pack(1000 * MS, nan, 0.0),
        POSITION.pack(1000 * MS, 0.1, inf),
        POSITION.pack(1000 * MS, 10.5, 0.0),
        POSITION.pack(1000 * MS, 0.1, 0.0) + b"\0",
    ],
    ids=["empty", "nan", "infinite", "beyond", "long"],
)
def test_what_is_no_position_is_counted(bench: Bench, data: bytes) -> None:
    bench.socket.sendto(data, str(bench.path))
    assert bench.tick() == HandleReading(0.0, 0.0, False)
    assert bench.handle.counters == {"positions": 1, "malformed": 1}


def test_a_position_that_comes_after_the_tick_has_begun_is_of_that_tick(bench: Bench) -> None:
    for position_m in 0.1, 0.2:
        bench.send(position_m, age_ms=-60_000)
    assert bench.tick().position_m == 0.2
    assert bench.tick(100).deadman and not bench.tick().deadman


def test_an_older_position_does_not_take_the_place_of_a_newer(bench: Bench) -> None:
    bench.send(0.3)
    bench.send(0.1, age_ms=2)
    bench.tick()
    assert bench.tick().position_m == 0.3


def test_the_fastest_velocity_stays_within_the_range_of_a_handle(bench: Bench) -> None:
    bench.send(9.9, 1000.0)
    bench.tick()
    assert bench.tick(10).position_m == 10.0


def test_its_socket_is_of_this_user_alone_and_takes_the_place_of_one_that_was_left(tmp_path: Path) -> None:
    first, second = Bench(tmp_path), Bench(tmp_path)
    first.handle.open()
    second.handle.open()
    assert stat.S_IMODE(second.path.stat().st_mode) == 0o600
    second.send(0.2)
    second.tick(2)
    assert (first.tick(2).deadman, second.tick().deadman) == (False, True)
    for bench in first, second:
        bench.handle.close()
        bench.socket.close()


def test_a_folder_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(DeviceSetupError, match=r"servo\.sock: No such file or directory"):
        ServoHandle(tmp_path / "none" / "servo.sock", 0.1).open()


def test_a_file_that_is_no_socket_stays(tmp_path: Path) -> None:
    path = tmp_path / "master.yaml"
    path.write_text("cell: a")
    with pytest.raises(DeviceSetupError, match=r"master\.yaml: Address already in use"):
        ServoHandle(path, 0.1).open()
    assert path.read_text() == "cell: a"
