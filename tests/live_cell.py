"""Real processes for tests: one command, or a cell of both daemons over real Zenoh with an observer here."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections import defaultdict, deque
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Self, TypeVar

import yaml

from forefeel.child_process import free_endpoints
from forefeel.common.bus import observed
from forefeel.common.clock import MonotonicClock
from forefeel.common.codec import decode
from forefeel.common.messages import Message, SafetyEvent, SafetyState, SlaveState
from forefeel.common.topics import SLAVE_STATE, Topic
from forefeel.common.transport.security import Party
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_bus import ZenohTransport
from tests.secured import make_pki
from tests.waiting import PATIENCE_S, wait_until

ROOT = Path(__file__).parents[1]
IMPORTS = f"{ROOT / 'src'}:{ROOT}"
"""PYTHONPATH of a process that runs this checkout and its tests."""
CELL, AXIS = "cell", "insertion"
M = TypeVar("M", bound=Message)
_MOST = 30_000


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port: int = probe.getsockname()[1]
        return port


class Process:
    """One command of ours as a process group of its own, and its output in `log`.

    `ahead`: a folder that is imported from before all others; `environment`: more variables.
    """

    def __init__(
        self,
        role: str,
        folder: Path,
        *arguments: str,
        module: str = "forefeel",
        ahead: Path | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.role = role
        self.log = folder / f"{role}.log"
        self.started_s = time.monotonic()
        path = IMPORTS if ahead is None else f"{ahead}:{IMPORTS}"
        with self.log.open("ab") as log:
            self._from = log.tell()
            self.process = subprocess.Popen(
                [sys.executable, "-m", module, *arguments],
                cwd=folder,
                env={
                    **os.environ,
                    "PYTHONPATH": path,
                    "FOREFEEL_PARENT": str(os.getpid()),
                    **(environment or {}),
                },
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    @property
    def running(self) -> bool:
        return self.process.poll() is None

    @property
    def text(self) -> str:
        """Output since it was started."""
        return self.log.read_bytes()[self._from :].decode(errors="replace")

    def wait_for(self, text: str) -> None:
        """Waits until it has printed that."""
        wait_until(lambda: text in self.text or not self.running, what=f"{text!r} of the {self.role}")
        assert text in self.text, self.text

    def wait(self) -> int:
        """Its exit code."""
        return self.process.wait(PATIENCE_S)

    def send(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def interrupt(self) -> None:
        """Sends SIGINT to it and its children, as Ctrl-C in a terminal does."""
        os.killpg(self.process.pid, signal.SIGINT)

    def group_runs(self) -> bool:
        """True while anything is left of the process and its children."""
        try:
            os.killpg(self.process.pid, 0)
        except ProcessLookupError:
            return False
        return True

    def kill(self) -> None:
        """Kills it and its children."""
        if self.group_runs():
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def resident_mb(self) -> float:
        status = Path(f"/proc/{self.process.pid}/status").read_text(encoding="ascii")
        line = next(line for line in status.splitlines() if line.startswith("VmRSS"))
        return int(line.split()[1]) / 1024


class LiveCell:
    """Slave, master and an observer; with `pki` over mutual TLS. Ends all that it started on exit."""

    def __init__(
        self,
        folder: Path,
        pki: bool = False,
        slave: Mapping[str, Any] | None = None,
        master: Mapping[str, Any] | None = None,
    ) -> None:
        self.folder = folder
        self.pki = folder / "pki" if pki else None
        if self.pki is not None:
            make_pki(self.pki, [CELL], days=30)
        tcp = free_endpoints(3)  # chosen together: one after another two of them may be the same
        self.endpoint, self.own, self.master_endpoint = (
            each.replace("tcp/", "tls/") if pki else each for each in tcp
        )
        self.received: defaultdict[str, deque[tuple[bytes, int]]] = defaultdict(lambda: deque(maxlen=_MOST))
        self.watch: Callable[[str, bytes], None] | None = None
        self.faults: list[Exception] = []
        self.started: list[Process] = []
        self.observer = ZenohTransport.open(
            TransportSettings(listen=(self.own,), pki=self.pki),
            MonotonicClock(),
            self.faults.append,
            Party("recorder", (CELL,)),
        )
        self.observer.subscribe_all(f"forefeel/{CELL}", self._receive)
        self.write_slave(slave or {})
        self.write_master(master or {})

    def _receive(self, key: str, payload: bytes, stamp_ns: int) -> None:
        self.received[key].append((payload, stamp_ns))
        if self.watch is not None:
            self.watch(key, payload)

    def write_slave(self, extra: Mapping[str, Any]) -> None:
        """Its settings: beside where it is, what is in `extra`."""
        self.write("slave", {"listen": [self.endpoint], "connect": [self.own]}, extra)

    def write_master(self, extra: Mapping[str, Any]) -> None:
        transport = {"listen": [self.master_endpoint], "connect": [self.endpoint, self.own]}
        self.write("master", transport, extra)

    def write(self, role: str, transport: dict[str, Any], extra: Mapping[str, Any]) -> None:
        certificates = {} if self.pki is None else {"pki": str(self.pki)}
        settings = {
            "role": role,
            "cell": CELL,
            "transport": {**transport, **certificates},
            "state": {"directory": f"state-{role}"},
            **extra,
        }
        (self.folder / f"{role}.yaml").write_text(yaml.safe_dump(settings))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self.started:
            process.kill()
        self.observer.close()

    def start(self, role: str, *words: str, module: str = "forefeel") -> Process:
        arguments = words or (role, "--config", f"{role}.yaml")
        process = Process(role, self.folder, *arguments, module=module)
        self.started.append(process)
        return process

    def pair(self) -> tuple[Process, Process]:
        """Slave and master, armed."""
        ends = self.start("slave"), self.start("master")
        self.await_state("armed")
        return ends

    def await_state(self, state: str, timeout_s: float = PATIENCE_S) -> float:
        """Waits until the slave reports that state from now on; s that it took."""
        now_ns = time.monotonic_ns()
        try:
            return wait_until(lambda: self.newest_after(now_ns) == state, timeout_s, state)
        except AssertionError as error:
            raise AssertionError(f"{error}: {[process.text[-500:] for process in self.started]}") from error

    def newest_after(self, stamp_ns: int) -> str:
        state = self.newest_state()
        return state[1].state.value if state is not None and state[0] > stamp_ns else ""

    def newest(self, topic: Topic[M]) -> M:
        """The newest message of a topic."""
        payload, at_ns = self.received[topic.key(CELL, AXIS)][-1]
        return observed(topic, payload, at_ns)[-1][0]

    def newest_state(self) -> tuple[int, SlaveState] | None:
        """(when it was received, state of the slave)."""
        received = self.received[SLAVE_STATE.key(CELL, AXIS)]
        return (received[-1][1], decode(SlaveState, received[-1][0])) if received else None

    def since(self, topic: Topic[M], stamp_ns: int) -> list[M]:
        """The messages of a topic that were received since."""
        received = list(self.received[topic.key(CELL, AXIS)])
        messages = [one for payload, at_ns in received for one in observed(topic, payload, at_ns)]
        return [message for message, received_ns in messages if received_ns >= stamp_ns]

    def messages(self, topic: Topic[M]) -> list[M]:
        """All that was received of a topic."""
        return self.since(topic, 0)


def check_stops(events: Sequence[SafetyEvent]) -> None:
    """Each stop says why, and ends at rest or in what is worse; what follows a lost event is not known."""
    for event in events:
        assert event.reason
        leaves = event.before in {SafetyState.ENGAGING, SafetyState.ARMED}
        assert not (leaves and event.after in {SafetyState.READY, SafetyState.IDLE}), (
            f"no stop before {event}"
        )
    for stop, then in pairwise(events):
        if stop.after is SafetyState.STOPPING and then.sequence == stop.sequence + 1:
            assert then.after in {SafetyState.READY, SafetyState.FAULT, SafetyState.ESTOPPED}, events
