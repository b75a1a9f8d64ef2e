"""400 recordings that hide something, the diagnosis and its peers: `python -m tests.hidden_effects`.

Prints for each method the confusion table, the rates and every miss. Exit 1
when the diagnosis misses a rate that is demanded.
"""

import argparse
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

from tests.hidden_effects.answers import Method
from tests.hidden_effects.cases import Case, full
from tests.hidden_effects.columns import KNOWN
from tests.hidden_effects.methods import PRODUCT, TITLES, method_of
from tests.hidden_effects.score import Outcome, scored
from tests.hidden_effects.tables import report, unmet


def main(arguments: Sequence[str] | None = None) -> int:
    """0 when every demand is met."""
    options = _options(arguments)
    cases = [case for case in full(options.seed) if options.only in str(case)]
    failed: list[str] = []
    for name in options.methods:
        outcomes = _run(cases, method_of(name), options.jobs)
        if name == PRODUCT:
            print(report(TITLES[name], outcomes), flush=True)
            failed = unmet(outcomes)
        else:
            print(report(TITLES[name], outcomes, intervals=False, known=KNOWN), flush=True)
    print("\n".join(["", *(f"NOT REACHED: {line}" for line in failed)]) if failed else "")
    return 1 if failed else 0


def _run(cases: Sequence[Case], method: Method, jobs: int) -> list[Outcome]:
    with ProcessPoolExecutor(jobs, get_context("spawn")) as workers:
        return list(workers.map(partial(scored, method=method), cases))


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.hidden_effects", description=__doc__)
    parser.add_argument("--seed", type=int, default=50_000, help="first seed of the recordings")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--only", default="", help="only cases whose name contains this")
    parser.add_argument("--methods", nargs="+", choices=TITLES, default=list(TITLES))
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
