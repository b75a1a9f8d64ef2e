"""`python -m tests.attacks [PART OF A NAME]`: every attack, one row each; exit 1 if one is not refused."""

import sys
import time
from collections.abc import Iterator
from itertools import chain

from rich.console import Console
from rich.table import Table

from tests.attacks.outcome import HEAD, Outcome
from tests.attacks.silence import silent
from tests.attacks.virtual import VIRTUAL
from tests.attacks.wire import plain, secured


def main() -> int:
    """Runs those whose name contains the argument, all without one."""
    wanted = sys.argv[1] if len(sys.argv) > 1 else ""
    start_s, outcomes = time.monotonic(), list[Outcome]()
    for outcome in chain(_virtual(wanted), plain(wanted), secured(wanted), silent(wanted)):
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
