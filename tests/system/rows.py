"""A row of `make system`: something that happens to the service, and what is not as required afterwards."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Result:
    """`cells`: of the page of faults; empty for a row that is not on it."""

    figures: str
    failures: Sequence[str]
    cells: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Row:
    """`run` gets an empty folder. An AssertionError of it is a failure, too."""

    name: str
    run: Callable[[Path], Result]
