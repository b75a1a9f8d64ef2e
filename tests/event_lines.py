"""Reads the event log of a daemon."""

import json
from pathlib import Path
from typing import Any, NamedTuple


class Event(NamedTuple):
    utc: str
    monotonic_ns: int
    event: str
    axis: str
    details: dict[str, Any]


def read_events(path: Path) -> list[Event]:
    return [Event(**json.loads(line)) for line in path.read_bytes().splitlines()]
