"""Several cells on one machine through one router: how many run before their loops suffer, and whether one
hears or commands another: `python -m benchmarks.cells [--cells 1,2,4,8] [--seconds 8] [--realtime]`.

Each cell is a slave with simulated devices and a master with the synthetic operator, in processes of their
own. Loops run under normal scheduling, so that 16 of them do not stop the machine; `--realtime` asks for
SCHED_FIFO.
"""

import argparse
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import yaml

from forefeel.common.bus import Bus
from forefeel.common.clock import MonotonicClock
from forefeel.common.lateness import quantile_us
from forefeel.common.messages import LoopTiming, SafetyState, SlaveState
from forefeel.common.topics import COMMAND, MASTER_TIMING, SLAVE_STATE, SLAVE_TIMING, Role
from forefeel.common.transport.security import Party
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_bus import ZenohTransport
from tests.secured import make_pki

_AXIS = "insertion"
_START_S = 120.0  # s until a daemon must be ready
_SETTLE_S = 3.0  # s from the last start to the measurement
_FORGED_COMMANDS = 200  # commands to another cell
_MALFORMED = "malformed_master_command"
_TIMINGS = {"slave": SLAVE_TIMING, "master": MASTER_TIMING}


@dataclass
class Heard:
    """What one cell published while it was watched."""

    armed: int = 0
    states: int = 0
    state: SlaveState | None = None
    first: dict[Role, LoopTiming] = field(default_factory=dict)
    last: dict[Role, LoopTiming] = field(default_factory=dict)

    def on_state(self, state: SlaveState, receive_ns: int) -> None:
        """Counts where the stage follows."""
        del receive_ns
        self.states += 1
        self.armed += state.state is SafetyState.ARMED
        self.state = state

    def on_timing(self, role: Role, timing: LoopTiming, receive_ns: int) -> None:
        """Keeps the first and the newest."""
        del receive_ns
        self.first.setdefault(role, timing)
        self.last[role] = timing

    def malformed(self) -> int:
        """Commands that the slave could not read."""
        return 0 if self.state is None else self.state.counters.get(_MALFORMED, 0)

    def lateness(self, role: Role) -> tuple[float, float, float]:
        """p50 and p99 in us and the share of deadlines missed between the first and the newest report."""
        if role not in self.first or self.first[role] is self.last[role]:
            return float("nan"), float("nan"), float("nan")
        first, last = self.first[role], self.last[role]
        counts = [after - before for before, after in zip(first.counts, last.counts, strict=True)]
        ticks, missed = last.ticks - first.ticks, last.missed - first.missed
        return quantile_us(counts, 0.5), quantile_us(counts, 0.99), missed / max(1, ticks + missed)


class Laboratory:
    """One router and its cells; nothing of it is left at the end."""

    def __init__(self, folder: Path, cells: Sequence[str], secured: bool, realtime: bool) -> None:
        self.folder, self.cells, self.secured = folder, cells, secured
        self._priority = 50 if realtime else 0
        self._processes = list[int]()
        with socket.create_server(("127.0.0.1", 0)) as probe:
            self.endpoint = f"{'tls' if secured else 'tcp'}/127.0.0.1:{probe.getsockname()[1]}"
        if secured:
            make_pki(folder / "pki", [*cells, "spare"])  # spare: a folder for each cell

    def transport(self, cell: str) -> TransportSettings:
        """How a session of that cell reaches the router."""
        pki = self.folder / "pki" / cell if self.secured else None
        return TransportSettings(mode="client", connect=(self.endpoint,), pki=pki)

    @contextmanager
    def running(self) -> Iterator[None]:
        """The router, then every slave, then every master; until all have a session."""
        with ExitStack() as started:
            pki = str(self.folder / "pki") if self.secured else None
            transport = {"listen": [self.endpoint], "pki": pki}
            path = self.folder / "router.yaml"
            path.write_text(yaml.safe_dump({"cells": list(self.cells), "transport": transport}))
            self._start(started, "router", ["router", "--config", str(path)], "listening")
            for role, ready in (("slave", "waiting for a master"), ("master", "session open")):
                logs = [self._daemon(started, role, cell) for cell in self.cells]
                for log in logs:
                    _wait_for(log, ready)
            yield

    def _daemon(self, started: ExitStack, role: str, cell: str) -> Path:
        settings = {
            "role": role,
            "cell": cell,
            "realtime": {"priority": self._priority},
            "transport": self.transport(cell).model_dump(mode="json"),
        }
        path = self.folder / f"{cell}-{role}.yaml"
        path.write_text(yaml.safe_dump(settings | ({"peer_timeout_s": None} if role == "master" else {})))
        return self._start(started, f"{cell}-{role}", [role, "--config", str(path)], "")

    def _start(self, started: ExitStack, name: str, words: Sequence[str], ready: str) -> Path:
        log = self.folder / f"{name}.log"
        environment = {**os.environ, "XDG_STATE_HOME": str(self.folder / "state")}
        with log.open("wb") as file:
            process = subprocess.Popen(
                [sys.executable, "-m", "forefeel", *words], stdout=file, stderr=file, env=environment
            )
        started.callback(_end, process)
        self._processes.append(process.pid)
        _wait_for(log, ready)
        return log

    def busy_s(self) -> float:
        """Processor time of all its processes, in s."""
        ticks = 0
        for process in self._processes:
            fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
            ticks += int(fields[11]) + int(fields[12])
        return ticks / os.sysconf("SC_CLK_TCK")

    @contextmanager
    def watched(self) -> Iterator[dict[str, Heard]]:
        """Every cell as a viewer of it hears it."""
        clock, found = MonotonicClock(), {cell: Heard() for cell in self.cells}
        with ExitStack() as opened:
            for cell, heard in found.items():
                transport = self.session(cell, "viewer")
                opened.callback(transport.close)
                bus = Bus(transport, cell, _AXIS, clock)
                bus.subscribe(SLAVE_STATE, heard.on_state)
                for role in ("slave", "master"):
                    bus.subscribe(_TIMINGS[role], partial(heard.on_timing, role))
            yield found

    def session(self, cell: str, role: str) -> ZenohTransport:
        """A session of that role of that cell."""
        party = Party("viewer" if role == "viewer" else "master", (cell,))
        return ZenohTransport.open(self.transport(cell), MonotonicClock(), print, party)


def _wait_for(log: Path, text: str) -> None:
    deadline_s = time.monotonic() + _START_S
    while text not in log.read_text():
        if time.monotonic() > deadline_s:
            raise SystemExit(f"{log.name}: no {text!r} within {_START_S:g} s: {log.read_text()[-300:]}")
        time.sleep(0.05)


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(20)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def main() -> None:
    """Prints a row for each number of cells, then the isolation of the last."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", default="1,2,4,8")
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--realtime", action="store_true")
    wanted = parser.parse_args()
    numbers = [int(word) for word in wanted.cells.split(",")]
    print(f"{os.cpu_count()} cores, Python {sys.version.split()[0]}, {wanted.seconds:g} s each, worst cell")
    print("cells link  slave late p50/p99 us, missed   master late p50/p99 us, missed   armed  processor")
    for secured in (False, True):
        for number in numbers:
            _measure(number, secured, wanted.seconds, wanted.realtime, isolation=number == numbers[-1])


def _measure(number: int, secured: bool, seconds: float, realtime: bool, isolation: bool) -> None:
    cells = [f"cell{index}" for index in range(1, number + 1)]
    with tempfile.TemporaryDirectory() as folder:
        laboratory = Laboratory(Path(folder), cells, secured, realtime)
        with laboratory.running():
            time.sleep(_SETTLE_S)
            before, start_s = laboratory.busy_s(), time.monotonic()
            with laboratory.watched() as found:
                time.sleep(seconds)
                busy = (laboratory.busy_s() - before) / (time.monotonic() - start_s)
                _print_row(number, secured, list(found.values()), busy)
                if isolation and number > 1:
                    _print_isolation(laboratory, found)


def _print_row(number: int, secured: bool, found: Sequence[Heard], busy: float) -> None:
    parts = []
    for role in ("slave", "master"):
        p50_us, p99_us, missed = (
            max(column) for column in zip(*(h.lateness(role) for h in found), strict=True)
        )
        parts.append(f"{p50_us:8.0f} /{p99_us:8.0f}, {missed:6.1%}    ")
    armed = min(heard.armed / max(1, heard.states) for heard in found)
    link = "mTLS" if secured else "TCP "
    print(f"{number:5} {link}   {'      '.join(parts)}   {armed:5.1%}  {busy:4.2f} cores", flush=True)


def _print_isolation(laboratory: Laboratory, found: dict[str, Heard]) -> None:
    """What the first cell's viewer hears with a wildcard, and what its master's commands do to the second."""
    mine, other = laboratory.cells[:2]
    wildcards = {f"forefeel/{part}": set[str]() for part in (mine, other)} | {"forefeel": set[str]()}
    viewer, master = laboratory.session(mine, "viewer"), laboratory.session(mine, "master")
    try:
        for prefix, keys in wildcards.items():
            viewer.subscribe_all(prefix, partial(_note, keys))
        reached = {cell: _forge(master, cell, found[cell]) for cell in (mine, other)}
    finally:
        viewer.close()
        master.close()
    how = "keys and access control" if laboratory.secured else "keys alone"
    print(f"  isolation by {how}, a viewer and a master of {mine}:")
    for prefix, keys in wildcards.items():
        print(f"  {prefix}/** hears {', '.join(sorted(keys)) or 'nothing'}")
    for cell, count in reached.items():
        print(f"  of {_FORGED_COMMANDS} forged commands to {cell} its slave got {count}")


def _note(cells: set[str], key: str, _payload: bytes, _receive_ns: int) -> None:
    cells.add(key.split("/")[1])


def _forge(master: ZenohTransport, cell: str, heard: Heard) -> int:
    """How many unreadable commands reach that cell's slave."""
    before, put = heard.malformed(), master.publisher(COMMAND.taken_key(cell, _AXIS), COMMAND.qos)
    time.sleep(0.5)
    for _ in range(_FORGED_COMMANDS):
        put(b"forged")
        time.sleep(0.002)
    time.sleep(1.0)
    return heard.malformed() - before


if __name__ == "__main__":
    main()
