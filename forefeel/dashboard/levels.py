"""How something stands: a level is a colour and a shape, and never stands without a word."""

from typing import Literal, NamedTuple

Level = Literal["good", "busy", "warn", "bad", "off"]
GOOD: Level = "good"
BUSY: Level = "busy"
WARN: Level = "warn"
BAD: Level = "bad"
OFF: Level = "off"


class Light(NamedTuple):
    """One thing that is watched: what it is, how it stands, in a word and in a sentence."""

    name: str
    level: Level
    word: str
    more: str = ""
