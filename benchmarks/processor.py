"""What a cell with its recorder costs by process and thread, how late its loops and how old its forces are:
`python -m benchmarks.processor [--rounds 3] [--seconds 20] [--before CHECKOUT]`.

`--before`: another version takes turns with this one, in the same run.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

_SETTLE_S = 3.0  # s from the open session to the measurement
_ROLES = "slave", "master"
_THREADS = {"control": "loop", "haptic": "loop", "rx": "Zenoh", "tx": "Zenoh", "net": "Zenoh", "acc": "Zenoh"}
_READ = """
import json, sys
from pathlib import Path
import numpy as np
from forefeel.common.lateness import quantile_us
from forefeel.common.recording.mcap_reader import read_run
from forefeel.common.topics import HAPTICS, MASTER_TIMING, SLAVE_TIMING
run = read_run(Path(sys.argv[1]))
(axis,) = run.axes
found = {}
for role, topic in (("slave", SLAVE_TIMING), ("master", MASTER_TIMING)):
    last = list(run.messages(axis, topic))[-1]
    for name, share in (("p99", 0.99), ("p99.9", 0.999)):
        found[f"{role} late {name}, us"] = quantile_us(list(last.counts), share)
    found[f"{role} missed, %"] = 100 * last.missed / (last.ticks + last.missed)
for name in ("force_age_s", "delay_s"):
    found[f"{name[:-2]}, ms"] = 1e3 * float(np.nanmedian(run.column(axis, HAPTICS, name)[3000:]))
print(json.dumps(found))
"""


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.processor")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--before", type=Path, help="a checkout of the version before")
    asked = parser.parse_args()
    versions = {"now": Path.cwd()} | ({"before": asked.before.resolve()} if asked.before else {})
    rounds = [
        {name: cell(path, asked.seconds) for name, path in versions.items()} for _ in range(asked.rounds)
    ]
    print(f"{os.cpu_count()} cores, {asked.rounds} rounds of {asked.seconds:g} s, medians; % of a core")
    print(f"{'':34}" + "".join(f"{name:>10}" for name in versions))
    for what in rounds[0]["now"]:
        values = [median(each[name].get(what, 0.0) for each in rounds) for name in versions]
        print(f"{what:34}" + "".join(f"{value:10.1f}" for value in values))


def cell(checkout: Path, seconds: float) -> dict[str, float]:
    """A loopback with the paper's impairment: processor time from `_SETTLE_S` after the session was open."""
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    with TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        words = ["--impairment", "paper", "--seed", "1", "--duration", f"{seconds + 2 * _SETTLE_S:g}"]
        command = [sys.executable, "-m", "forefeel", "loopback", *words, "--out", str(out)]
        run = subprocess.Popen(
            command, cwd=checkout, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        while not (out / "master.log").exists() or "session open" not in (out / "master.log").read_text():
            time.sleep(0.02)
            if run.poll() is not None:
                raise SystemExit(f"the loopback of {checkout} ended")
        time.sleep(_SETTLE_S)
        first, start_s = _spent(run.pid), time.monotonic()
        time.sleep(seconds)
        last, took_s = _spent(run.pid), time.monotonic() - start_s
        run.wait()
        words = [sys.executable, "-c", _READ, str(out / "recording.mcap")]
        read = subprocess.run(words, cwd=checkout, env=environment, capture_output=True, check=True)
    spent = {what: 100 * (last[what] - first.get(what, 0.0)) / took_s for what in sorted(last)}
    return {"all": sum(spent.values()) / 2, **spent, **json.loads(read.stdout)}


def _spent(recorder: int) -> dict[str, float]:
    """Processor time in s since their start of the recorder, its two daemons, and their kinds of threads."""
    found: dict[str, float] = defaultdict(float)
    tick_s = 1 / os.sysconf("SC_CLK_TCK")
    for pid, name in {recorder: "recorder", **dict(_daemons(recorder))}.items():
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        found[name] = rest_s = (int(fields[11]) + int(fields[12])) * tick_s
        for task in Path(f"/proc/{pid}/task").iterdir():
            with suppress(OSError):
                kind = _THREADS.get((task / "comm").read_text().strip().partition("-")[0])
                seconds = int((task / "schedstat").read_text().split()[0]) * 1e-9
                if kind is not None:
                    found[f"  {name}: {kind}"] += seconds
                    rest_s -= seconds
        found[f"  {name}: others, also ended ones"] = rest_s
    return found


def _daemons(recorder: int) -> Iterator[tuple[int, str]]:
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parent = int(stat.read_text().rpartition(")")[2].split()[1])
            words = (stat.parent / "cmdline").read_text().split("\0")
            if parent == recorder:
                yield from ((int(stat.parent.name), role) for role in _ROLES if role in words)


if __name__ == "__main__":
    main()
