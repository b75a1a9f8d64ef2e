"""How late the loops of a running service are, beside `cyclictest` of Debian's rt-tests: as root,
`python -m benchmarks.lateness [--rounds N] [--seconds S] [--json FILE]`.

Service and cyclictest take turns, on a quiet machine and with a busy neighbour, a program that computes on
one processor. Both have SCHED_FIFO 50, 1 kHz and locked memory; cyclictest does nothing in its loop and has
the machine for itself, the service does all its work on the same processors.
"""

import argparse
import json
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np

from forefeel.common.lateness import quantile_us
from forefeel.common.recording.mcap_reader import read_run
from forefeel.common.topics import MASTER_TIMING, SLAVE_TIMING

_ROUNDS, _SECONDS = 5, 60.0  # runs of each, and s of a run
_QUANTILES = 0.50, 0.99, 0.999  # the median, 1 tick in 100, and 1 in 1000
_MOST_US = 100_000  # us, end of cyclictest's histogram
Late = tuple[float, float, float]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.lateness")
    parser.add_argument("--rounds", type=int, default=_ROUNDS)
    parser.add_argument("--seconds", type=float, default=_SECONDS)
    parser.add_argument("--json", type=Path, help="the figures, too")
    options = parser.parse_args()
    if shutil.which("cyclictest") is None:
        sys.exit("benchmarks.lateness: cyclictest is not installed; expected Debian's rt-tests")
    rows = []
    for neighbour in (False, True):
        with busy(neighbour):
            rounds = [measured(options.seconds) for _ in range(options.rounds)]
        rows += table("busy neighbour" if neighbour else "quiet", rounds)
    print(text(rows))
    if options.json is not None:
        options.json.write_text(json.dumps({"rows": rows}, indent=2))


def measured(seconds: float) -> dict[str, Late]:
    """One round: (p50, p99, p99.9) in us of each."""
    found = {"cyclictest": cyclictest(seconds)}
    with TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        words = ["--duration", f"{seconds:g}", "--seed", "1", "--impairment", "paper", "--out", str(out)]
        done = subprocess.run(
            [sys.executable, "-m", "forefeel", "loopback", *words],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            raise SystemExit(done.stderr)
        run = read_run(out / "recording.mcap")
        for role, topic in (("slave", SLAVE_TIMING), ("master", MASTER_TIMING)):
            last = list(run.messages(run.axes[0], topic))[-1]
            p50, p99, p999 = (quantile_us(list(last.counts), q) for q in _QUANTILES)
            found[role] = p50, p99, p999
    return found


def cyclictest(seconds: float) -> Late:
    """(p50, p99, p99.9) in us of a `cyclictest` with one thread."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "found.json"
        subprocess.run(
            ["cyclictest", "--quiet", "--mlockall", "--policy=fifo", "--priority=50", "--interval=1000",
             "--threads=1", f"--duration={round(seconds)}s", f"--histogram={_MOST_US}", f"--json={file}"],
            check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        counts: Mapping[str, int] = json.loads(file.read_text())["thread"]["0"]["histogram"]
    return quantiles({int(late_us): count for late_us, count in counts.items()})


def quantiles(counts: Mapping[int, int]) -> Late:
    """Quantiles of counted whole us: each is the middle of the microsecond that holds it."""
    late_us = np.array(sorted(counts))
    total = np.cumsum([counts[each] for each in late_us])
    p50, p99, p999 = (float(late_us[np.searchsorted(total, q * total[-1])]) + 0.5 for q in _QUANTILES)
    return p50, p99, p999


def table(machine: str, rounds: list[dict[str, Late]]) -> list[dict[str, object]]:
    """A row for each: medians over the rounds, and of the ratios of a round."""
    return [
        {
            "machine": machine, "what": name,
            **{f"{key}_us": median(each[name][at] for each in rounds)
               for at, key in enumerate(("p50", "p99", "p999"))},
            "ratio_p99": median(each[name][1] / each["cyclictest"][1] for each in rounds),
        }
        for name in rounds[0]
    ]  # fmt: skip


def text(rows: list[dict[str, object]]) -> str:
    """The table."""
    lines = [f"{'':>15} {'':>11} {'p50':>7} {'p99':>7} {'p99.9':>7} us {'ratio of p99':>13}"]
    lines += [
        f"{row['machine']:>15} {row['what']:>11} {row['p50_us']:7.0f} {row['p99_us']:7.0f} "
        f"{row['p999_us']:7.0f}    {row['ratio_p99']:13.2f}"
        for row in rows
    ]
    return "\n".join(lines)


@contextmanager
def busy(neighbour: bool) -> Iterator[None]:
    """With a program that only computes, or without."""
    if not neighbour:
        yield
        return
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as process:
        try:
            yield
        finally:
            process.kill()


if __name__ == "__main__":
    main()
