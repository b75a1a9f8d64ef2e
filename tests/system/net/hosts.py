"""Two hosts, the cable between them, the processes on them, a disk: namespaces of one machine.

Stamps are CLOCK_MONOTONIC in ns.
"""

import ctypes
import fcntl
import json
import os
import shutil
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Any, Self

from tests.live_cell import IMPORTS, ROOT
from tests.waiting import PATIENCE_S

ADDRESSES = "10.77.0.1", "10.77.0.2"
MEASURING = "10.78.0.1", "10.78.0.2"
Process = subprocess.Popen[bytes]
_NUMBERS = count()
_END_S = 5.0
_TUNSETIFF = 0x400454CA
_IFF_TUN, _IFF_NO_PI = 0x0001, 0x1000
_CLONE_NEWNET = 0x40000000


def ip(*words: str) -> None:
    """iproute2.

    Raises:
        AssertionError: it refused.
    """
    done = subprocess.run(["ip", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"ip {' '.join(words)}: {done.stderr.strip()}"


@contextmanager
def inside(name: str) -> Iterator[None]:
    """Puts this thread into the namespace meanwhile; what it opens there stays there."""
    libc = ctypes.CDLL(None, use_errno=True)
    with Path("/proc/thread-self/ns/net").open() as home, Path(f"/run/netns/{name}").open() as there:
        try:
            if libc.setns(there.fileno(), _CLONE_NEWNET) != 0:
                raise OSError(ctypes.get_errno(), "setns")
            yield
        finally:
            if libc.setns(home.fileno(), _CLONE_NEWNET) != 0:
                raise OSError(ctypes.get_errno(), "setns")


def open_tun(namespace: str) -> int:
    """A new TUN device in that namespace, of its name; gone when the descriptor is closed."""
    with inside(namespace):
        tun = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(tun, _TUNSETIFF, struct.pack("16sH22x", namespace.encode(), _IFF_TUN | _IFF_NO_PI))
    return tun


class TunCable:
    """The forwarder, a process: see `tests.system.net.forwarder`. Each order returns when it took effect."""

    def __init__(self, names: Sequence[str], seed: int = 1) -> None:
        tuns = [open_tun(name) for name in names]
        command = [sys.executable, "-m", "tests.system.net.forwarder", *map(str, tuns), str(seed)]
        self._process = subprocess.Popen(
            command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1,
            pass_fds=tuns,
        )  # fmt: skip
        for tun in tuns:
            os.close(tun)
        self._answer()

    def shape(self, way: str = "both", largest_bytes: int | None = None, **settings: Any) -> int:  # noqa: ANN401
        """Shapes it from now on: the fields of `ImpairmentSettings`, or `preset`; without any it is
        transparent.

        `way`: `ab` (from the first host to the second), `ba` or both.
        """
        return self._order(do="shape", way=way, largest_bytes=largest_bytes, settings=settings)

    def stall(self, stall_s: float) -> int:
        """Holds everything for that long, then delivers it in one burst."""
        return self._order(do="stall", stall_s=stall_s)

    def cut(self) -> int:
        """Pulls the cable, silently for both ends."""
        return self._order(do="cut")

    def mend(self) -> int:
        """Plugs it in again."""
        return self._order(do="mend")

    def forget(self) -> int:
        """From now on no packet passes of a TCP connection that there was; see `Way`."""
        return self._order(do="forget")

    def count(self) -> dict[str, Any]:
        """Packets by way and fate; see `Way`."""
        return self._ask(do="count")

    def close(self) -> None:
        """Closes its standard input, with which it ends."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _order(self, **order: Any) -> int:  # noqa: ANN401
        return int(self._ask(**order)["at_ns"])

    def _ask(self, **order: Any) -> dict[str, Any]:  # noqa: ANN401
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(order) + "\n")
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert line, "the forwarder has ended"
        answer: dict[str, Any] = json.loads(line)
        return answer


class Hosts:
    """The network namespaces `names` and the processes in them, whose logs are in `folder`."""

    def __init__(self, folder: Path, names: Sequence[str]) -> None:
        self.folder, self.names = folder, names
        self.expected_ends: set[int] = set()
        self._processes: list[Process] = []

    def run(self, host: int, log: str, *words: str, within: Sequence[str] = ()) -> Process:
        """`python -m WORDS` on that host; `ip netns exec` becomes it. `within`: what to start it with."""
        command = [*within, "ip", "netns", "exec", self.names[host], sys.executable, "-m", *words]
        with (self.folder / log).open("ab") as output:
            process = subprocess.Popen(
                command,
                cwd=self.folder,
                env={**os.environ, "PYTHONPATH": IMPORTS},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
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
            ended = [p for p in self._processes if p.pid not in self.expected_ends and p.poll() is not None]
            if late or ended:
                raise AssertionError(f"{'too late' if late else 'one has ended'}: {what} {self.last_words()}")
            time.sleep(0.02)

    def end(self, process: Process, number: signal.Signals = signal.SIGTERM) -> int:
        """Ends one; its exit code.

        Raises:
            AssertionError: it goes on, with what each of its threads waits for.
        """
        self.expected_ends.add(process.pid)
        with suppress(ProcessLookupError):
            process.send_signal(signal.SIGCONT)
            process.send_signal(number)
        try:
            return process.wait(15)
        except subprocess.TimeoutExpired as error:
            tasks = Path(f"/proc/{process.pid}/task").iterdir()
            waits = [
                " ".join((task / name).read_text().strip() for name in ("comm", "wchan")) for task in tasks
            ]
            raise AssertionError(f"does not end: {waits} {self.last_words()}") from error

    def says(self, log: str, text: str) -> bool:
        path = self.folder / log
        return path.exists() and text in path.read_text(errors="replace")

    def last_words(self) -> dict[str, list[str]]:
        logs = sorted(self.folder.glob("*.log"))
        return {log.name: log.read_text(errors="replace").splitlines()[-4:] for log in logs}

    def close(self) -> None:
        for process in self._processes:
            process.kill()
            process.wait()


class SmallDisk:
    """A tmpfs on `folder` for those who are started `within`, which this machine does not see.

    Network namespaces that were made before are known there, later ones are not.
    """

    def __init__(self, folder: Path, size_bytes: int) -> None:
        folder.mkdir()
        self.folder = folder
        mount = f"mount -t tmpfs -o size={size_bytes} tmpfs '{folder}' && echo mounted && exec sleep infinity"
        command = ["unshare", "--mount", "--propagation", "private", "sh", "-c", mount]
        self._holder = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True)
        assert self._holder.stdout is not None
        if self._holder.stdout.readline() != "mounted\n":
            self.__exit__()
            raise AssertionError(f"{folder}: no tmpfs could be mounted in a mount namespace")

    @property
    def within(self) -> tuple[str, ...]:
        """What to start a process with that is to see it; it runs in the folder that holds it."""
        where = f"--chdir={self.folder.parent}"  # entering a mount namespace leaves the working directory
        return "nsenter", "--target", str(self._holder.pid), "--mount", "env", where

    @property
    def seen(self) -> Path:
        return Path(f"/proc/{self._holder.pid}/root{self.folder}")

    def fill(self) -> None:
        with (self.seen / "ballast").open("wb", buffering=0) as file, suppress(OSError):
            while True:
                file.write(bytes(4096))

    def free(self) -> None:
        (self.seen / "ballast").unlink()

    def allow_writing(self, allowed: bool) -> None:
        """It can not be forbidden while a file is open for it."""
        how = "rw" if allowed else "ro"
        subprocess.run([*self.within, "mount", "-o", f"remount,{how}", str(self.folder)], check=True)

    def free_bytes(self) -> int:
        return shutil.disk_usage(self.seen).free

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._holder.kill()
        self._holder.communicate()


@contextmanager
def joined_by_tun(folder: Path, seed: int = 1) -> Iterator[tuple[Hosts, TunCable]]:
    """Two hosts on a cable in software; nothing else leads out of either, and nothing of them is left
    afterwards.

    A second link, 10.78.0.1 and 10.78.0.2, is for a recorder of both: what is tried is not its way.
    """
    number = next(_NUMBERS)
    names = [f"ff{os.getpid()}{end}{number}" for end in "ab"]
    with ExitStack() as leave:
        for name in names:
            ip("netns", "add", name)
            leave.callback(ip, "netns", "delete", name)  # its devices go with it
            ip("-n", name, "link", "set", "lo", "up")
        cable = TunCable(names, seed)
        leave.callback(cable.close)
        a, b = names
        ip("link", "add", f"{a}m", "netns", a, "type", "veth", "peer", "name", f"{b}m", "netns", b)
        for name, *addresses in zip(names, ADDRESSES, MEASURING, strict=True):
            for device, address in zip((name, f"{name}m"), addresses, strict=True):
                ip("-n", name, "address", "add", f"{address}/24", "dev", device)
                ip("-n", name, "link", "set", device, "up")
        hosts = Hosts(folder, names)
        leave.callback(hosts.close)
        yield hosts, cable
    left = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True).stdout
    assert not [name for name in names if name in left]
