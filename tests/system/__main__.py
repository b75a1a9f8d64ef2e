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
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.system.attacks import page_sockets, wire
from tests.system.faults.cases import faults, shaped
from tests.system.faults.required import BY_SILENCE_S, SLOW
from tests.system.faults.scene import Fault, tried
from tests.system.page import page_seen, page_without_growth
from tests.system.rows import Result, Row
from tests.system.signals.trial import random_signals
from tests.system.soak.service import soak

HEAD = ("fault", "to rest s", "armed again s", "recovery")
MEASURED = "Measured by `make system`\n"
"""What stands before the table in docs/explanation/faults.md."""


def rows(minutes: float) -> Iterator[Row]:
    """`minutes`: of the soak, and of the page."""
    for fault in faults():
        yield Row(f"fault: {fault.name}", partial(tried, fault))
    yield Row("fault: an open gate is found out", _open_gate)
    yield from wire.rows()
    yield from page_sockets.rows()
    yield Row("signals: 60 at random times over every command", random_signals)
    yield Row(f"soak: {minutes:g} minutes among random faults", partial(soak, minutes))
    yield Row("page: a run as a person sees it", page_seen)
    yield Row(f"page: {minutes:g} minutes without growth", partial(page_without_growth, 60.0 * minutes))


def _open_gate(folder: Path) -> Result:
    """Shows that what the gate refuses is seen where it is open: the measure itself."""
    gate = {"slave": {"axis": {"gate": {"watchdog_s": 0.3, "max_age_s": 1.0}}}}
    result = tried(
        Fault("", partial(shaped, 1.0, route=SLOW), "", rest_s=BY_SILENCE_S, service={"extra": gate}), folder
    )
    missed = [
        f"not found out: {sought}"
        for sought in ("stale commands executed", "at rest after")
        if not any(sought in failure for failure in result.failures)
    ]
    return Result(result.figures, missed)


def _renewed(
    page: Path, measured: Sequence[tuple[str, ...]], names: Sequence[str], command: str, took_min: float
) -> str:
    """The page with these rows; those of it that were not measured now, but still exist, stay as they are."""
    before, rest = page.read_text(encoding="utf-8").split(MEASURED)
    _, table, explained = rest.split("\n\n", 2)
    earlier = [tuple(line.strip("| ").split(" | ")) for line in table.splitlines()]
    rows = {row[0]: row for row in [*earlier, *measured]}
    lines = [HEAD, tuple("---" for _ in HEAD), *(rows[name] for name in names if name in rows)]
    table = "\n".join(f"| {' | '.join(row)} |" for row in lines)
    model = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    machine = (
        f"{os.cpu_count()} cores{'' if model is None else f' of {model[1]}'}, Linux {os.uname().release}"
    )
    now = f"{len(measured)} rows by `{command}` in {took_min:.0f} min"
    others = ", the others in earlier runs" if len(measured) < len(names) else ""
    return f"{before}{MEASURED}on {machine}: {now}{others}.\n\n{table}\n\n{explained}"


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
    names = options.names or [""]
    wanted = [row for row in rows(options.minutes) if any(name in row.name for name in names)]
    if options.list:
        print(*(row.name for row in wanted), sep="\n")
        return 0
    if os.geteuid() != 0:
        sys.exit("tests.system: making network namespaces needs root")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # in order: hosts and processes go
    if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN:  # `nohup`: what is started would ignore it, too
        signal.signal(signal.SIGHUP, lambda *_: None)
    start_s, results = time.monotonic(), dict[str, Result]()
    for row in wanted:
        row_s = time.monotonic()
        result = results[row.name] = _run(row, options.keep)
        verdict = "FAILED" if result.failures else "ok"
        print(f"{verdict:6} {time.monotonic() - row_s:4.0f} s  {row.name}: {result.figures}", flush=True)
        for failure in result.failures:
            print(f"         {failure}", flush=True)
    failed = [name for name, result in results.items() if result.failures]
    took_min = (time.monotonic() - start_s) / 60.0
    summary = f"{len(wanted) - len(failed)} of {len(wanted)} rows as required, {took_min:.0f} min"
    print(summary, *failed, sep="\n  ")
    if options.out is not None:
        command = shlex.join(["python", "-m", "tests.system", *sys.argv[1:]])
        measured = [result.cells for result in results.values() if result.cells]
        on_page = [fault.name for fault in faults() if not fault.name.endswith("300 ms")]
        options.out.write_text(_renewed(options.out, measured, on_page, command, took_min))
    return int(bool(failed) or not wanted)


if __name__ == "__main__":
    sys.exit(main())
