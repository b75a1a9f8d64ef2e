"""What a method answered about a recording, in one form for the product and its peer."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from forefeel.common.error_size import Floats

Interval = tuple[float, float, float]
"""Value, low, high."""
NAMING = ("cause_found", "partly_explained")
"""Verdicts that name causes."""
_SCHEMA = "forefeel.diagnosis/3"


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


def from_document(document: Mapping[str, Any], seconds: float) -> Answer:
    """Of `diagnosis.json`.

    Raises:
        KeyError: a field of the schema is missing.
    """
    if document["schema"] != _SCHEMA:
        raise KeyError(f"schema {document['schema']!r}, expected {_SCHEMA!r}")
    return Answer(
        verdict=document["verdict"],
        names=tuple(cause["name"] for cause in document["causes"]),
        parameters={cause["name"]: _intervals(cause["parameters"]) for cause in document["causes"]},
        rivals=tuple(tuple(names) for names in document["rivals"]),
        gain=_number(document["held_out"]["gain"]),
        gain_low=_number(document["held_out"]["gain_low"]),
        seconds=seconds,
    )


def _intervals(parameters: Mapping[str, Mapping[str, float]]) -> dict[str, Interval]:
    return {
        name: (_number(p["value"]), _number(p["low"]), _number(p["high"])) for name, p in parameters.items()
    }


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)
