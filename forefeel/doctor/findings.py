"""What a check found."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Level = Literal["green", "amber", "red"]
LEVELS: tuple[Level, ...] = ("green", "amber", "red")


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the list.

    Attributes:
        group: the group of checks.
        subject: what was looked at.
        level: green is fit, amber works with less than it should, red does not work or must not.
        found: what was found.
        advice: what to do; empty where there is nothing to do.
    """

    group: str
    subject: str
    level: Level
    found: str
    advice: str = ""


def worst(findings: Iterable[Finding]) -> Level:
    """The gravest level; green of nothing."""
    return max((each.level for each in findings), key=LEVELS.index, default="green")
