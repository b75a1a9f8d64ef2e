"""How long a session takes to open, first and after a cut: `python -m benchmarks.reconnect` (as root).

For each setting both daemons are started ten times, the slave first and the master first in turn; the time
counts from when both say that they wait. Then the cable between them is cut ten times for 5 s; the time
counts from mending. Settings are those of `benchmarks.links`.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from benchmarks.linked import ENDS, LINKS, LinkedDaemons, linked
from benchmarks.links import Setting, add_options, command, settings
from benchmarks.markdown import Table

COLUMNS = ("link", "round trip, ms", "loss, %", "opened, s", "after a cut, s", "congestion control")
BOUNDS_S = {100.0: 3.0, 300.0: 5.0, 600.0: 8.0}
"""By round trip in ms: within what time a session is to open."""


def main(words: Sequence[str]) -> None:
    """Prints each row as it comes."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.reconnect")
    add_options(parser, tuple(LINKS), "default", "100,300,600")
    parser.add_argument("--times", type=int, default=10, help="how often it opens, and how often it is cut")
    parser.add_argument("--cut", type=float, default=5.0, help="how long a cut lasts, in s")
    asked = parser.parse_args(words)
    table = Table(COLUMNS, command(parser, words), asked.out)
    for setting in settings(asked):
        table.add(row(setting, asked.times, asked.cut, asked.congestion))


def row(setting: Setting, times: int, cut_s: float, congestion: str | None) -> list[str]:
    """Both measurements of one setting, on one pair of hosts."""
    bound_s = BOUNDS_S.get(setting.there_ms + setting.back_ms)
    with (
        TemporaryDirectory(prefix="ff-") as folder,
        linked(Path(folder), LINKS[setting.link], setting.route, congestion=congestion) as daemons,
    ):
        opened = [_opened(daemons, number) for number in range(times)]
        after = _after_cuts(daemons, times, cut_s)
        control = daemons.congestion()
    return [*setting.cells, outcome(opened, bound_s), outcome(after, bound_s), control]


def outcome(times_s: Sequence[float | None], bound_s: float | None) -> str:
    """How many were within the bound, the median and the largest; None: no session."""
    known = sorted(time_s for time_s in times_s if time_s is not None)
    parts = [f"median {median(known):.1f}, largest {known[-1]:.1f}"] if known else []
    if bound_s is not None:
        parts.insert(0, f"{sum(each <= bound_s for each in known)} of {len(times_s)} in {bound_s:g} s")
    if missing := len(times_s) - len(known):
        parts.append(f"{missing} without a session")
    return "; ".join(parts)


def _opened(daemons: LinkedDaemons, number: int) -> float | None:
    found = _time(lambda: daemons.open(ENDS if number % 2 == 0 else ENDS[::-1]))
    daemons.end()
    return found


def _after_cuts(daemons: LinkedDaemons, times: int, cut_s: float) -> list[float | None]:
    """A cut finds the service armed, where it arms at all. Both start anew when no session follows it."""
    found: list[float | None] = []
    daemons.open()
    for _ in range(times):
        with suppress(AssertionError):
            daemons.wait_armed()
        found.append(_time(lambda: daemons.cut(cut_s)))
        if found[-1] is None:
            daemons.end()
            daemons.open()
    daemons.end()
    return found


def _time(action: Callable[[], float]) -> float | None:
    try:
        return action()
    except AssertionError as error:
        print(error, file=sys.stderr)
        return None


if __name__ == "__main__":
    main(sys.argv[1:])
