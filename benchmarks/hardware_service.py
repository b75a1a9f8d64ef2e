"""The service on simulated and on emulated devices:
`python -m benchmarks.hardware_service [ROUNDS [SECONDS]]`.

Emulated devices speak their real byte protocols on pseudo terminals, each in a process of its own on this
machine, which carries seven processes then.
"""

import json
import subprocess
import sys
from collections.abc import Iterable
from math import nan
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from forefeel.loopback.hardware import HARDWARE

ROUNDS, DURATION_S = 3, 30.0  # runs, and s of each
_LOST = "master_forces_dropped", "recorder_lost"


def measured(hardware: str, folder: Path, duration_s: float) -> dict[str, Any]:
    """The report of one run."""
    out = folder / hardware
    words = ["--hardware", hardware, "--duration", f"{duration_s:g}", "--seed", "1", "--out", str(out)]
    done = subprocess.run(
        [sys.executable, "-m", "forefeel", "loopback", *words], capture_output=True, text=True, check=False
    )
    if not (out / "report.json").exists():
        raise SystemExit(done.stderr)
    found: dict[str, Any] = json.loads((out / "report.json").read_text())
    return found


def main(rounds: int = ROUNDS, duration_s: float = DURATION_S) -> None:
    """Prints one line for each: medians over the rounds, which take turns, and the stops of every round."""
    reports: dict[str, list[dict[str, Any]]] = {hardware: [] for hardware in HARDWARE}
    for _ in range(rounds):
        for hardware, found in reports.items():
            with TemporaryDirectory() as folder:
                found.append(measured(hardware, Path(folder), duration_s))
    print(
        f"{f'{rounds} x {duration_s:g} s':>16} {'armed %':>8} {'stops':>9} {'late, p50 / p99 / max us':>25} "
        f"{'missed':>6} {'force age ms':>12} {'delay p99 ms':>12} {'lost':>5}"
    )
    for hardware, found in reports.items():
        print(row(hardware, found))


def row(hardware: str, found: list[dict[str, Any]]) -> str:
    """The line of one hardware; late is the slave's loop."""
    loops = [report["loop"]["slave"] for report in found]
    armed = middle(report["armed_share"] for report in found)
    stops = " ".join(str(report["stops"]) for report in found)
    late = " / ".join(f"{middle(each[key] for each in loops):.0f}" for key in ("p50_us", "p99_us", "max_us"))
    missed = middle(each["missed"] for each in loops)
    age_s = middle((report["force_age_s"] or {}).get("p50") for report in found)
    delay_s = middle((report["delay_s"] or {}).get("p99") for report in found)
    lost = sum(report["counters"][key] for report in found for key in _LOST)
    return (
        f"{hardware:>16} {100.0 * armed:8.1f} {stops:>9} {late:>25} "
        f"{missed:6.0f} {1e3 * age_s:12.2f} {1e3 * delay_s:12.2f} {lost:5d}"
    )


def middle(values: Iterable[float | None]) -> float:
    """The median of those that are known."""
    known = [value for value in values if value is not None]
    return median(known) if known else nan


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:2]), *(float(word) for word in sys.argv[2:3]))
