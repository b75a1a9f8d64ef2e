"""What a recording costs by its length: `python -m benchmarks.recording [--minutes 1,4,16] [--rows 5]`.

Runs in virtual time, recorded. Each file is read by a process of its own: two columns of the 1 kHz streams
by this product, the same by the MCAP library alone (its reader and the json of Python), and its report made.
Then a CSV of 5 million rows: `forefeel.load`, and the table by pyarrow alone.
"""

import argparse
import json
import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from mcap.reader import make_reader
from pyarrow import csv

import forefeel as ff
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.topics import FORCE, HAPTICS

_COLUMNS = (FORCE, "force_n"), (HAPTICS, "rendered_n")


def main() -> None:
    """Prints a row for each length."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.recording")
    parser.add_argument("--minutes", default="1,4,16")
    parser.add_argument("--rows", type=float, default=5.0, help="millions in the CSV")
    parser.add_argument("--json", type=Path, help="the figures, too")
    options = parser.parse_args()
    with TemporaryDirectory() as folder:
        rows = [row(Path(folder), float(minutes)) for minutes in options.minutes.split(",")]
        table = csv_row(Path(folder), round(1e6 * options.rows))
    print(text(rows))
    print(csv_text(table))
    if options.json is not None:
        options.json.write_text(json.dumps({"rows": rows, "csv": table}, indent=2))


def row(folder: Path, minutes: float) -> dict[str, float]:
    """Figures of one length."""
    out = folder / f"{minutes:g}"
    words = [
        "loopback",
        "--virtual-time",
        "--duration",
        f"{60 * minutes:g}",
        "--seed",
        "1",
        "--out",
        str(out),
    ]
    made_s, _ = timed(["forefeel", *words])
    file = out / "recording.mcap"
    read_s, read_mb = timed(["benchmarks.recording", "read", str(file)])
    plain_s, plain_mb = timed(["benchmarks.recording", "plain", str(file)])
    report_s, report_mb = timed(
        ["forefeel", "report", str(file), "--out", str(folder / f"report{minutes:g}")]
    )
    return {
        "minutes": minutes, "file_mb": file.stat().st_size / 1e6, "made_s": made_s,
        "read_s": read_s, "read_mb": read_mb, "plain_s": plain_s, "plain_mb": plain_mb,
        "report_s": report_s, "report_mb": report_mb,
    }  # fmt: skip


def csv_row(folder: Path, count: int) -> dict[str, float]:
    """Figures of a CSV file with that many rows at 1 kHz."""
    file = folder / "run.csv"
    t = np.arange(count) / 1000.0
    x = 0.01 * np.sin(t)
    with file.open("w", encoding="ascii") as lines:
        lines.write("time_s,position_m,force_n\n")
        for a in range(0, count, 100_000):
            rows = zip(t[a : a + 100_000], x[a : a + 100_000], strict=True)
            lines.writelines(f"{t:.3f},{x:.7f},{12.0 * x:.5f}\n" for t, x in rows)
    read_s, read_mb = timed(["benchmarks.recording", "load", str(file)])
    plain_s, plain_mb = timed(["benchmarks.recording", "pyarrow", str(file)])
    return {
        "rows": count, "file_mb": file.stat().st_size / 1e6, "read_s": read_s, "read_mb": read_mb,
        "plain_s": plain_s, "plain_mb": plain_mb,
    }  # fmt: skip


def csv_text(row: dict[str, float]) -> str:
    """The line of a CSV file."""
    return (
        f"CSV of {row['rows'] / 1e6:g} million rows, {row['file_mb']:.0f} MB: "
        f"forefeel.load {row['read_s']:.1f} s and {row['read_mb']:.0f} MB, "
        f"pyarrow {version('pyarrow')} alone {row['plain_s']:.1f} s and {row['plain_mb']:.0f} MB, "
        f"ratio {row['read_s'] / row['plain_s']:.2f}"
    )


def timed(words: list[str]) -> tuple[float, float]:
    """Processor time in s and peak of resident memory in MB of `python -m` these words."""
    process = subprocess.Popen([sys.executable, "-m", *words], stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"{' '.join(words)}: exit code {process.returncode}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0


def read(file: Path) -> None:
    """By this product."""
    run = Run(file)
    for topic, column in _COLUMNS:
        run.column(run.axes[0], topic, column)


def plain(file: Path) -> None:
    """By the library alone."""
    with file.open("rb") as stream:
        reader = make_reader(stream)
        for topic, column in _COLUMNS:
            summary = reader.get_summary()
            assert summary is not None
            keys = [each.topic for each in summary.channels.values() if each.topic.endswith(topic.name)]
            found = [json.loads(message.data)[column] for _, _, message in reader.iter_messages(topics=keys)]
            assert found, f"nothing of {topic.name}"


def text(rows: list[dict[str, float]]) -> str:
    """The table."""
    lines = [
        f"{'minutes':>7} {'file MB':>8} {'two columns read, s, MB':>24} "
        f"{'mcap ' + version('mcap') + ', s, MB':>20} {'ratio':>6} {'report, s, MB':>15} "
        f"{'made in virtual time, s':>24}"
    ]
    lines += [
        f"{row['minutes']:7g} {row['file_mb']:8.0f} {row['read_s']:17.1f} {row['read_mb']:6.0f} "
        f"{row['plain_s']:13.1f} {row['plain_mb']:6.0f} {row['read_s'] / row['plain_s']:6.2f} "
        f"{row['report_s']:8.1f} {row['report_mb']:6.0f} {row['made_s']:24.1f}"
        for row in rows
    ]
    return "\n".join(lines)


_READERS = {"read": read, "plain": plain, "load": ff.load, "pyarrow": csv.read_csv}

if __name__ == "__main__":
    if len(sys.argv) == 3 and sys.argv[1] in _READERS:
        _READERS[sys.argv[1]](Path(sys.argv[2]))
    else:
        main()
