"""Are the recordings whole: each can be read, and lacks nothing but where something was disturbed."""

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from forefeel.common.errors import RecordingError
from forefeel.common.recording.mcap_reader import Stream, read_contents
from forefeel.common.topics import FORCE
from tests.live_cell import AXIS

_LOST = 300
_NUMBER = re.compile(rb'"sequence": ?(\d+)')
_SLACK_NS = 500_000_000


def check(path: Path, killed: bool, disturbed_ns: Sequence[tuple[int, int]]) -> tuple[int, list[str]]:
    """(messages, what is wrong). `disturbed_ns`: when slave or recorder were kept from their work."""
    try:
        contents = read_contents(path)
    except RecordingError as error:
        return 0, [str(error)]
    messages = sum(len(stream.payloads) for stream in contents.streams.values())
    wrong = []
    if contents.truncated and not killed:
        wrong.append("cut off")
    stream = contents.streams.get((AXIS, FORCE.name)) or Stream()
    stamps_ns = stream.log_ns
    numbers = [int(found.group(1)) for payload in stream.payloads if (found := _NUMBER.search(payload))]
    for i, (a, b) in enumerate(pairwise(numbers)):
        if b - a > _LOST and not _within(stamps_ns[i], stamps_ns[i + 1], disturbed_ns):
            wrong.append(f"{b - a - 1} forces lost in a row")
    if len(stamps_ns) == 0:
        wrong.append("no force")
    return messages, wrong


def _within(start_ns: int, end_ns: int, disturbed_ns: Sequence[tuple[int, int]]) -> bool:
    return any(start_ns <= stop + _SLACK_NS and end_ns >= begin - _SLACK_NS for begin, stop in disturbed_ns)
