"""What viewers cost the cell that they watch: `python -m benchmarks.viewers [--viewers 0,1,2,4,8]`.

One cell through a router, its loops under SCHED_FIFO as root; each viewer is a process of its own that hears
all topics and counts. Viewers run at the lowest priority, as a dashboard does.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.cells import Heard, Laboratory
from forefeel.common.clock import MonotonicClock
from forefeel.common.codec import counted
from forefeel.common.transport.security import Party
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_bus import ZenohTransport

_CELL, _SETTLE_S, _START_S = "cell1", 3.0, 30.0


def main() -> None:
    """Prints a row for each number of viewers."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.viewers")
    parser.add_argument("--viewers", default="0,1,2,4,8")
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--json", type=Path, help="the figures, too")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        laboratory = Laboratory(Path(folder), [_CELL], secured=False, realtime=os.geteuid() == 0)
        with laboratory.running():
            time.sleep(_SETTLE_S)
            rows = [row(laboratory, int(number), options.seconds) for number in options.viewers.split(",")]
    print(text(rows))
    if options.json is not None:
        options.json.write_text(json.dumps({"rows": rows}, indent=2))


def row(laboratory: Laboratory, number: int, seconds: float) -> dict[str, float]:
    """The loops and the processors while so many watch."""
    command = [sys.executable, "-m", "benchmarks.viewers", "watch", laboratory.endpoint, f"{seconds:g}"]
    viewers = [
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for _ in range(number)
    ]
    for each in viewers:
        assert each.stdout is not None
        each.stdout.readline()  # it hears
    with laboratory.watched() as found:
        before_s, start_s = laboratory.busy_s(), time.monotonic()
        for each in viewers:
            print(file=each.stdin, flush=True)  # it counts from now
        time.sleep(seconds)
        heard, busy = found[_CELL], (laboratory.busy_s() - before_s) / (time.monotonic() - start_s)
    rates = [float(each.communicate(timeout=_START_S)[0]) for each in viewers]
    return {"viewers": number, **_loops(heard), "cores": busy, "least_hz": min(rates, default=float("nan"))}


def _loops(heard: Heard) -> dict[str, float]:
    found: dict[str, float] = {}
    for role in ("slave", "master"):
        p50_us, p99_us, missed = heard.lateness(role)
        found |= {f"{role}_p50_us": p50_us, f"{role}_p99_us": p99_us, f"{role}_missed": missed}
    return found | {"armed": heard.armed / max(1, heard.states)}


def watch(endpoint: str, seconds: float) -> None:
    """A viewer; prints how many messages it heard a second."""
    os.nice(19)
    heard = [0]

    def hear(_key: str, payload: bytes, _receive_ns: int) -> None:
        heard[0] += counted(payload)

    settings = TransportSettings(mode="client", connect=(endpoint,))
    transport = ZenohTransport.open(settings, MonotonicClock(), print, Party("viewer", (_CELL,)))
    try:
        transport.subscribe_all(f"forefeel/{_CELL}", hear)
        while not heard[0]:
            time.sleep(0.01)
        print("hears", flush=True)
        sys.stdin.readline()
        first, start_s = heard[0], time.monotonic()
        time.sleep(seconds)
        print((heard[0] - first) / (time.monotonic() - start_s))
    finally:
        transport.close()


def text(rows: Sequence[dict[str, float]]) -> str:
    """The table."""
    lines = [
        "viewers  slave late p50/p99 us, missed  master late p50/p99 us, missed   armed  "
        "router and cell, cores  heard a second"
    ]
    lines += [
        f"{row['viewers']:7.0f} {row['slave_p50_us']:10.0f} /{row['slave_p99_us']:6.0f}, "
        f"{row['slave_missed']:6.2%}   {row['master_p50_us']:12.0f} /{row['master_p99_us']:6.0f}, "
        f"{row['master_missed']:6.2%}  {row['armed']:7.1%} {row['cores']:17.2f} {row['least_hz']:18.0f}"
        for row in rows
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    if sys.argv[1:2] == ["watch"]:
        watch(sys.argv[2], float(sys.argv[3]))
    else:
        main()
