"""Random signals at random times over every command on a busy machine: `python -m tests.system.signals`.

Prints a line for each that is not as it should be, and a table. Exit 1 when there is one.
"""

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.system.signals.cases import CASES
from tests.system.signals.scene import scene
from tests.system.signals.trial import BOUND_S, Ended, Trial, run_all, trials


def main(arguments: Sequence[str] | None = None) -> int:
    """0 when every command ended in order, in time, with nothing half-written."""
    parser = argparse.ArgumentParser(prog="python -m tests.system.signals", description=__doc__)
    parser.add_argument("--count", type=int, default=300, help="signals")
    parser.add_argument("--seed", type=int, default=1, help="of commands, signals and times")
    parser.add_argument("--only", default="", help="only commands whose name contains this")
    options = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # in order: the slave and the devices go, too
    with TemporaryDirectory(prefix="forefeel-") as name:
        ready = Path(name) / "ready"
        ready.mkdir()
        with scene(ready, computing=os.cpu_count() or 1) as port:
            wanted = [t for t in trials(options.count, options.seed) if options.only in t.case.name]
            found = run_all(wanted, ready, port, Path(name), _print)
    print(table(found))
    return int(any(_wrong(ended) for _, ended in found))


def _print(trial: Trial, ended: Ended) -> None:
    print(f"{trial}: code {ended.code}, {ended.seconds:.2f} s, {ended.last[:90]}")
    for each in _wrong(ended):
        print(f"    WRONG: {each}")
    sys.stdout.flush()


def _wrong(ended: Ended) -> tuple[str, ...]:
    late = (f"ended after {ended.seconds:.2f} s",) if ended.seconds > BOUND_S else ()
    return (*late, *ended.wrong)


def table(found: Sequence[tuple[Trial, Ended]]) -> str:
    """For each command how often, its codes and the longest time to its end."""
    rows = [f"{'command':26}  count  wrong  longest  codes"]
    for case in CASES:
        ends = [ended for trial, ended in found if trial.case is case]
        if ends:
            codes = ", ".join(map(str, sorted({ended.code for ended in ends})))
            wrong = sum(bool(_wrong(ended)) for ended in ends)
            longest_s = max(ended.seconds for ended in ends)
            rows.append(f"{case.name:26}  {len(ends):5}  {wrong:5}  {longest_s:5.2f} s  {codes}")
    wrong = sum(bool(_wrong(ended)) for _, ended in found)
    return "\n".join([*rows, f"{len(found)} signals, {wrong} not as they should be (bound {BOUND_S:g} s)"])


if __name__ == "__main__":
    sys.exit(main())
