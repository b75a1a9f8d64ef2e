"""Messages of a daemon to systemd by sd_notify(3): ready, its status, that it lives, that it ends.

Our own: the protocol is one datagram; the package of that name on PyPI has had no release since 2017, and
systemd's binding needs a compiler on each host.
"""

import os
import socket
from collections.abc import Callable, Mapping
from contextlib import suppress

from forefeel.common.clock import MonotonicClock

_LONGEST_LINE = 256  # characters of a status line
_NOTIFY_NS = 100_000_000


class ServiceManager:
    """Sends lines to the socket that NOTIFY_SOCKET names; does nothing without it.

    Attributes:
        watchdog_ns: longest time that systemd accepts between two signs of life; None: it wants none. From
            WATCHDOG_USEC, where WATCHDOG_PID is this process or absent.
    """

    def __init__(self, environment: Mapping[str, str], pid: int) -> None:
        self._address = _address(environment.get("NOTIFY_SOCKET", ""))
        self.watchdog_ns = _watchdog_ns(environment, pid) if self._address is not None else None

    def tell(self, text: str) -> None:
        """Sends one or more lines `NAME=value`; never raises, never waits."""
        if self._address is None:
            return
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.setblocking(False)
            sender.sendto(text.encode(), self._address)


class ServiceWatchdog:
    """Tells systemd how a daemon does. A sign of life is sent only where every 1 kHz loop has ticked since
    the last one; `notify` runs as an asyncio task, so that it stops when the tasks hang, too.

    `ticks`: number of each loop's ticks since its start; `status`: one line for a person, at a stamp.
    """

    def __init__(
        self, manager: ServiceManager, ticks: Callable[[], tuple[int, ...]], status: Callable[[int], str]
    ) -> None:
        self._manager = manager
        self._ticks = ticks
        self._status = status
        self._sent_status = ""
        self._alive_at: tuple[int, ...] | None = None
        self._due_ns = 0
        self.ready = False

    @property
    def period_ns(self) -> int:
        """Time in ns between two calls of `notify`."""
        watchdog_ns = self._manager.watchdog_ns
        return _NOTIFY_NS if watchdog_ns is None else max(1_000_000, min(_NOTIFY_NS, watchdog_ns // 4))

    def notify(self, now_ns: int) -> None:
        """Sends systemd what is due: a changed status, once readiness when every loop has ticked, and a sign
        of life from then on.
        """
        ticks = self._ticks()
        if not self.ready and all(ticks):
            self.ready = True
            self._manager.tell("READY=1")
        status = self._status(now_ns)
        if status != self._sent_status:
            self._sent_status = status
            self._manager.tell(f"STATUS={_line(status)}")
        if self.ready and now_ns >= self._due_ns:
            self._notify_alive(ticks, now_ns)

    def stopping(self, reason: str = "stopping") -> None:
        """Sends that the daemon ends in order; `reason`: why."""
        self._manager.tell(f"STOPPING=1\nSTATUS={_line(reason)}")

    def _notify_alive(self, ticks: tuple[int, ...], now_ns: int) -> None:
        """Sends a sign of life if systemd wants one and every loop has ticked since the last one; the next is
        due a quarter of the watchdog's time later.
        """
        watchdog_ns = self._manager.watchdog_ns
        before = self._alive_at or (0,) * len(ticks)
        if watchdog_ns is None or not all(now > then for now, then in zip(ticks, before, strict=True)):
            return
        self._alive_at, self._due_ns = ticks, now_ns + watchdog_ns // 4
        self._manager.tell("WATCHDOG=1")


def service_watchdog(status: Callable[[], str], steps: Callable[[], int]) -> Callable[[], None]:
    """Function that tells systemd how a process without 1 kHz loops does: to be called a few times a second,
    from the main thread. `steps`: a count that grows while the process makes progress.
    """
    clock = MonotonicClock()
    manager = ServiceManager(os.environ, os.getpid())
    watchdog = ServiceWatchdog(manager, lambda: (steps(),), lambda _now_ns: status())
    return lambda: watchdog.notify(clock.now_ns())


def _address(text: str) -> str | None:
    """A path, or a name of the abstract namespace, which begins with a zero byte; None for anything else."""
    if text.startswith("@") and len(text) > 1:
        return "\0" + text[1:]
    return text if text.startswith("/") else None


def _watchdog_ns(environment: Mapping[str, str], pid: int) -> int | None:
    wanted, whose = environment.get("WATCHDOG_USEC", ""), environment.get("WATCHDOG_PID", str(pid))
    if not wanted.isdecimal() or whose != str(pid) or int(wanted) == 0:
        return None
    return int(wanted) * 1000  # WATCHDOG_USEC is in us


def _line(text: str) -> str:
    """One line of bounded length: a line break would begin another field."""
    return " ".join(text.split())[:_LONGEST_LINE]
