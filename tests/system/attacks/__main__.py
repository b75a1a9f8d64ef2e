"""`python -m tests.system.attacks [PART OF A NAME]`: every attack, a row each; exit 1: not refused."""

import argparse
import sys
import time
from collections.abc import Iterator
from itertools import chain

from rich.console import Console
from rich.table import Table

from tests.system.attacks.outcome import HEAD, Outcome
from tests.system.attacks.virtual import VIRTUAL
from tests.system.attacks.wire import plain, secured


def main() -> int:
    """Runs those whose name contains the argument, all without one."""
    parser = argparse.ArgumentParser(prog="python -m tests.system.attacks", description=__doc__)
    parser.add_argument("wanted", nargs="?", default="", help="part of a name")
    options = parser.parse_args()
    wanted = options.wanted
    start_s, outcomes = time.monotonic(), list[Outcome]()
    for outcome in chain(_virtual(wanted), plain(wanted), secured(wanted)):
        outcomes.append(outcome)
        verdict = "NOT REFUSED" if outcome.wrong else "refused"
        print(
            f"{time.monotonic() - start_s:5.1f} s  {outcome.attack}: {verdict}", file=sys.stderr, flush=True
        )
    table = Table(*HEAD)
    for outcome in outcomes:
        table.add_row(*outcome.row())
    Console(width=200).print(table)
    refused = sum(not outcome.wrong for outcome in outcomes)
    print(f"{refused} of {len(outcomes)} attacks refused in {time.monotonic() - start_s:.0f} s")
    return int(refused < len(outcomes) or not outcomes)


def _virtual(wanted: str) -> Iterator[Outcome]:
    return (attack(name) for name, attack in VIRTUAL.items() if wanted in name)


if __name__ == "__main__":
    sys.exit(main())
