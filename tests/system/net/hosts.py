"""Two hosts, 10.77.0.1 and 10.77.0.2, the cable between them and the processes on them."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

from tests.live_cell import IMPORTS
from tests.system.net.cable import MEASURING, TunCable
from tests.system.net.namespaces import ip, remove
from tests.waiting import PATIENCE_S

Process = subprocess.Popen[bytes]
_NUMBERS = count()


class Hosts:
    """Whatever happens, `close` ends every process and takes the namespaces away."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        number = next(_NUMBERS)
        self.names = [f"ff{os.getpid()}{end}{number}" for end in "ab"]
        self.expected_ends: set[int] = set()
        self._processes: list[Process] = []
        self._made: list[str] = []

    def join(self, seed: int) -> TunCable:
        """Makes them; nothing but the cable leads out of either."""
        for name in self.names:
            ip("netns", "add", name)
            self._made.append(name)
            ip("-n", name, "link", "set", "lo", "up")
        self._cable = TunCable(self.names, seed)
        self._measure()
        return self._cable

    def _measure(self) -> None:
        """A second link, 10.78.0.1 and 10.78.0.2, for a recorder of both: what is tried is not its way."""
        a, b = self.names
        ip("link", "add", f"{a}m", "netns", a, "type", "veth", "peer", "name", f"{b}m", "netns", b)
        for name, address in zip(self.names, MEASURING, strict=True):
            ip("-n", name, "address", "add", f"{address}/24", "dev", f"{name}m")
            ip("-n", name, "link", "set", f"{name}m", "up")

    def run(self, host: int, log: str, *words: str, within: Sequence[str] = ()) -> Process:
        """`python -m WORDS` on that host; `ip netns exec` becomes it. `within`: what to start it with."""
        command = [*within, "ip", "netns", "exec", self.names[host], sys.executable, "-m", *words]
        with (self.folder / log).open("ab") as said:
            process = subprocess.Popen(
                command,
                cwd=self.folder,
                env={**os.environ, "PYTHONPATH": IMPORTS},
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=said,
            )
        self._processes.append(process)
        return process

    def wait_until(
        self, condition: Callable[[], object], timeout_s: float = PATIENCE_S, what: str = ""
    ) -> None:
        """Polls.

        Raises:
            AssertionError: it took too long, or a process has ended that was not to.
        """
        deadline_s = time.monotonic() + timeout_s
        while not condition():
            late = time.monotonic() > deadline_s
            if late or not all(process.poll() is None for process in self.running):
                raise AssertionError(f"{'too late' if late else 'one has ended'}: {what} {self.last_words()}")
            time.sleep(0.02)

    @property
    def running(self) -> list[Process]:
        return [process for process in self._processes if process.pid not in self.expected_ends]

    def end(self, process: Process, number: signal.Signals = signal.SIGTERM) -> int:
        """Ends one; its exit code."""
        self.expected_ends.add(process.pid)
        with suppress(ProcessLookupError):
            process.send_signal(signal.SIGCONT)
            process.send_signal(number)
        return process.wait(15)

    def says(self, log: str, text: str) -> bool:
        path = self.folder / log
        return path.exists() and text in path.read_text(errors="replace")

    def last_words(self) -> dict[str, list[str]]:
        logs = sorted(self.folder.glob("*.log"))
        return {log.name: log.read_text(errors="replace").splitlines()[-4:] for log in logs}

    def close(self) -> None:
        for process in self._processes:
            if process.poll() is None:
                process.kill()
            process.wait()
        if hasattr(self, "_cable"):
            self._cable.close()
        for name in self._made:  # its devices go with it
            remove(name)


@contextmanager
def joined_by_tun(folder: Path, seed: int = 1) -> Iterator[tuple[Hosts, TunCable]]:
    """Two hosts on a cable in software; nothing of them is left afterwards."""
    hosts = Hosts(folder)
    try:
        yield hosts, hosts.join(seed)
    finally:
        hosts.close()
    left = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True).stdout
    assert not [name for name in hosts.names if name in left]
