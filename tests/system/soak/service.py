"""Master, slave and recorder for long, among random faults."""

import signal
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from forefeel.common.state.folder import EVENTS
from forefeel.common.topics import SAFETY_EVENT
from tests.event_lines import read_events
from tests.live_cell import CELL, LiveCell, Process
from tests.system.soak.monitor import FORCE_KEY, Life, Motion
from tests.system.soak.schedule import OFTEN, Fault
from tests.waiting import wait_until

BACK_S = 20.0
"""From the end of any fault on, ARMED again: a new process, a session, the clocks, the operator's hand."""
_FIRST_S = 60.0
"""From the start on: a machine that has just booted reads all that the processes import from its disk."""
_COMMAND_S = 30.0
_DISORDER = {"burst_loss": 0.01, "reorder": 0.01, "duplicate": 0.01}
_STALLS = {"stalls_per_s": 0.02, "stall_s": 0.15}
_LINKS: tuple[dict[str, float], ...] = (
    {"delay_s": 0.005, "jitter_s": 0.001},
    {"delay_s": 0.02, "jitter_s": 0.008, "loss": 0.01, **_STALLS},
    {"delay_s": 0.01, "jitter_s": 0.004, "loss": 0.02, **_DISORDER},
    {"delay_s": 0.05, "jitter_s": 0.02, "jitter_correlation_s": 0.5, **_STALLS},
)


@dataclass(slots=True)
class Done:
    """One fault: when it was, and how long after its end the stage was armed again."""

    fault: Fault
    from_ns: int
    to_ns: int = 0
    back_s: float = float("inf")


@dataclass(slots=True)
class Taken:
    """One recording, and whether its writer was killed."""

    path: Path
    killed: bool = False


@dataclass(slots=True)
class Soak:
    cell: LiveCell
    seed: int
    lives: list[Life] = field(default_factory=list)
    done: list[Done] = field(default_factory=list)
    taken: list[Taken] = field(default_factory=list)
    motion: Motion = field(default_factory=Motion)
    ends: Mapping[str, Process] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)

    def run(self, faults: list[Fault], duration_s: float) -> None:
        random = Random(f"links {self.seed}")
        self.cell.watch = self._hear
        self.ends = {}
        for role in ("slave", "master", "recorder"):
            self._start(role, random)
        stop = threading.Event()
        watcher = threading.Thread(target=self._sample, args=(stop,))
        watcher.start()
        try:
            self.cell.await_state("armed", _FIRST_S)
            start_s = time.monotonic()
            for fault in faults:
                self._until(start_s + fault.at_s)
                self._act(fault, random)
                self._note_warm()
            self._until(start_s + duration_s)
        finally:
            stop.set()
            watcher.join()
        self._end()

    def _note_warm(self) -> None:
        """A process that has seen each kind of fault twice has had all its buffers full."""
        for role, process in self.ends.items():
            life = [each for each in self.lives if each.name.startswith(role)][-1]
            seen = [done.fault.kind for done in self.done if done.from_ns > process.started_s * 1e9]
            if life.warm_s == float("inf") and all(seen.count(kind) >= 2 for kind in OFTEN):
                life.warm_s = time.monotonic() - process.started_s

    def _hear(self, key: str, payload: bytes) -> None:
        if key == FORCE_KEY:
            self.motion.heard(payload)

    def _start(self, role: str, random: Random) -> None:
        link = {"impairment": {"inbound": random.choice(_LINKS), "seed": random.randrange(1000)}}
        cell = self.cell
        if role == "slave":
            cell.write_slave(link)
            process = cell.start("slave", "slave.yaml", module="tests.system.soak.slave")
        elif role == "master":
            cell.write_master({**link, "axes": [{"handle": {"driver": "operator", "seed": self.seed}}]})
            process = cell.start("master")
        else:
            path = cell.folder / f"run{len(self.taken)}.mcap"
            self.taken.append(Taken(path))
            ends = ("--connect", cell.endpoint, "--connect", cell.master_endpoint, "--cell", CELL)
            words = ("--out", str(path), *ends)
            process = cell.start("recorder", "record", *words)
        self.ends = {**self.ends, role: process}
        self.lives.append(Life(f"{role} {sum(life.name.startswith(role) for life in self.lives) + 1}"))

    def _sample(self, stop: threading.Event) -> None:
        while not stop.wait(1.0):
            for role, process in dict(self.ends).items():
                life = [each for each in self.lives if each.name.startswith(role)][-1]
                try:
                    life.samples.append((time.monotonic() - process.started_s, process.resident_mb()))
                except (OSError, StopIteration):
                    continue  # it has just been killed

    def _until(self, due_s: float) -> None:
        while time.monotonic() < due_s:
            for role, process in self.ends.items():
                assert process.running, f"the {role} ended by itself: {process.log.read_text()[-500:]}"
            time.sleep(0.1)

    def _act(self, fault: Fault, random: Random) -> None:
        """The fault, its end, and the way back to ARMED."""
        done = Done(fault, time.monotonic_ns())
        self.done.append(done)
        try:
            self._do(fault, random)
            done.to_ns = time.monotonic_ns()
            time.sleep(0.3)  # a state from before the fault does not count
            done.back_s = 0.3 + self.cell.await_state("armed", BACK_S)
        except AssertionError as error:
            self.problems.append(f"{fault.kind} at {fault.at_s:.0f} s: {error}; {self._events(done.from_ns)}")
        done.to_ns = time.monotonic_ns()

    def _events(self, from_ns: int) -> list[str]:
        return [f"{each.event} ({each.reason})" for each in self.cell.since(SAFETY_EVENT, from_ns)]

    def _do(self, fault: Fault, random: Random) -> None:
        what, _, role = fault.kind.partition(" ")
        match what:
            case "freeze":
                self.ends[role].send(signal.SIGSTOP)
                time.sleep(fault.lasts_s)
                self.ends[role].send(signal.SIGCONT)
            case "kill":
                self._kill(role, random)
            case "emergency":
                self._stop_and_clear()
            case _:
                self._say_nan()

    def _say_nan(self) -> None:
        """The load cell says NaN until the slave has noticed, and is cleared after it."""
        self.ends["slave"].send(signal.SIGUSR1)
        try:
            self.cell.await_state("fault", 5.0)
        finally:
            self.ends["slave"].send(signal.SIGUSR2)
        time.sleep(0.1)
        self._clear()

    def _kill(self, role: str, random: Random) -> None:
        self.ends[role].kill()
        if role == "recorder":
            self.taken[-1].killed = True
        time.sleep(0.5)
        self._start(role, random)
        if role == "recorder":
            path = self.taken[-1].path
            wait_until(lambda: path.exists() and path.stat().st_size > 0, BACK_S, "a new recording")

    def _stop_and_clear(self) -> None:
        """By the command line, as a person does."""
        self._forefeel("estop", "--config", "slave.yaml")
        self.cell.await_state("estopped", 5.0)
        time.sleep(0.3)
        self._clear()

    def _clear(self) -> None:
        self._forefeel("clear", "--config", "slave.yaml")

    def _forefeel(self, *words: str) -> None:
        """A command as a person gives it; AssertionError with its words when it fails."""
        process = Process(words[0], self.cell.folder, *words)
        try:
            wait_until(lambda: not process.running, _COMMAND_S, f"end of forefeel {words[0]}")
        finally:
            process.kill()
        assert process.wait() == 0, f"forefeel {words[0]}: {process.text}"

    def _end(self) -> None:
        """In order; each says 0, and both event logs end with a stop."""
        for role in ("master", "slave", "recorder"):
            self.ends[role].send(signal.SIGTERM)
            code = self.ends[role].process.wait(20)
            if code:
                self.problems.append(f"the {role} ended with {code}")
        for role in ("slave", "master"):
            if read_events(self.cell.folder / f"state-{role}" / EVENTS)[-1].event != "stop":
                self.problems.append(f"the event log of the {role} does not end with a stop")
