"""The table of an evaluation for the terminal."""

from collections.abc import Iterator, Mapping, Sequence

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from forefeel.diagnosis.evaluation.arrivals import DelayedLink
from forefeel.diagnosis.evaluation.evaluate import Evaluated
from forefeel.diagnosis.evaluation.methods import METHODS
from forefeel.report.text import DISCLAIMER
from forefeel.report.wording import quantity, share
from forefeel.terminal import table


def ratio_to_hold(evaluated: Evaluated, name: str) -> float | None:
    """rms over that of the hold; None when either is unknown, or the hold makes no error."""
    rms_n, hold_n = evaluated.scores[name].size.rms_n, evaluated.scores["hold"].size.rms_n
    return rms_n / hold_n if rms_n is not None and hold_n else None


def best(evaluated: Evaluated) -> str | None:
    """The method with the smallest rms."""
    known = {name: score.size.rms_n for name, score in evaluated.scores.items()}
    finite = {name: rms_n for name, rms_n in known.items() if rms_n is not None}
    return min(finite, key=lambda name: finite[name]) if finite else None


def in_words(
    link: DelayedLink, rules: Sequence[str], recordings: Mapping[str, Evaluated]
) -> Iterator[RenderableType]:
    """Table, notes and rules."""
    yield _table(link, recordings)
    for stem, evaluated in recordings.items():
        yield f"{stem}: {'; '.join(evaluated.notes)}"
    yield from ("", *rules, DISCLAIMER)


def _table(link: DelayedLink, recordings: Mapping[str, Evaluated]) -> Table:
    title = f"Error, rms and (its ratio to hold), delay {link.delay_s:g} s; * best"
    numbers = (*METHODS, "95 % band")
    made = table("recording", *numbers, title=title, right=numbers)
    for stem, evaluated in recordings.items():
        made.add_row(Text(stem), *(_cell(evaluated, name) for name in METHODS), _band(evaluated))
    return made


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
