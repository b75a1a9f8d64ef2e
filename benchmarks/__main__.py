"""`python -m benchmarks [--only NAME]... [--out FILE]`: all of them in turn, and a page of what they printed,
beside it the same as JSON, with the figures of those that give them. With `--only` the other parts of the
page stay as they are, each with the day, the revision and the versions that it was measured with.

As root, where apt-get is there, the programs that a part needs are installed first; none is left running.
"""

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
import time
from collections.abc import Mapping, Set
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.markdown import revision

_DEBIAN = {"cyclictest": "rt-tests"}
_LIBRARIES = (
    "eclipse-zenoh", "numpy", "pydantic", "mcap", "padasip", "filterpy", "statsmodels", "pysindy",
    "sysidentpy", "reservoirpy", "scikit-learn", "pyzmq", "grpcio",
    "pyserial", "python-can", "canopen",
)  # fmt: skip
_PLACES = os.pathsep.join([os.environ.get("PATH", ""), "/usr/sbin", "/usr/bin"])


@dataclass(frozen=True, slots=True)
class Benchmark:
    """One module, and what it answers. `figures`: it takes `--json FILE`; `words`: further ones; `programs`:
    of `_DEBIAN`, that it starts.
    """

    module: str
    question: str
    figures: bool = False
    words: tuple[str, ...] = ()
    programs: tuple[str, ...] = ()


ALL = (
    Benchmark(
        "message_path",
        "How long does a message take between two processes, with certificates, beside other buses?",
        True,
    ),
    Benchmark(
        "cell",
        "What does a cell cost, and how late are its loops, beside cyclictest?",
        programs=("cyclictest",),
    ),
    Benchmark("estimation", "Identification and prediction, beside padasip, statsmodels, filterpy"),
    Benchmark("prediction", "How far off is the predictor, beside others?", True, words=("--delays", "300")),
    Benchmark("prediction_figure", "The same over the delay: docs/assets/error-over-delay.svg"),
    Benchmark("felt_force", "What does the hand feel at a wall across a delay?"),
    Benchmark(
        "foreign_worlds",
        "How good are prediction and felt force in worlds of others?",
        True,
        words=("--worlds", "coronary,arch"),
    ),
    Benchmark("diagnosis", "How long does a diagnosis take, and how does that grow?"),
    Benchmark("diagnosis_peers", "Which causes are named right, beside PySINDy and sysidentpy?", True),
    Benchmark("recording", "What does a recording cost by its length, beside the MCAP library?", True),
    Benchmark("liars", "Which lies of stage and load cell are faults, and how soon?", words=("liars",)),
    Benchmark("stop", "How long does an emergency stop take from the start of its process?"),
    Benchmark("service", "Start-up, memory, speed of virtual time"),
    Benchmark("cells", "How many cells does this machine carry?"),
    Benchmark("viewers", "What do viewers cost the cell that they watch?", True),
    Benchmark("hardware", "What do the drivers cost beside the raw line?"),
    Benchmark("hardware_service", "The service on simulated and on emulated devices"),
    Benchmark(
        "links",
        "How does the service do over delayed and lost packets, beside the injected run? (root)",
        words=("--links", "default,injected", "--seconds", "20"),
    ),
    Benchmark(
        "reconnect",
        "How long does a session take to open, first and after a cut? (root)",
        words=("--losses", "0", "--times", "3"),
    ),
)


def main() -> int:
    """See the module; 1 when one of them failed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks")
    parser.add_argument("--only", action="append", choices=[each.module for each in ALL])
    parser.add_argument("--out", type=Path, default=Path("benchmarks/RESULTS.md"))
    options = parser.parse_args()
    machine, versions = _machine(), _versions()
    parts = _parts(options.out.with_suffix(".json"), machine) if options.only else {}
    chosen = [each for each in ALL if not options.only or each.module in options.only]
    _install({program for each in chosen for program in each.programs})
    for each in chosen:
        print(f"== {each.module}: {each.question}", flush=True)
        parts[each.module] = _run(each, versions)
        shown = [parts[known.module] for known in ALL if known.module in parts]
        sections = [_section(part, versions) for part in shown]
        options.out.write_text("\n".join([_head(machine, versions), *sections]))
        document = {"machine": machine, "parts": [asdict(part) for part in shown]}
        options.out.with_suffix(".json").write_text(json.dumps(document, indent=1) + "\n")
    return int(any(parts[each.module].code for each in chosen))


@dataclass(frozen=True, slots=True)
class Part:
    """What came of one module, and of which day, revision and versions."""

    module: str
    question: str
    date: str
    revision: str
    minutes: float
    code: int
    lines: list[str]
    figures: object
    versions: dict[str, str]


def _parts(document: Path, machine: Mapping[str, object]) -> dict[str, Part]:
    """What stands already, where it was measured on this kind of machine."""
    if not document.exists():
        return {}
    found = json.loads(document.read_text())
    if found["machine"] != machine:
        raise SystemExit(f"{document}: of another machine; expected another --out")
    return {part["module"]: Part(**part) for part in found["parts"]}


def _machine() -> dict[str, object]:
    model = next(
        (line.partition(":")[2].strip() for line in Path("/proc/cpuinfo").read_text().splitlines()
         if line.startswith("model name")),
        platform.machine(),
    )  # fmt: skip
    return {"processors": os.cpu_count(), "model": model}


def _versions() -> dict[str, str]:
    """Of the system and of all that is measured beside."""
    system = {"Linux": platform.release(), "Python": platform.python_version()}
    return system | {name: _version(name) for name in _LIBRARIES}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "missing"


def _head(machine: Mapping[str, Any], versions: Mapping[str, str]) -> str:
    return (
        f"# Results\n\nWritten by `make bench`: {machine['processors']} processors ({machine['model']}).\n"
        "Each part is what its command printed. Compare within a part: its rows were measured in one run, in "
        f"turns.\n\nVersions, where a part names no others: {_listed(versions)}.\n"
    )


def _listed(versions: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {number}" for name, number in versions.items())


def _run(each: Benchmark, versions: dict[str, str]) -> Part:
    start_s = time.monotonic()
    with TemporaryDirectory() as folder:
        figures = Path(folder) / "figures.json"
        command = [sys.executable, "-m", f"benchmarks.{each.module}", *each.words]
        command += ["--json", str(figures)] if each.figures else []
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        found = json.loads(figures.read_text()) if figures.exists() else None
    print(done.stdout, end="", flush=True)
    lines = done.stdout.rstrip().splitlines()
    if done.returncode != 0:
        lines.append(f"failed: {(done.stderr.strip().splitlines() or ['nothing said'])[-1]}")
        print(lines[-1], flush=True)
    minutes = round((time.monotonic() - start_s) / 60.0, 1)
    date = f"{datetime.now(UTC):%Y-%m-%d}"
    head = each.module, each.question, date, revision(), minutes
    return Part(*head, done.returncode, lines, found, versions)


def _section(part: Part, versions: Mapping[str, str]) -> str:
    """Text of a part; it names the versions that are not those of the head, `versions`."""
    when = f"{part.date}, {part.revision}" if part.revision else part.date
    words = next((each.words for each in ALL if each.module == part.module), ())
    command = " ".join(["python -m", f"benchmarks.{part.module}", *words])
    others = {name: number for name, number in part.versions.items() if versions.get(name) != number}
    with_others = f"; {_listed(others)}" if others else ""
    head = f"## {part.question}\n\n`{command}`, {part.minutes:g} min ({when}{with_others})"
    return "\n".join([head, "", "```", *part.lines, "```", ""])


def _install(programs: Set[str]) -> None:
    """Not started by their packages, only by the benchmark."""
    wanted = [_DEBIAN[program] for program in programs if shutil.which(program, path=_PLACES) is None]
    if not wanted or os.geteuid() != 0 or shutil.which("apt-get") is None:
        return
    environment = {**os.environ, "RUNLEVEL": "1", "DEBIAN_FRONTEND": "noninteractive"}
    for words in (["update", "-qq"], ["install", "-y", "-qq", "--no-install-recommends", *wanted]):
        subprocess.run(["apt-get", *words], env=environment, stdout=subprocess.DEVNULL, check=False)


if __name__ == "__main__":
    sys.exit(main())
