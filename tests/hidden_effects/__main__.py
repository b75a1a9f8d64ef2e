"""400 recordings that hide something, the diagnosis and its peers: `python -m tests.hidden_effects`.

Prints for each method the confusion table, the rates and every miss. Exit 1
when the diagnosis misses a rate that is demanded.
"""

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

from tests.hidden_effects.cases import full
from tests.hidden_effects.columns import KNOWN
from tests.hidden_effects.methods import PRODUCT, TITLES, method_of
from tests.hidden_effects.score import scored
from tests.hidden_effects.tables import report, unmet


def main() -> int:
    """0 when every demand is met."""
    parser = argparse.ArgumentParser(prog="python -m tests.hidden_effects", description=__doc__)
    parser.add_argument("--seed", type=int, default=50_000, help="first seed of the recordings")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--only", default="", help="only cases whose name contains this")
    parser.add_argument("--methods", nargs="+", choices=TITLES, default=list(TITLES))
    options = parser.parse_args()
    cases = [case for case in full(options.seed) if options.only in str(case)]
    missed: list[str] = []
    with ProcessPoolExecutor(options.jobs, get_context("spawn")) as workers:
        for name in options.methods:
            outcomes = list(workers.map(partial(scored, method=method_of(name)), cases))
            ours = name == PRODUCT
            print(report(TITLES[name], outcomes, ours, () if ours else KNOWN), flush=True)
            missed += unmet(outcomes) if ours else []
    print(*("", *(f"NOT REACHED: {line}" for line in missed)), sep="\n")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
