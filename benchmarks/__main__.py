"""`python -m benchmarks [--only NAME]... [--out FILE]`: all of them in turn, and a page of what they printed.

As root, where apt-get is there, the brokers and cyclictest are installed first; none is left running.
"""

import argparse
import os
import platform
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

_DEBIAN = {
    "mosquitto": "mosquitto", "nats-server": "nats-server", "redis-server": "redis-server",
    "cyclictest": "rt-tests",
}  # fmt: skip
_PLACES = os.pathsep.join([os.environ.get("PATH", ""), "/usr/sbin", "/usr/bin"])


@dataclass(frozen=True, slots=True)
class Benchmark:
    """One module, and what it answers."""

    module: str
    question: str


ALL = (
    Benchmark("message_path", "How long does a message take between two processes, beside other buses?"),
    Benchmark("lateness", "How late are the loops of the running service, beside cyclictest?"),
    Benchmark("security", "What do certificates and the gate cost?"),
    Benchmark("estimation", "Identification and prediction, beside padasip, statsmodels, filterpy"),
    Benchmark("diagnosis", "How long does a diagnosis take, and how does that grow?"),
    Benchmark("service", "Start-up, memory, speed of virtual time"),
    Benchmark("cells", "How many cells does this machine carry?"),
    Benchmark("hardware_zaber", "The Zaber driver beside the raw line"),
    Benchmark("hardware_cells", "The load cells' drivers beside pyserial alone"),
    Benchmark("hardware_can", "The CAN drivers beside raw frames"),
    Benchmark("hardware_handle", "The handle's link beside a raw echo"),
    Benchmark("hardware_service", "The service on simulated and on emulated devices"),
    Benchmark("lossy_link", "TLS in several connections over a link that loses packets (root)"),
)


def main() -> int:
    """See the module; 1 when one of them failed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks")
    parser.add_argument("--only", action="append", choices=[each.module for each in ALL])
    parser.add_argument("--out", type=Path, default=Path("benchmarks/RESULTS.md"))
    wish = parser.parse_args()
    _install()
    parts, failed = [_head()], 0
    for each in ALL:
        if wish.only and each.module not in wish.only:
            continue
        print(f"== {each.module}: {each.question}", flush=True)
        part, code = _run(each)
        parts.append(part)
        failed += code != 0
        wish.out.write_text("\n".join(parts))
    return int(bool(failed))


def _head() -> str:
    model = next(
        (line.partition(":")[2].strip() for line in Path("/proc/cpuinfo").read_text().splitlines()
         if line.startswith("model name")),
        platform.machine(),
    )  # fmt: skip
    machine = f"{os.cpu_count()} processors ({model}), Linux {platform.release()}"
    return (
        f"# Results\n\nWritten by `make bench` on {datetime.now(UTC):%Y-%m-%d}: {machine}, "
        f"Python {platform.python_version()}. Each part is what its\ncommand printed. Compare within a part: "
        "its rows were measured in one run, in turns.\n"
    )


def _run(each: Benchmark) -> tuple[str, int]:
    start_s = time.monotonic()
    command = [sys.executable, "-m", f"benchmarks.{each.module}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    print(done.stdout, end="", flush=True)
    said = done.stdout.rstrip()
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["nothing said"])[-1]
        print(last, flush=True)
        said = f"{said}\nfailed: {last}".strip()
    took_min = (time.monotonic() - start_s) / 60.0
    head = f"## {each.question}\n\n`python -m benchmarks.{each.module}`, {took_min:.0f} min"
    return f"{head}\n\n```\n{said}\n```\n", done.returncode


def _install() -> None:
    """Not started by their packages, only by the benchmark."""
    wanted = [package for program, package in _DEBIAN.items() if shutil.which(program, path=_PLACES) is None]
    if not wanted or os.geteuid() != 0 or shutil.which("apt-get") is None:
        return
    environment = {**os.environ, "RUNLEVEL": "1", "DEBIAN_FRONTEND": "noninteractive"}
    for words in (["update", "-qq"], ["install", "-y", "-qq", "--no-install-recommends", *wanted]):
        subprocess.run(["apt-get", *words], env=environment, stdout=subprocess.DEVNULL, check=False)


if __name__ == "__main__":
    sys.exit(main())
