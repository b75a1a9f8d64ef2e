"""What is said while a diagnosis works: a spinner on a terminal, elsewhere a line for each long stage."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

Tell = Callable[[str], None]

_WORDS = {
    "reading": "reading the recording",
    "sensor": "looking at the load cell",
    "search": "searching for causes",
    "trust": "weighing the evidence",
    "prediction": "predicting across 300 ms",
    "report": "drawing the report",
}
_AT_ONCE = "reading", "sensor"
"""Over before anyone wonders, and wrong input ends in them: its one line stands alone."""


def console() -> Console:
    """Where progress is shown: stderr, so that stdout holds the answer only."""
    return Console(stderr=True, highlight=False)


@contextmanager
def stages(name: str) -> Iterator[Tell]:
    """A function that is told the stage before it starts."""
    shown = console()
    if not shown.is_terminal:
        yield lambda stage: None if stage in _AT_ONCE else _line(name, stage)
        return
    columns = SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn()
    with Progress(*columns, console=shown, transient=True) as bar:
        task = bar.add_task(name)
        yield lambda stage: bar.update(task, description=f"{name}: {_WORDS.get(stage, stage)}")


def _line(name: str, stage: str) -> None:
    print(f"{name}: {_WORDS.get(stage, stage)}", file=sys.stderr, flush=True)
