"""The table of an evaluation for the terminal."""

import sys
from collections.abc import Mapping, Sequence

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from diagnosis.evaluation.arrivals import Link
from diagnosis.evaluation.evaluate import Evaluated
from diagnosis.evaluation.methods import METHODS
from forefeel.report.text import DISCLAIMER
from forefeel.report.wording import quantity, share

_PLAIN_WIDTH = 140


def ratio_to_hold(evaluated: Evaluated, name: str) -> float | None:
    """rms over that of the hold; None when either is unknown, or the hold makes no error."""
    rms_n, hold_n = evaluated.scores[name].size.rms_n, evaluated.scores["hold"].size.rms_n
    return rms_n / hold_n if rms_n is not None and hold_n else None


def best(evaluated: Evaluated) -> str | None:
    """The method with the smallest rms."""
    known = {name: score.size.rms_n for name, score in evaluated.scores.items()}
    finite = {name: rms_n for name, rms_n in known.items() if rms_n is not None}
    return min(finite, key=lambda name: finite[name]) if finite else None


def print_table(link: Link, rules: Sequence[str], recordings: Mapping[str, Evaluated]) -> None:
    """Table, notes and rules to stdout; plain text when that is not a terminal."""
    terminal = sys.stdout.isatty()
    console = Console(highlight=False, markup=False, width=None if terminal else _PLAIN_WIDTH)
    console.print(_table(link, recordings, terminal))
    lines = [f"{stem}: {'; '.join(evaluated.notes)}" for stem, evaluated in recordings.items()]
    for line in [*lines, "", *rules, DISCLAIMER]:
        console.print(Text(line), soft_wrap=True)


def _table(link: Link, recordings: Mapping[str, Evaluated], terminal: bool) -> Table:
    table = Table(
        title=f"Error, rms and (its ratio to hold), delay {link.delay_s:g} s; * best",
        title_justify="left",
        box=box.SIMPLE_HEAD if terminal else box.ASCII2,
    )
    table.add_column("recording", overflow="fold")
    for name in METHODS:
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("95 % band", justify="right", no_wrap=True)
    for stem, evaluated in recordings.items():
        table.add_row(Text(stem), *(_cell(evaluated, name) for name in METHODS), _band(evaluated))
    return table


def _cell(evaluated: Evaluated, name: str) -> Text:
    score = evaluated.scores[name]
    if score.diverged_at_s is not None:
        return Text(f"diverged at {score.diverged_at_s:.1f} s  ", style="red")
    text = quantity(score.size.rms_n, "N")
    relative = ratio_to_hold(evaluated, name)
    if name != "hold" and relative is not None:
        text += f" ({relative:.3f})"
    first = name == best(evaluated)
    return Text(f"{text} {'*' if first else ' '}", style="bold green" if first else "")


def _band(evaluated: Evaluated) -> Text:
    """How much of the force the band of forefeel holds."""
    return Text(share(evaluated.scores["forefeel"].band.coverage))
