"""Recordings of a bench put to the diagnosis and its peers: `python -m tests.hidden_effects.bench`.

Prints the families and a line for each population and method; then every recording of which the diagnosis
names a first cause that is confidently wrong, or that ended in an exception. `bias` among the answered causes
is passed over: every recording has one.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import product
from multiprocessing import get_context

import numpy as np

from tests.hidden_effects.bench import FAMILIES, LEAST_SHARE, Population
from tests.hidden_effects.bench.score import Elsewhere, Outcome, elsewhere, scored
from tests.hidden_effects.methods import PRODUCT, TITLES, method_of

_ALIKE = 2.0  # ratio of speeds within which another motion is within the recorded range


def main() -> int:
    """Always 0: this measures, it demands nothing."""
    every = [population.value for population in Population]
    parser = argparse.ArgumentParser(prog="python -m tests.hidden_effects.bench", description=__doc__)
    parser.add_argument("--count", type=int, default=50, help="recordings of each population")
    parser.add_argument("--seed", type=int, default=0, help="first seed")
    parser.add_argument("--population", nargs="+", choices=every, default=every)
    parser.add_argument("--methods", nargs="+", choices=TITLES, default=[PRODUCT])
    parser.add_argument("--other-motion", action="store_true", help="measure the gain on another motion")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    options = parser.parse_args()
    seeds = range(options.seed, options.seed + options.count)
    populations = map(Population, options.population)
    with ProcessPoolExecutor(options.jobs, get_context("spawn")) as workers:
        if options.other_motion:
            for population in populations:
                outcomes = workers.map(partial(elsewhere, population), seeds)
                _print_elsewhere(population, [each for each in outcomes if each is not None])
            return 0
        families = [f"  {family:<11s} {', '.join(names)}" for family, names in FAMILIES.items()]
        share = f"(an effect's share of the force is at least {LEAST_SHARE:g} times the noise's rms)"
        print(f"families {share}:", *families, "", "  ".join([f"{'population':<12s}", *COLUMNS]), sep="\n")
        of_the_product: list[Outcome] = []
        for population, method in product(populations, options.methods):
            rated = list(workers.map(partial(scored, population, method=method_of(method)), seeds))
            title = population.value if method == PRODUCT else f"- {method}"
            print(row(title, population, rated), flush=True)
            of_the_product += rated if method == PRODUCT else []
    print(listed("confidently wrong first", (o for o in of_the_product if o.wrong_first)))
    print(listed("exceptions", (o for o in of_the_product if o.answer.error)))
    return 0


def _print_elsewhere(population: Population, named: Sequence[Elsewhere]) -> None:
    """How often the interval of the gain on another motion holds it, its width, and where it fails; and what
    the other motion says of right names and of others.
    """
    found = [each for each in named if each.expected is not None]
    alike = [each for each in found if 1.0 / _ALIKE < each.faster < _ALIKE]
    for which, some in (("all", found), (f"speeds within a factor of {_ALIKE:g}", alike)):
        widths = [e.expected.gain_high - e.expected.gain_low for e in some if e.expected is not None]
        held = _share(sum(each.holds for each in some), len(some))
        said = f"{which}: interval holds {held} of {len(some)}"
        print(f"{population.value:<12s} {said}, median width {100 * np.median(widths or [0.0]):.0f} points")
    for right in (True, False):
        verdicts = Counter(each.confirmation.verdict for each in named if each.right == right)
        print(f"{population.value:<12s} {'right' if right else 'other'} names: {dict(verdicts)}")
    for each in named:
        print(f"  {each.description}: {_numbers(each)}")


def _numbers(each: Elsewhere) -> str:
    c, expected = each.confirmation, each.expected
    gain = "" if c.gain is None else f"; gain {c.gain.gain:.2f}"
    gain += "" if expected is None else f", expected {expected.gain_low:.2f} to {expected.gain_high:.2f}"
    cautions = f" ({', '.join(c.cautions)})" if c.cautions else ""
    return f"{c.verdict}{cautions}, ratio {c.ratio:.2f}{gain}; speed x {each.faster:.1f}"


COLUMNS = ("recordings", "named", "as partly", "wrong first", "as partly", "abstained",
           "right family first", "exact", "nothing_missing, hidden", "exceptions", "median s")  # fmt: skip
"""Of the table; `as partly`: with the verdict `partly_explained`; `wrong first` is of the named."""


def row(title: str, population: Population, outcomes: Sequence[Outcome]) -> str:
    """One population; of `odd` only exceptions count, where nothing is hidden no family can be right."""
    count, found = len(outcomes), sum(o.found for o in outcomes)
    names = any(o.hides for o in outcomes) and population is not Population.ODD
    judged = population is not Population.ODD
    cells = (
        str(count),
        str(found),
        str(sum(o.answer.partly for o in outcomes)),
        _share(sum(o.wrong_first for o in outcomes), found) if judged else "-",
        str(sum(o.wrong_first and o.answer.partly for o in outcomes)) if judged else "-",
        str(sum(o.abstained for o in outcomes)),
        _share(sum(o.right_first for o in outcomes), count) if names else "-",
        _share(sum(o.exact for o in outcomes), count) if judged else "-",
        str(sum(o.missed for o in outcomes)) if names else "-",
        str(sum(bool(o.answer.error) for o in outcomes)),
        f"{np.median([o.answer.seconds for o in outcomes]):.1f}",
    )
    padded = (f"{cell:>{len(title)}s}" for cell, title in zip(cells, COLUMNS, strict=True))
    return "  ".join([f"{title:<12s}", *padded])


def _share(hits: int, total: int) -> str:
    return f"{hits} ({100.0 * hits / total:.0f} %)" if total else "-"


def listed(title: str, outcomes: Iterable[Outcome]) -> str:
    """Every one of them with what was hidden and what was said."""
    lines = [
        f"  {o.population.value} {o.seed}: {o.answer.error or ' + '.join(o.answer.names)} <- {o.description}"
        for o in outcomes
    ]
    return "\n".join([f"\n{title}: {len(lines)}", *lines])


if __name__ == "__main__":
    sys.exit(main())
