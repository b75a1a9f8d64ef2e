"""The service for a minute on simulated and on emulated devices: `python -m benchmarks.hardware_service`.

Emulated devices speak their real byte protocols on pseudo terminals, each in a process of its own on this
machine, which carries seven processes then.
"""

import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from forefeel.loopback.hardware import HARDWARE

DURATION_S = 60.0


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


def main(duration_s: float = DURATION_S) -> None:
    """Prints one line for each."""
    print(
        f"{'hardware':>16} {'armed %':>8} {'stops':>5} {'slave late, p50 / p99 / max us':>31} {'missed':>6} "
        f"{'force age ms':>12} {'delay p99 ms':>12} {'lost':>5}"
    )
    with TemporaryDirectory() as folder:
        for hardware in HARDWARE:
            report = measured(hardware, Path(folder), duration_s)
            loop, counters = report["loop"]["slave"], report["counters"]
            late = f"{loop['p50_us']:.0f} / {loop['p99_us']:.0f} / {loop['max_us']:.0f}"
            lost = counters["master_forces_dropped"] + counters["recorder_lost"]
            age, delay = _ms(report["force_age_s"]), _ms(report["delay_s"], "p99")
            print(
                f"{hardware:>16} {100.0 * (report['armed_share'] or 0.0):8.1f} {report['stops'] or 0:5d} "
                f"{late:>31} {loop['missed']:6d} {age} {delay} {lost:5d}",
                flush=True,
            )


def _ms(value: Any, key: str = "p50") -> str:  # noqa: ANN401 - a number, or its quantiles
    if isinstance(value, dict):
        found = next((number for name, number in value.items() if name.startswith(key)), None)
    else:
        found = value
    return f"{'-' if found is None else format(1e3 * found, '.2f'):>12}"


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else DURATION_S)
