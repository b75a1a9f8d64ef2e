"""What systemd hears of a daemon, by a socket of its kind and in virtual time."""

import itertools
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from forefeel.common.clock import VirtualClock
from forefeel.common.runtime.service_manager import ServiceManager, ServiceWatchdog

MS = 1_000_000
PID = 77


@pytest.fixture(params=["path", "abstract"])
def systemd(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[str, socket.socket]]:
    """What NOTIFY_SOCKET holds, and the other end."""
    name = (
        str(tmp_path / "notify")
        if request.param == "path"
        else f"@forefeel-test-{tmp_path.name}-{id(request)}"
    )
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(name.replace("@", "\0", 1) if name.startswith("@") else name)
        receiver.setblocking(False)
        yield name, receiver


def heard(receiver: socket.socket) -> list[str]:
    found = []
    while True:
        try:
            found.append(receiver.recv(4096).decode())
        except BlockingIOError:
            return found


class Book(ServiceManager):
    """A manager that keeps what it is told."""

    def __init__(self, watchdog_ns: int | None) -> None:
        self.watchdog_ns = watchdog_ns
        self.told: list[str] = []

    def tell(self, text: str) -> None:
        self.told.append(text)


class Rig:
    """A daemon of two loops in virtual time; `hung`: those that tick no more."""

    def __init__(self, watchdog_ns: int | None) -> None:
        self.book, self.clock = Book(watchdog_ns), VirtualClock()
        self.ticks, self.hung = [0, 0], set[int]()
        self.status = "axis insertion: idle (started)"
        self.watchdog = ServiceWatchdog(
            self.book, lambda: (self.ticks[0], self.ticks[1]), lambda _: self.status
        )

    def run(self, seconds: float) -> list[tuple[float, str]]:
        """(when, what) was told meanwhile; the loops tick each ms, `look` comes when it is due."""
        told = []
        for _ in range(round(seconds * 1000)):
            self.clock.set_ns(self.clock.now_ns() + MS)
            for loop in {0, 1} - self.hung:
                self.ticks[loop] += 1
            if self.clock.now_ns() % self.watchdog.period_ns < MS:
                before = len(self.book.told)
                self.watchdog.notify(self.clock.now_ns())
                told += [(self.clock.now_ns() * 1e-9, text) for text in self.book.told[before:]]
        return told


def signs(told: list[tuple[float, str]]) -> list[float]:
    return [when for when, text in told if text == "WATCHDOG=1"]


def test_both_kinds_of_socket_are_told(systemd: tuple[str, socket.socket]) -> None:
    name, receiver = systemd
    manager = ServiceManager({"NOTIFY_SOCKET": name}, PID)
    manager.tell("READY=1")
    manager.tell("STATUS=idle")
    assert heard(receiver) == ["READY=1", "STATUS=idle"]
    assert manager.watchdog_ns is None


@pytest.mark.parametrize("name", ["", "relative", "@", "vsock:2:1234"])
def test_without_a_socket_that_we_speak_nothing_is_sent_and_no_watchdog_is_fed(name: str) -> None:
    manager = ServiceManager({"NOTIFY_SOCKET": name, "WATCHDOG_USEC": "1000000"}, PID)
    manager.tell("READY=1")
    assert manager.watchdog_ns is None


def test_a_manager_that_is_gone_or_does_not_read_stops_nothing(tmp_path: Path) -> None:
    ServiceManager({"NOTIFY_SOCKET": str(tmp_path / "gone")}, PID).tell("READY=1")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as deaf:
        deaf.bind(str(tmp_path / "deaf"))
        manager = ServiceManager({"NOTIFY_SOCKET": str(tmp_path / "deaf")}, PID)
        for _ in range(2000):  # more than its queue holds: a call that waited would never return
            manager.tell("WATCHDOG=1")


@pytest.mark.parametrize(
    ("watchdog", "pid", "wanted_ns"),
    [
        ("3000000", None, 3_000_000_000),
        ("3000000", str(PID), 3_000_000_000),
        ("3000000", "78", None),
        ("0", None, None),
        ("-1", None, None),
        ("soon", None, None),
    ],
)
def test_the_watchdog_is_that_of_this_process(watchdog: str, pid: str | None, wanted_ns: int | None) -> None:
    environment = {"NOTIFY_SOCKET": "/run/x", "WATCHDOG_USEC": watchdog}
    if pid is not None:
        environment["WATCHDOG_PID"] = pid
    assert ServiceManager(environment, PID).watchdog_ns == wanted_ns


def test_ready_comes_once_and_only_when_every_loop_has_ticked() -> None:
    rig = Rig(None)
    rig.hung = {1}
    assert "READY=1" not in [text for _, text in rig.run(1)]
    rig.hung = set()
    assert [text for _, text in rig.run(1)] == ["READY=1"]
    assert [text for _, text in rig.run(1)] == []


def test_the_status_is_told_when_it_changes_as_one_line() -> None:
    rig = Rig(None)
    assert ("STATUS=axis insertion: idle (started)") in [text for _, text in rig.run(1)]
    rig.status = "axis insertion: fault (torn\nWATCHDOG=1\ncable)"
    assert [text for _, text in rig.run(1)] == ["STATUS=axis insertion: fault (torn WATCHDOG=1 cable)"]


def test_signs_of_life_come_well_within_the_time_that_systemd_grants() -> None:
    rig = Rig(2_000 * MS)
    times = signs(rig.run(20))
    assert max(b - a for a, b in itertools.pairwise(times)) <= 1.0
    assert len(times) <= 60


@pytest.mark.parametrize("hung", [0, 1])
def test_a_loop_that_hangs_ends_the_signs_of_life_though_the_tasks_run_on(hung: int) -> None:
    rig = Rig(2_000 * MS)
    assert signs(rig.run(5))
    rig.hung = {hung}
    rig.run(0.6)  # at most the one that was due
    assert signs(rig.run(30)) == []
    rig.hung = set()
    assert signs(rig.run(1))
