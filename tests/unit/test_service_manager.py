"""What systemd hears of a daemon, by a socket of its kind and in virtual time."""

import itertools
import socket
from pathlib import Path

import pytest

from forefeel.common.clock import VirtualClock
from forefeel.common.runtime.service_manager import ServiceManager, ServiceWatchdog

MS = 1_000_000
PID = 77


class Rig(ServiceManager):
    """A daemon of two loops in virtual time; `hung`: those that tick no more. Keeps (when, what) it tells."""

    def __init__(self, watchdog_ns: int | None) -> None:
        self.watchdog_ns, self.clock = watchdog_ns, VirtualClock()
        self.told: list[tuple[float, str]] = []
        self.ticks, self.hung = [0, 0], set[int]()
        self.status = "axis insertion: idle (started)"
        self.watchdog = ServiceWatchdog(self, lambda: (self.ticks[0], self.ticks[1]), lambda _: self.status)

    def tell(self, text: str) -> None:
        self.told.append((self.clock.now_ns() * 1e-9, text))

    def run(self, seconds: float) -> list[str]:
        """Texts that are told meanwhile; the loops tick each ms, `notify` comes when it is due."""
        self.told.clear()
        for _ in range(round(seconds * 1000)):
            self.clock.set_ns(self.clock.now_ns() + MS)
            for loop in {0, 1} - self.hung:
                self.ticks[loop] += 1
            if self.clock.now_ns() % self.watchdog.period_ns < MS:
                self.watchdog.notify(self.clock.now_ns())
        return [text for _, text in self.told]


def test_ready_comes_once_when_every_loop_has_ticked_and_the_status_as_one_line_when_it_changes() -> None:
    rig = Rig(None)
    rig.hung = {1}
    assert rig.run(1) == ["STATUS=axis insertion: idle (started)"]
    rig.hung = set()
    assert rig.run(1) == ["READY=1"]
    assert rig.run(1) == []
    rig.status = "axis insertion: fault (torn\nWATCHDOG=1\ncable)"
    assert rig.run(1) == ["STATUS=axis insertion: fault (torn WATCHDOG=1 cable)"]


@pytest.mark.parametrize("hung", [0, 1])
def test_signs_of_life_come_within_half_the_time_granted_until_a_loop_hangs(hung: int) -> None:
    rig = Rig(2_000 * MS)
    rig.run(20)
    times = [when for when, text in rig.told if text == "WATCHDOG=1"]
    assert max(b - a for a, b in itertools.pairwise(times)) <= 1.0
    assert len(times) <= 60
    rig.hung = {hung}
    rig.run(0.6)  # at most the one that was due
    assert "WATCHDOG=1" not in rig.run(30)
    rig.hung = set()
    assert "WATCHDOG=1" in rig.run(1)


@pytest.mark.parametrize("kind", ["path", "abstract"])
def test_both_kinds_of_socket_are_told(kind: str, tmp_path: Path) -> None:
    name = str(tmp_path / "notify") if kind == "path" else f"@forefeel-test-{tmp_path.name}-{id(tmp_path)}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(name.replace("@", "\0", 1) if kind == "abstract" else name)
        receiver.setblocking(False)
        manager = ServiceManager({"NOTIFY_SOCKET": name}, PID)
        for text in ("READY=1", "STATUS=idle"):
            manager.tell(text)
            assert receiver.recv(4096).decode() == text


@pytest.mark.parametrize(
    ("name", "watchdog", "pid", "wanted_ns"),
    [
        ("/run/x", "3000000", None, 3_000_000_000),
        ("/run/x", "3000000", str(PID), 3_000_000_000),
        ("/run/x", "3000000", "78", None),
        *(("/run/x", text, None, None) for text in (None, "0", "-1", "soon")),
        *((unknown, "3000000", None, None) for unknown in ("", "relative", "@", "vsock:2:1234")),
    ],
)
def test_the_watchdog_is_that_of_this_process_and_of_a_socket_that_we_speak(
    name: str, watchdog: str | None, pid: str | None, wanted_ns: int | None
) -> None:
    environment = {"NOTIFY_SOCKET": name, "WATCHDOG_USEC": watchdog, "WATCHDOG_PID": pid}
    manager = ServiceManager({key: value for key, value in environment.items() if value is not None}, PID)
    manager.tell("READY=1")  # to nobody
    assert manager.watchdog_ns == wanted_ns


def test_a_manager_that_is_gone_or_does_not_read_stops_nothing(tmp_path: Path) -> None:
    ServiceManager({"NOTIFY_SOCKET": str(tmp_path / "gone")}, PID).tell("READY=1")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as deaf:
        deaf.bind(str(tmp_path / "deaf"))
        manager = ServiceManager({"NOTIFY_SOCKET": str(tmp_path / "deaf")}, PID)
        for _ in range(2000):  # more than its queue holds: a call that waited would never return
            manager.tell("WATCHDOG=1")
