"""What a cell with its recorder costs by process and thread, how late its loops are beside `cyclictest` of
Debian's rt-tests, and how old its forces: as root, `python -m benchmarks.cell [--rounds 3] [--seconds 20]
[--before CHECKOUT]`.

Service and cyclictest take turns, both with SCHED_FIFO 50, 1 kHz and locked memory. cyclictest does nothing
in its loop; the service does all its work on the same processors. `--before`: another version takes turns,
too.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np

_SHARES = {"p99": 0.99, "p99.9": 0.999}
_MOST_US = 100_000  # us, end of cyclictest's histogram
_SETTLE_S = 3.0  # s from the open session to the measurement
_ROLES = "slave", "master"
_THREADS = {"control": "loop", "haptic": "loop", "rx": "Zenoh", "tx": "Zenoh", "net": "Zenoh", "acc": "Zenoh"}
_READ = """
import json, sys
from pathlib import Path
import numpy as np
from forefeel.common.lateness import quantile_us
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.topics import HAPTICS, MASTER_TIMING, SLAVE_TIMING
run = Run(Path(sys.argv[1]))
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
    parser = argparse.ArgumentParser(prog="python -m benchmarks.cell")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--before", type=Path, help="a checkout of the version before")
    asked = parser.parse_args()
    if shutil.which("cyclictest") is None:
        sys.exit("benchmarks.cell: cyclictest is not installed; expected Debian's rt-tests")
    versions = {"now": Path.cwd()} | ({"before": asked.before.resolve()} if asked.before else {})
    print(f"{os.cpu_count()} cores, {asked.rounds} rounds of {asked.seconds:g} s, medians; % of a core")
    for machine, neighbour in (("quiet", nullcontext()), ("beside a program that only computes", busy())):
        with neighbour:
            table(machine, versions, asked.rounds, asked.seconds)


def table(machine: str, versions: Mapping[str, Path], rounds: int, seconds: float) -> None:
    """Prints a line for each quantity, a column for each version; the lateness also as a ratio to that of
    cyclictest in the same round.
    """
    found: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for _ in range(rounds):
        bare = cyclictest(seconds)
        for name, checkout in versions.items():
            for what, value in cell(checkout, seconds).items():
                found[what][name].append(value)
            for share, late_us in bare.items():
                found[f"cyclictest late {share}, us"][name].append(late_us)
                for role in _ROLES:
                    value = found[f"{role} late {share}, us"][name][-1]
                    found[f"{role} late {share} / cyclictest"][name].append(value / late_us)
    print(f"\n{machine:40}" + "".join(f"{name:>10}" for name in versions))
    for what, values in found.items():
        print(f"{what:40}" + "".join(f"{median(values[name] or [0.0]):10.1f}" for name in versions))


@contextmanager
def busy() -> Iterator[None]:
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as process:
        try:
            yield
        finally:
            process.kill()


def cyclictest(seconds: float) -> dict[str, float]:
    """Lateness in us by share, of a loop that does nothing, with the machine for itself."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "found.json"
        words = ["--quiet", "--mlockall", "--policy=fifo", "--priority=50", "--interval=1000", "--threads=1"]
        bounds = [f"--duration={round(seconds)}s", f"--histogram={_MOST_US}", f"--json={file}"]
        subprocess.run(["cyclictest", *words, *bounds], check=True, stdout=subprocess.DEVNULL)
        counts = json.loads(file.read_text())["thread"]["0"]["histogram"]
    late_us = np.sort(np.repeat([int(each) for each in counts], list(counts.values())))
    return {name: float(np.quantile(late_us, share)) + 0.5 for name, share in _SHARES.items()}


def cell(checkout: Path, seconds: float) -> dict[str, float]:
    """A loopback with the paper's impairment: processor time from `_SETTLE_S` after the session was open."""
    environment = os.environ | {"PYTHONPATH": f"{checkout / 'src'}:{checkout}"}
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
