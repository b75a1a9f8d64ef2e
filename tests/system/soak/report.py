"""The soak as a row: the service among random faults; memory, recordings, motion, arming again."""

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from forefeel.common.errors import RecordingError
from forefeel.common.recording.mcap_reader import Run, Stream
from forefeel.common.topics import FORCE, TOPICS
from tests.live_cell import AXIS, LiveCell
from tests.system.rows import Result
from tests.system.soak.schedule import schedule
from tests.system.soak.service import Soak

MOST_GROWTH = 0.05
_SEED = 1
_LOST = 300
_NUMBER = re.compile(rb'"sequence": ?(\d+)')
_SLACK_NS = 500_000_000


def soak(minutes: float, folder: Path) -> Result:
    with LiveCell(folder) as cell:
        run = Soak(cell, _SEED)
        run.run(schedule(_SEED, 60.0 * minutes), 60.0 * minutes)
        wrong = [*run.problems, *map(str, cell.faults)]
        figures = [f"{len(run.done)} faults, armed again after {max(done.back_s for done in run.done):.1f} s"]
        for life in run.lives:
            if (found := life.growth()) is not None:
                resident_mb, share, span_s = found
                figures.append(f"{life.name} {resident_mb:.0f} MB {share:+.1%}")
                if share > MOST_GROWTH:
                    wrong.append(f"{life.name} grew by {share:.1%} in {span_s:.0f} s")
        disturbed = [(done.from_ns, done.to_ns) for done in run.done]
        for taken in run.taken:
            messages, faulty = check(taken.path, taken.killed, disturbed)
            figures.append(f"{messages} messages in {taken.path.name}")
            wrong += [f"{taken.path.name}: {each}" for each in faulty]
        wrong += [f"moved outside ARMED by {each}" for each in run.motion.moved[:3]]
        figures.append(f"{run.motion.resting} forces while nothing was followed")
        return Result("; ".join(figures), wrong)


def check(path: Path, killed: bool, disturbed_ns: Sequence[tuple[int, int]]) -> tuple[int, list[str]]:
    """(messages, what is wrong). `disturbed_ns`: when slave or recorder were kept from their work."""
    try:
        run = Run(path)
    except RecordingError as error:
        return 0, [str(error)]
    messages = sum(run.count(axis, topic) for axis in run.axes for topic in TOPICS)
    wrong = []
    if run.truncated and not killed:
        wrong.append("cut off")
    stream = run.stream(AXIS, FORCE) if AXIS in run.axes else Stream()
    stamps_ns = stream.log_ns
    numbers = [int(found.group(1)) for payload in stream.payloads if (found := _NUMBER.search(payload))]
    for i, (a, b) in enumerate(pairwise(numbers)):
        span_ns = stamps_ns[i] - _SLACK_NS, stamps_ns[i + 1] + _SLACK_NS
        if b - a > _LOST and not any(span_ns[0] <= to and span_ns[1] >= at for at, to in disturbed_ns):
            wrong.append(f"{b - a - 1} forces lost in a row")
    if len(stamps_ns) == 0:
        wrong.append("no force")
    return messages, wrong
