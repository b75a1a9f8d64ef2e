"""Connections that say nothing, at a live cell: what they take from it, and how it is after they left."""

import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from forefeel.common.topics import SAFETY_EVENT, SLAVE_STATE
from tests.live_cell import ROOT, LiveCell, Process, limit_descriptors
from tests.system.attacks.outcome import Outcome, witnessed
from tests.waiting import wait_until

NUMBERS = (1_100, 1_024), (20_000, 20_000)
"""Connections, and the descriptors that the slave may open."""
_MOST_OF_ONE = 10_000
"""Connections of one process, for it has too few descriptors for more."""
_EARLY = 1_100
_HELD_S = 5.0
_ARMED = 0.97
_STOP_S, _WATCHED_S, _ARMED_AGAIN_S = 0.3, 0.3, 5.0
_LINES_HZ, _GROWTH_MB = 20.0, 100.0


class Silence:
    """A cell at whose slave strangers hold connections."""

    def __init__(self, cell: LiveCell, outcome: Outcome) -> None:
        self.cell, self.outcome = cell, outcome

    def run_from_start(self, count: int) -> Outcome:
        """They try to connect before the slave listens."""
        strangers = self._strangers(count)
        self.slave = self.cell.start("slave")
        wait_until(lambda: "waiting for a master" in self.slave.log.read_text())
        before = self.slave.resident_mb(), self._lines(), time.monotonic()
        self._stand(strangers, count)
        time.sleep(_HELD_S)
        for each in strangers:
            each.kill()
        self._after(time.monotonic(), *before)
        return self.outcome

    def run(self, count: int, limit: int) -> Outcome:
        self.slave, self.master = self.cell.pair()
        limit_descriptors(self.slave.process.pid, limit)
        before = self.slave.resident_mb(), self._lines(), time.monotonic()
        from_ns, strangers = time.monotonic_ns(), self._strangers(count)
        self._stand(strangers, count)
        time.sleep(_HELD_S)
        states = [each.state.value for each in self.cell.since(SLAVE_STATE, from_ns)]
        self.outcome.armed = states.count("armed") / max(len(states), 1)
        self.outcome.require_in_time(self.outcome.armed >= _ARMED, f"armed {self.outcome.armed:.0%}")
        self._watchdog()
        self._stop()
        for each in strangers:
            each.kill()
        left_s = time.monotonic()
        assert self.cell.start("clear", "clear", "--config", "slave.yaml").process.wait(20) == 0
        self._after(left_s, *before)
        return self.outcome

    def _lines(self) -> int:
        return len(self.slave.log.read_text().splitlines())

    def _strangers(self, count: int) -> list[Process]:
        host, _, port = self.cell.endpoint.partition("/")[2].rpartition(":")
        parts = -(-count // _MOST_OF_ONE)
        words = host, port, str(count // parts)
        return [
            self.cell.start(f"stranger{i}", *words, module="tests.system.attacks.silent")
            for i in range(parts)
        ]

    def _stand(self, strangers: list[Process], count: int) -> None:
        wait_until(lambda: all("connections" in each.log.read_text() for each in strangers))
        stand = sum(int(each.log.read_text().split()[0]) for each in strangers)
        self.outcome.require(stand == count, f"only {stand} connections")

    def _watchdog(self) -> None:
        """A master that is gone is noticed as ever."""
        start_s = time.monotonic()
        self.master.kill()
        wait_until(lambda: "watchdog" in self._told(start_s), what="watchdog")
        took_s = time.monotonic() - start_s
        self.outcome.require_in_time(took_s <= _WATCHED_S, f"watchdog after {took_s:.2f} s")
        self.outcome.told = Counter(self._told(start_s))

    def _told(self, since_s: float) -> list[str]:
        return [each.event for each in self.cell.since(SAFETY_EVENT, int(since_s * 1e9))]

    def _stop(self) -> None:
        """`forefeel estop` on the slave's host, from the start of its process to its end."""
        start_s = time.monotonic()
        done = subprocess.run(
            [sys.executable, "-m", "forefeel", "estop", "--config", "slave.yaml"],
            cwd=self.cell.folder, env={**os.environ, "PYTHONPATH": str(ROOT)},
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        took_s = time.monotonic() - start_s
        self.outcome.note += f" local stop in {took_s * 1e3:.0f} ms,"
        self.outcome.require(done.returncode == 0, f"no stop: {done.stdout} {done.stderr}")
        self.outcome.require_in_time(took_s <= _STOP_S, f"the stop took {took_s:.2f} s")

    def _after(self, left_s: float, resident_mb: float, lines: int, start_s: float) -> None:
        self.cell.start("master")
        self.cell.await_state("armed")
        took_s, self.outcome.ends = time.monotonic() - left_s, "armed"
        self.outcome.require_in_time(took_s <= _ARMED_AGAIN_S, f"a new master was armed after {took_s:.1f} s")
        grown_mb = self.slave.resident_mb() - resident_mb
        self.outcome.require(grown_mb <= _GROWTH_MB, f"the slave grew by {grown_mb:.0f} MB")
        rate_hz = (self._lines() - lines) / (time.monotonic() - start_s)
        self.outcome.require(rate_hz <= _LINES_HZ, f"{rate_hz:.0f} lines a second in its log")
        self.outcome.note += (
            f" a new master armed after {took_s:.1f} s, grew {grown_mb:.1f} MB, {rate_hz:.1f} lines a second"
        )
        newest = self.cell.newest_state()
        closed = newest[1].counters.get("connections_closed", 0) if newest else 0
        self.outcome.counters = {"connections_closed": closed}


def silent(wanted: str, most: int) -> Iterator[Outcome]:
    """Each number up to `most` that is wanted, on a pair of processes of its own with certificates."""
    for count, limit in NUMBERS:
        name = f"{count} connections that say nothing, {limit} descriptors"
        if wanted in name and count <= most:
            yield _row(name, partial(Silence.run, count=count, limit=limit))
    name = f"{_EARLY} connections that say nothing, before the slave listens"
    if wanted in name and most >= _EARLY:
        yield _row(name, partial(Silence.run_from_start, count=_EARLY))


def _row(name: str, run: Callable[[Silence], Outcome]) -> Outcome:
    with tempfile.TemporaryDirectory() as folder, LiveCell(Path(folder), pki=True) as cell:
        return witnessed(lambda: run(Silence(cell, Outcome(name, "TCP"))))
