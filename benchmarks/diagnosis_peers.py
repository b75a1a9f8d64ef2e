"""The diagnosis beside methods that choose among columns: `python -m benchmarks.diagnosis_peers [--each N]`.

Recordings of `make hidden-effects`, N for each of the 22 names and as many without anything hidden, each
method in this process on one core. The peers have columns for nine of the names; the rest they can not give.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from statistics import median

from tests.hidden_effects.cases import Case
from tests.hidden_effects.columns import KNOWN
from tests.hidden_effects.generator import VOCABULARY
from tests.hidden_effects.methods import PRODUCT, TITLES, method_of
from tests.hidden_effects.score import Outcome, scored

_DISTRIBUTIONS = {PRODUCT: "forefeel", "memory": "pysindy"}  # of methods that are not called as theirs
_SEED = 70_000  # first seed of the cases; arbitrary, another one gives other recordings


def main() -> None:
    """Prints a row for each method."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.diagnosis_peers")
    parser.add_argument("--each", type=int, default=2)
    parser.add_argument("--json", type=Path, help="the figures, too")
    options = parser.parse_args()
    cases = [Case("single", name, _SEED + i) for name in VOCABULARY for i in range(options.each)]
    cases += [Case("nothing", "nothing", _SEED + 300 + i) for i in range(len(VOCABULARY) * options.each)]
    rows = [row(name, title, [scored(case, method_of(name)) for case in cases])
            for name, title in TITLES.items()]  # fmt: skip
    print(text(rows))
    if options.json is not None:
        options.json.write_text(json.dumps({"rows": rows}, indent=2))


def row(name: str, title: str, outcomes: Sequence[Outcome]) -> dict[str, object]:
    """Rates and times of one method."""
    single = [each for each in outcomes if each.case.group == "single"]
    known = [each for each in single if set(each.truth) <= KNOWN]
    nothing = [each for each in outcomes if each.case.group == "nothing"]
    return {
        "method": title,
        "version": version(_DISTRIBUTIONS.get(name, name)),
        "first": f"{sum(each.first for each in single)} of {len(single)}",
        "exact": f"{sum(each.exact for each in single)} of {len(single)}",
        "exact_known": f"{sum(each.exact for each in known)} of {len(known)}",
        "false_alarms": f"{sum(bool(each.answer.names) for each in nothing)} of {len(nothing)}",
        "median_s": median(each.answer.seconds for each in outcomes),
        "most_s": max(each.answer.seconds for each in outcomes),
        "median_s_per_30000": median(each.answer.seconds / each.samples * 30_000 for each in outcomes),
    }


def text(rows: Sequence[Mapping[str, object]]) -> str:
    """The table."""
    lines = [
        f"{'':>22} {'right first':>11} {'exactly it':>10} {'of names with a column':>22} "
        f"{'false alarms':>12} {'median':>7} {'most':>6} s {'s per 30,000':>12}"
    ]
    lines += [
        f"{row['method']:>22} {row['first']:>11} {row['exact']:>10} {row['exact_known']:>22} "
        f"{row['false_alarms']:>12} {row['median_s']:7.2f} {row['most_s']:6.2f}   "
        f"{row['median_s_per_30000']:12.2f}   {row['version']}"
        for row in rows
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
