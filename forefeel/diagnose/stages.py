"""The stages of a diagnosis, in words."""

from contextlib import AbstractContextManager

from forefeel.terminal import Tell, stages

_WORDS = {
    "reading": "reading the recording",
    "sensor": "looking at the load cell",
    "search": "searching for causes",
    "trust": "weighing the evidence",
    "prediction": "predicting across 300 ms",
    "report": "drawing the report",
}
_LONG = "search", "trust", "prediction", "report"
"""The others are over before anyone wonders, and wrong input ends in them: its one line stands alone."""


def diagnosing(name: str) -> AbstractContextManager[Tell]:
    """A function that is told the stage before it starts."""
    return stages(name, _WORDS, _LONG)
