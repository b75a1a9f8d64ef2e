"""Messages and runs for the tests of recordings."""

from pathlib import Path
from typing import Any

from forefeel.common.codec import encode
from forefeel.common.messages import ForceSample, Message, MotionCommand
from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.common.topics import FORCE, Topic
from tests.messages import usual

CELL = "cell"
AXIS = "insertion"
START_NS = 5_000_000_000
STEP_NS = 1_000_000


def header(index: int) -> dict[str, Any]:
    return {"session_id": 7, "sequence": index, "stamp_ns": START_NS + index * STEP_NS}


def force(index: int, **changes: object) -> ForceSample:
    fields: dict[str, Any] = {
        **header(index), "position_m": 1e-3 * index, "velocity_m_s": 0.25, "force_n": index / 3,
        "raw_counts": index, "answers_sequence": index, "answers_stamp_ns": START_NS,
    }  # fmt: skip
    return usual(FORCE, **fields | changes)


def command(index: int) -> MotionCommand:
    return MotionCommand(**header(index), position_m=1e-3 * index, velocity_m_s=0.1, deadman=True)


def put(writer: RunWriter, message: Message, topic: Topic[Any] = FORCE, axis: str = AXIS) -> None:
    """Writes a message as if it had taken 2 ms to arrive."""
    writer.write(topic.key(CELL, axis), encode(message), message.stamp_ns + 2 * STEP_NS)


def write_forces(path: Path, samples: list[ForceSample], axis: str = AXIS) -> None:
    with RunWriter(path) as writer:
        for sample in samples:
            put(writer, sample, axis=axis)
