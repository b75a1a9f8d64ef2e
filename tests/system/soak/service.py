"""Master, slave and recorder for long, among random faults: memory, recordings, motion, arming again."""

import re
import signal
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import NamedTuple

import numpy as np

from forefeel.common.bus import observed
from forefeel.common.errors import RecordingError
from forefeel.common.recording.mcap_reader import Run, Stream
from forefeel.common.state.folder import EVENTS
from forefeel.common.topics import FORCE, SAFETY_EVENT, TOPICS
from tests.event_lines import read_events
from tests.live_cell import AXIS, CELL, LiveCell, Process
from tests.system.rows import Result
from tests.waiting import wait_until

BACK_S = 20.0
"""From the end of any fault on, ARMED again: a new process, a session, the clocks, the operator's hand."""
_START_S = 60.0
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
OFTEN = ("freeze slave", "freeze master", "freeze recorder", "emergency stop", "load cell NaN")
RARE = ("kill slave", "kill master", "kill recorder")
"""At most once in ten minutes each, so that a process lives for long enough to be measured."""
_KILLS_EVERY_S = 600.0
_KILLS_BETWEEN = (0.65, 0.70)
_FIRST_S, _SOON_S, _LONGEST_S = 5.0, 4.0, 2.0
_FILLED_S = 270.0  # a recorder's Zenoh session takes 19 MB in its first 260 s, and no more in the next 300 s
_LEAST_S = 30.0
_BLOCK_S = 5.0
_RAMP_NS = 150_000_000
_STILL_M = 5e-6
_UNHEARD = 100  # of the forces in a row: in so many the stage may have been engaged and stopped again
MOST_GROWTH = 0.05
_SEED = 1
_LOST = 300
_NUMBER = re.compile(rb'"sequence": ?(\d+)')
_SLACK_NS = 500_000_000


class Fault(NamedTuple):
    """`at_s`: since the start, or as soon after as the one before is over."""

    at_s: float
    kind: str
    lasts_s: float


def schedule(seed: int, duration_s: float) -> list[Fault]:
    """All of a run, in their order; none in the last ten seconds."""
    random = Random(f"soak {seed}")
    faults = []
    for i, kind in enumerate(2 * OFTEN):  # first each kind twice, soon; then at random
        faults.append(Fault(_FIRST_S + i * _SOON_S, kind, random.uniform(0.5 * _LONGEST_S, _LONGEST_S)))
    mean_s = 10.0 if duration_s < _KILLS_EVERY_S else 30.0
    at_s, kinds = _FIRST_S + len(faults) * _SOON_S, list[str]()
    while at_s < duration_s:
        if not kinds:  # each kind once before one comes again
            kinds = random.sample(OFTEN, len(OFTEN))
        faults.append(Fault(at_s, kinds.pop(), random.uniform(0.1, _LONGEST_S)))
        at_s += random.uniform(0.5, 1.5) * mean_s
    spans = max(1, int(duration_s // _KILLS_EVERY_S))
    for span in range(spans):
        for kind in RARE:
            at_s = (span + random.uniform(*_KILLS_BETWEEN)) * duration_s / spans
            faults.append(Fault(at_s, kind, 0.0))
    return sorted((f for f in faults if f.at_s < duration_s - 10.0), key=lambda fault: fault.at_s)


@dataclass(slots=True)
class Life:
    """Memory of one process from its start to its end: (seconds of life, MB).

    `warm_s`: from then on it has lived through every kind of fault, and its bounded buffers have been full.
    """

    name: str
    process: Process
    warm_s: float = float("inf")
    samples: list[tuple[float, float]] = field(default_factory=list)

    @property
    def age_s(self) -> float:
        return time.monotonic() - self.process.started_s

    def growth(self) -> tuple[float, float, float] | None:
        """(MB at the end, share, s) after the warm-up; None where it lived too shortly.

        The share is what the median step of 5 s makes in all; a leak adds to it, one burst does not.
        """
        warm = np.array([sample for sample in self.samples if sample[0] > max(_FILLED_S, self.warm_s)])
        if len(warm) < 10 or warm[-1, 0] - warm[0, 0] < _LEAST_S:
            return None
        span_s = float(warm[-1, 0] - warm[0, 0])
        edges = np.arange(warm[0, 0], warm[-1, 0], _BLOCK_S)
        steps_mb = np.diff(np.interp(edges, warm[:, 0], warm[:, 1]))
        share = float(np.median(steps_mb)) / _BLOCK_S * span_s / float(warm[0, 1])
        return float(warm[-1, 1]), share, span_s


class Motion:
    """Where the stage goes while no command is followed: nowhere, once it has come to rest."""

    def __init__(self) -> None:
        self._sequence = self.resting = 0
        self._since_ns: int | None = None
        self._rest_m: float | None = None
        self.moved: list[str] = []

    def receive(self, key: str, payload: bytes) -> None:
        samples = observed(FORCE, payload, 0) if key == FORCE.key(CELL, AXIS) else []
        for sample, _ in samples:
            missed = sample.sequence - self._sequence - 1
            if not 0 <= missed < _UNHEARD or sample.answers_sequence is not None:
                self._since_ns = self._rest_m = None  # another process, or it follows, or may have followed
            self._sequence = sample.sequence
            if sample.answers_sequence is not None:
                continue
            if self._since_ns is None:
                self._since_ns = sample.stamp_ns
            if sample.stamp_ns - self._since_ns < _RAMP_NS:
                continue
            self.resting += 1
            self._rest_m = sample.position_m if self._rest_m is None else self._rest_m
            off_m = abs(sample.position_m - self._rest_m)
            if off_m > _STILL_M and len(self.moved) < 100:
                self.moved.append(f"{off_m * 1e6:.0f} um at {sample.stamp_ns / 1e9:.3f} s")


@dataclass(slots=True)
class Done:
    """One fault: when it was, and how long after its end the stage was armed again."""

    kind: str
    from_ns: int
    to_ns: int = 0
    back_s: float = float("inf")


@dataclass(slots=True)
class Soak:
    """A run and what was seen of it. `newest`: the life of each process that runs, by role; `recordings`: the
    writers of all but the last were killed.
    """

    cell: LiveCell
    seed: int
    lives: list[Life] = field(default_factory=list)
    newest: dict[str, Life] = field(default_factory=dict)
    done: list[Done] = field(default_factory=list)
    recordings: list[Path] = field(default_factory=list)
    motion: Motion = field(default_factory=Motion)
    problems: list[str] = field(default_factory=list)

    def run(self, faults: list[Fault], duration_s: float) -> None:
        random = Random(f"links {self.seed}")
        self.cell.watch = self.motion.receive
        for role in ("slave", "master", "recorder"):
            self._start(role, random)
        stop = threading.Event()
        watcher = threading.Thread(target=self._sample, args=(stop,))
        watcher.start()
        try:
            self.cell.await_state("armed", _START_S)
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
            path = cell.folder / f"run{len(self.recordings)}.mcap"
            self.recordings.append(path)
            ends = ("--connect", cell.endpoint, "--connect", cell.master_endpoint, "--cell", CELL)
            process = cell.start("recorder", "record", "--out", str(path), *ends)
        number = sum(life.process.role == role for life in self.lives) + 1
        life = Life(f"{role} {number}", process)
        self.lives.append(life)
        self.newest = {**self.newest, role: life}

    def _sample(self, stop: threading.Event) -> None:
        while not stop.wait(1.0):
            for life in self.newest.values():
                try:
                    life.samples.append((life.age_s, life.process.resident_mb()))
                except (OSError, StopIteration):
                    continue  # it has just been killed

    def _note_warm(self) -> None:
        """A process that has seen each kind of fault twice has had all its buffers full."""
        for life in self.newest.values():
            kinds = [done.kind for done in self.done if done.from_ns > life.process.started_s * 1e9]
            if life.warm_s == float("inf") and all(kinds.count(kind) >= 2 for kind in OFTEN):
                life.warm_s = life.age_s

    def _until(self, due_s: float) -> None:
        while time.monotonic() < due_s:
            for life in self.newest.values():
                assert life.process.running, f"{life.name} ended by itself: {life.process.text[-500:]}"
            time.sleep(0.1)

    def _act(self, fault: Fault, random: Random) -> None:
        """The fault, its end, and the way back to ARMED."""
        done = Done(fault.kind, time.monotonic_ns())
        self.done.append(done)
        try:
            self._do(fault, random)
            done.to_ns = time.monotonic_ns()
            time.sleep(0.3)  # a state from before the fault does not count
            done.back_s = 0.3 + self.cell.await_state("armed", BACK_S)
        except AssertionError as error:
            events = [f"{it.event} ({it.reason})" for it in self.cell.since(SAFETY_EVENT, done.from_ns)]
            self.problems.append(f"{fault.kind} at {fault.at_s:.0f} s: {error}; {events}")
        done.to_ns = time.monotonic_ns()

    def _do(self, fault: Fault, random: Random) -> None:
        what, _, role = fault.kind.partition(" ")
        slave = self.newest["slave"].process
        match what:
            case "freeze":
                self.newest[role].process.send(signal.SIGSTOP)
                time.sleep(fault.lasts_s)
                self.newest[role].process.send(signal.SIGCONT)
            case "kill":
                self._kill(role, random)
            case "emergency":
                self._forefeel("estop")
                self.cell.await_state("estopped", 5.0)
                time.sleep(0.3)
                self._forefeel("clear")
            case _:  # the load cell says NaN until the slave has noticed
                slave.send(signal.SIGUSR1)
                try:
                    self.cell.await_state("fault", 5.0)
                finally:
                    slave.send(signal.SIGUSR1)
                time.sleep(0.1)
                self._forefeel("clear")

    def _kill(self, role: str, random: Random) -> None:
        self.newest[role].process.kill()
        time.sleep(0.5)
        self._start(role, random)
        if role == "recorder":
            path = self.recordings[-1]
            wait_until(lambda: path.exists() and path.stat().st_size > 0, BACK_S, "a new recording")

    def _forefeel(self, command: str) -> None:
        """Runs a command as a person gives it; AssertionError with its words when it fails."""
        process = Process(command, self.cell.folder, command, "--config", "slave.yaml")
        try:
            wait_until(lambda: not process.running, _COMMAND_S, f"end of forefeel {command}")
        finally:
            process.kill()
        assert process.wait() == 0, f"forefeel {command}: {process.text}"

    def _end(self) -> None:
        """Ends all in order; each says 0, and both event logs end with a stop."""
        for role in ("master", "slave", "recorder"):
            process = self.newest[role].process
            process.send(signal.SIGTERM)
            if code := process.process.wait(20):
                self.problems.append(f"the {role} ended with {code}")
        for role in ("slave", "master"):
            if read_events(self.cell.folder / f"state-{role}" / EVENTS)[-1].event != "stop":
                self.problems.append(f"the event log of the {role} does not end with a stop")


def soak(minutes: float, folder: Path) -> Result:
    with LiveCell(folder) as cell:
        run = Soak(cell, _SEED)
        run.run(schedule(_SEED, 60.0 * minutes), 60.0 * minutes)
        wrong = [*run.problems, *map(str, cell.faults)]
    figures = [f"{len(run.done)} faults, armed again after {max(done.back_s for done in run.done):.1f} s"]
    for life in run.lives:
        if (growth := life.growth()) is not None:
            resident_mb, share, span_s = growth
            figures.append(f"{life.name} {resident_mb:.0f} MB {share:+.1%}")
            if share > MOST_GROWTH:
                wrong.append(f"{life.name} grew by {share:.1%} in {span_s:.0f} s")
    disturbed = [(done.from_ns, done.to_ns) for done in run.done]
    for path in run.recordings:
        messages, faulty = check(path, path != run.recordings[-1], disturbed)
        figures.append(f"{messages} messages in {path.name}")
        wrong += [f"{path.name}: {it}" for it in faulty]
    wrong += [f"moved outside ARMED by {it}" for it in run.motion.moved[:3]]
    figures.append(f"{run.motion.resting} forces while nothing was followed")
    return Result("; ".join(figures), wrong)


def check(path: Path, killed: bool, disturbed_ns: Sequence[tuple[int, int]]) -> tuple[int, list[str]]:
    """(messages, what is wrong). `disturbed_ns`: when slave or recorder were kept from their work."""
    try:
        run = Run(path)
    except RecordingError as error:
        return 0, [str(error)]
    messages = sum(run.count(axis, topic) for axis in run.axes for topic in TOPICS)
    wrong = ["cut off"] if run.truncated and not killed else []
    stream = run.stream(AXIS, FORCE) if AXIS in run.axes else Stream()
    stamps_ns = stream.log_ns
    numbers = [int(match.group(1)) for payload in stream.payloads if (match := _NUMBER.search(payload))]
    for i, (a, b) in enumerate(pairwise(numbers)):
        since_ns, until_ns = stamps_ns[i] - _SLACK_NS, stamps_ns[i + 1] + _SLACK_NS
        if b - a > _LOST and not any(since_ns <= to and until_ns >= at for at, to in disturbed_ns):
            wrong.append(f"{b - a - 1} forces lost in a row")
    if len(stamps_ns) == 0:
        wrong.append("no force")
    return messages, wrong
