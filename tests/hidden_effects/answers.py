"""What a method answered about a recording, in one form for the product and its peer."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from forefeel.common.error_size import Floats

Interval = tuple[float, float, float]
"""Value, low, high."""
NAMING = ("cause_found", "partly_explained")
"""Verdicts that name causes."""


@dataclass(frozen=True)
class Answer:
    """Names ordered by explained force; empty unless the verdict is one of NAMING."""

    verdict: str
    names: tuple[str, ...] = ()
    parameters: Mapping[str, Mapping[str, Interval]] = field(default_factory=dict)
    rivals: tuple[tuple[str, ...], ...] = ()
    gain: float = float("nan")
    gain_low: float = float("nan")
    seconds: float = 0.0
    error: str = ""

    @property
    def names_causes(self) -> bool:
        return self.verdict in NAMING

    @property
    def partly(self) -> bool:
        """Whether it names causes beside something without a name."""
        return self.verdict == "partly_explained"


class Measured(Protocol):
    """A recording: all that a method may see."""

    @property
    def time_s(self) -> Floats: ...
    @property
    def position_m(self) -> Floats: ...
    @property
    def force_n(self) -> Floats: ...


Method = Callable[[Measured], Answer]
