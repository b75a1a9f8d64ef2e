"""Keeps of a recording what a prediction needs: `python -m tests.recorded_session FROM TO SECONDS`."""

import sys
from pathlib import Path
from typing import Any

from forefeel.common.messages import Message
from forefeel.common.recording.mcap_spans import RunSpans
from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.common.topics import COMMAND, FORCE, HAPTICS, MASTER_HANDSHAKE, PARAMETERS, SLAVE_STATE, Topic
from forefeel.loopback.plan import MODEL, PRIOR

_LEFT_OUT: dict[str, dict[str, Any]] = {
    COMMAND.name: {"low_n": None, "high_n": None},
    FORCE.name: {"velocity_m_s": 0.0, "raw_counts": 0, "clock_offset_ns": None, "clock_bound_ns": None},
    HAPTICS.name: {
        "handle_position_m": 0.0, "rendered_n": 0.0, "force_age_s": None, "delay_s": None, "limited": False,
        "energy_j": 0.0,
    },
    SLAVE_STATE.name: {"reason": "", "counters": {}, "caveats": ()},
    MASTER_HANDSHAKE.name: {},
    PARAMETERS.name: {},
}  # fmt: skip
"""By topic the fields of no use, with what stands for them."""


def keep(source: Path, target: Path, seconds: float) -> None:
    """Writes the first so many seconds of `source`, in place of what `target` was; of the parameters the
    first, which names the prior.
    """
    spans = RunSpans(source)
    target.unlink(missing_ok=True)
    topics: list[Topic[Any]] = [COMMAND, FORCE, HAPTICS, MASTER_HANDSHAKE, PARAMETERS, SLAVE_STATE]
    with RunWriter(target) as writer:
        run = spans.metadata["run"]
        of_run = "seed", "impairment", "preset", PRIOR, MODEL
        writer.add_metadata("run", {name: run[name] for name in of_run if name in run})
        named = False
        for logged in spans.between(spans.start_ns, spans.start_ns + round(seconds * 1e9), topics):
            if logged.topic is PARAMETERS and named:
                continue
            named = named or logged.topic is PARAMETERS
            message: Message = logged.message.model_copy(update=_LEFT_OUT[logged.topic.name])
            writer.write_message(logged.topic.key(spans.cell, logged.axis), message, logged.log_ns)


if __name__ == "__main__":
    keep(Path(sys.argv[1]), Path(sys.argv[2]), float(sys.argv[3]))
