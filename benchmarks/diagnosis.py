"""Run time and memory of a diagnosis by the length of the recording: `python -m benchmarks.diagnosis`.

Each length is a Parquet file that a process of its own reads and diagnoses on one core: strokes of a hand
at 1 kHz with dry friction and a slow load cell, 2 mN of noise with a corner of 20 Hz. The ratio is to one
least squares of as many samples on twelve columns (numpy), the work that every method has to do.
"""

import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow
from pyarrow import parquet
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from forefeel.common.error_size import Floats
from forefeel.common.recording.loading import load_recording
from forefeel.common.recording.recording import Recording

RATE_HZ = 1000.0  # Hz, rate of the recordings: that of the service's streams
LENGTHS_S = 10.0, 30.0, 120.0, 600.0, 3600.0  # s, lengths of the recordings: seconds to an hour
_ONE_CORE = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def recording(duration_s: float) -> Recording:
    """Strokes with several amplitudes and speeds that never repeat."""
    t = np.arange(int(duration_s * RATE_HZ)) / RATE_HZ
    rng = np.random.default_rng(7)
    x = np.zeros_like(t)
    for frequency, size in ((0.11, 6e-3), (0.31, 4e-3), (0.83, 1.5e-3), (2.3, 4e-4), (6.1, 6e-5)):
        wander = np.interp(t, np.arange(0.0, duration_s + 4.0, 2.0), _walk(rng, duration_s))
        x += size * np.sin(2.0 * np.pi * frequency * t + wander)
    x = gaussian_filter1d(x, 0.02 * RATE_HZ)
    v = np.gradient(x, 1.0 / RATE_HZ)
    force = 0.05 * np.gradient(v, 1.0 / RATE_HZ) + 2.0 * v + 25.0 * x + 0.06 * np.sign(v)
    decay = float(np.exp(-1.0 / (0.03 * RATE_HZ)))
    force = lfilter([1.0 - decay], [1.0, -decay], force)
    pole = float(np.exp(-2.0 * np.pi * 20.0 / RATE_HZ))
    noise = lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], rng.standard_normal(len(t)))
    measured = 1e-6 * np.round((x + 3e-7 * rng.standard_normal(len(t))) / 1e-6)
    return Recording("strokes", t, measured, np.asarray(force + 0.002 * noise), "benchmark")


def _walk(rng: np.random.Generator, duration_s: float) -> Floats:
    """A phase that wanders, every 2 s."""
    return np.asarray(np.cumsum(0.8 * rng.standard_normal(len(np.arange(0.0, duration_s + 4.0, 2.0)))))


def measure(path: Path) -> None:
    """One file, in this process; prints JSON."""
    from forefeel.diagnosis.diagnose import diagnose  # noqa: PLC0415 - not in the process that only prints

    made = load_recording(path)
    assert made.force_n is not None
    start_s = time.process_time()
    found = diagnose(made).diagnosis
    took_s = time.process_time() - start_s
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0  # before the peer, which needs more
    rows = np.random.default_rng(0).standard_normal((len(made), 12))
    start_s = time.process_time()
    np.linalg.lstsq(rows, made.force_n, rcond=None)
    peer_s = time.process_time() - start_s
    names = [cause.name for cause in found.causes]
    print(json.dumps({"samples": len(made), "s": took_s, "peer": peer_s, "mb": peak_mb, "names": names}))


def written(folder: Path, duration_s: float) -> Path:
    """A Parquet file of that length."""
    made, path = recording(duration_s), folder / f"{duration_s:g}s.parquet"
    columns = {"time_s": made.time_s, "position_m": made.position_m, "force_n": made.force_n}
    parquet.write_table(pyarrow.table(columns), path)
    return path


def main() -> None:
    """Prints one line for each length."""
    print(f"{'samples':>9} {'CPU s':>7} {'s per 30,000':>13} {'to one lstsq':>13} {'peak MB':>8}  named")
    with TemporaryDirectory() as folder:
        for duration_s in LENGTHS_S:
            path = written(Path(folder), duration_s)
            line = subprocess.run(
                [sys.executable, "-m", "benchmarks.diagnosis", str(path)],
                env={**os.environ, **_ONE_CORE}, capture_output=True, text=True, check=True,
            ).stdout  # fmt: skip
            got = json.loads(line)
            each = got["s"] / got["samples"] * 30_000.0
            print(
                f"{got['samples']:9d} {got['s']:7.2f} {each:13.2f} {got['s'] / max(got['peer'], 1e-9):13.0f} "
                f"{got['mb']:8.0f}  {', '.join(got['names'])}",
                flush=True,
            )


if __name__ == "__main__":
    if len(sys.argv) > 1:
        measure(Path(sys.argv[1]))
    else:
        main()
