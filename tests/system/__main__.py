"""`python -m tests.system [PART OF A NAME...]`, as root and by hand: what the service must withstand.

A row each: faults on two hosts at 20 and 300 ms, attacks, signals, a soak, the page for ten minutes. Exit 1:
a requirement is not met.
"""

import argparse
import os
import re
import shlex
import signal
import sys
import time
import traceback
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.system.attacks import page_sockets, wire
from tests.system.faults.cases import faults, stalled
from tests.system.faults.page import cells, figures, written
from tests.system.faults.required import BY_SILENCE_S
from tests.system.faults.scene import Fault, tried
from tests.system.page import page_seen, page_without_growth
from tests.system.rows import Result, Row
from tests.system.signals.trial import random_signals
from tests.system.soak.service import soak


def rows(minutes: float) -> Iterator[Row]:
    """`minutes`: of the soak, and of the page."""
    for fault in faults():
        yield Row(f"fault: {fault.name}", partial(_fault, fault))
    yield Row("fault: an open gate is found out", _open_gate)
    yield from wire.rows()
    yield from page_sockets.rows()
    yield Row("signals: 60 at random times over every command", random_signals)
    yield Row(f"soak: {minutes:g} minutes among random faults", partial(soak, minutes))
    yield Row("page: a run as a person sees it", page_seen)
    yield Row(f"page: {minutes:g} minutes without growth", partial(page_without_growth, 60.0 * minutes))


def _fault(fault: Fault, folder: Path) -> Result:
    row = tried(fault, folder)
    return Result(figures(row), row.failures, cells(row))


def _open_gate(folder: Path) -> Result:
    """What the gate refuses is seen where it is open: the measure itself."""
    lax = {"slave": {"gate": {"watchdog_s": 0.3, "max_age_s": 1.0}}}
    act = partial(stalled, 0.28)
    row = tried(Fault("", act, "", rest_s=BY_SILENCE_S, service={"axis": lax}), folder)
    sought = "stale commands executed", "at rest after"
    missed = [each for each in sought if not any(each in failure for failure in row.failures)]
    return Result(f"{row.stale} stale commands", [f"not found out: {each}" for each in missed])


def _run(row: Row, keep: Path | None) -> Result:
    with TemporaryDirectory(prefix="ff-") as made:
        folder = Path(made)
        if keep is not None:
            folder = keep / re.sub(r"[^\w+-]+", "-", row.name)
            folder.mkdir(parents=True)
        try:
            return row.run(folder)
        except AssertionError as error:
            return Result("", [str(error)[:2000] or traceback.format_exc()])


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.system", description=__doc__)
    parser.add_argument("names", nargs="*", help="parts of names; all rows without any")
    parser.add_argument("--minutes", type=float, default=10.0, help="of the soak and of the page")
    parser.add_argument("--keep", type=Path, help="a folder for recordings and logs")
    parser.add_argument("--list", action="store_true", help="the names alone")
    parser.add_argument("--out", type=Path, help="the page of faults, in which the rows that ran are renewed")
    options = parser.parse_args()
    wanted = [
        row
        for row in rows(options.minutes)
        if not options.names or any(name in row.name for name in options.names)
    ]
    if options.list:
        print(*(row.name for row in wanted), sep="\n")
        return 0
    if os.geteuid() != 0:
        sys.exit("tests.system: making network namespaces needs root")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # in order: hosts and processes go
    start_s, failed, measured = time.monotonic(), list[str](), list[tuple[str, ...]]()
    for row in wanted:
        row_s = time.monotonic()
        result = _run(row, options.keep)
        verdict = "FAILED" if result.failures else "ok"
        print(f"{verdict:6} {time.monotonic() - row_s:4.0f} s  {row.name}: {result.figures}", flush=True)
        print(*(f"         {each}" for each in result.failures), sep="\n", end="\n" * bool(result.failures))
        failed += [row.name] * bool(result.failures)
        measured += [result.cells] * bool(result.cells)
    took_min = (time.monotonic() - start_s) / 60.0
    print(
        f"{len(wanted) - len(failed)} of {len(wanted)} rows as required, {took_min:.0f} min",
        *failed,
        sep="\n  ",
    )
    if options.out is not None:
        command = shlex.join(["python", "-m", "tests.system", *sys.argv[1:]])
        names = [fault.name for fault in faults() if not fault.name.endswith("300 ms")]
        options.out.write_text(written(options.out, measured, names, command, took_min))
    return int(bool(failed) or not wanted)


if __name__ == "__main__":
    sys.exit(main())
