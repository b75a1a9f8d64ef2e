"""A question, the motion asked for, and its answer on 83 benches: `python -m tests.hidden_effects.asked`."""

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

from tests.hidden_effects.asked.bench import NARROW, USUAL, kinds
from tests.hidden_effects.asked.score import outcome, plain


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--limits", choices=[USUAL, NARROW], default=USUAL)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--only", type=int, nargs="*")
    o = parser.parse_args()
    cases = [case for case in enumerate(kinds(o.seed)) if not o.only or case[0] in o.only]
    with ProcessPoolExecutor(o.jobs, get_context("spawn")) as pool:
        outcomes = []
        for one in pool.map(partial(outcome, o.seed, o.limits == NARROW, o.seconds), cases):
            outcomes.append(one)
            print(one, flush=True)
    for group in ("cause", "outside", "nothing"):
        some = [each for each in outcomes if each.group == group]
        named = [each for each in some if each.first_right]
        right, wrong = sum(each.right for each in some), sum(each.wrong for each in some)
        lost = sum(not each.right for each in named)
        refused = sum(plain(each.refused) == each.hidden and bool(each.refused) for each in some)
        print(f"{group} {len(some)} first right {len(named)} right {right}", end=" ")
        print(f"wrong confirmed {wrong} lost {lost} right refused {refused}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
