"""Small recorded runs of which every figure is known."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count, product
from pathlib import Path
from typing import Any

from forefeel.common import topics
from forefeel.common.codec import encode
from forefeel.common.lateness import EDGES_US
from forefeel.common.messages import Message, SafetyState
from forefeel.common.recording.mcap_writer import RunWriter
from tests.messages import usual

MS = 1_000_000
START_NS = 5_000 * MS
VESSEL = '{"instrument_radius_mm": 1, "lumen_radius_mm": {"0": 2, "90": 0.5}}'
SESSION = 2**62 + 1  # no float holds it
S = SafetyState
HANDSHAKE = {"settings": '{"axis": "insertion", "max_force_n": 3.0}', "accepted": True}


class RunBuilder:
    """Writes messages at times in ms since the start of the run.

    Attributes:
        late_ms: time from a message's stamp to its receipt by the recorder.
    """

    def __init__(self, writer: RunWriter, axis: str = "insertion") -> None:
        self._writer, self._axis, self._numbers = writer, axis, count(1)
        self._sent_ms = dict[int, int]()
        self.late_ms = 0

    def say(self, topic: topics.Topic[Message], t_ms: int, **fields: Any) -> None:  # noqa: ANN401 - any field
        header = {"session_id": SESSION, "sequence": next(self._numbers), "stamp_ns": START_NS + t_ms * MS}
        written = usual(topic, **header | fields)
        receive_ns = START_NS + (t_ms + self.late_ms) * MS
        self._writer.write(topic.key("cell", self._axis), encode(written), receive_ns)

    def haptics(
        self,
        t_ms: int,
        sequence: int,
        predicted_n: float | None = None,
        zoh_n: float | None = None,
        answered: int | None = None,
        delay_s: float | None = None,
        session_id: int = SESSION,
    ) -> None:
        self._sent_ms[sequence] = t_ms
        self.say(
            topics.HAPTICS, t_ms, sequence=sequence, session_id=session_id, handle_position_m=0.0,
            command_position_m=0.001 * sequence, predicted_n=predicted_n, leading="", zoh_n=zoh_n,
            rendered_n=predicted_n or 0.0, delay_s=delay_s, answered_sequence=answered, energy_j=0.0,
            force_age_s=None if delay_s is None else delay_s / 2,
        )  # fmt: skip

    def force(self, t_ms: int, force_n: float, answers: int | None, **fields: Any) -> None:  # noqa: ANN401
        sent_ns = None if answers is None else START_NS + self._sent_ms.get(answers, 0) * MS
        answered = {"answers_sequence": answers, "answers_stamp_ns": sent_ns}
        self.say(topics.FORCE, t_ms, position_m=0.001, force_n=force_n, raw_counts=0, **answered, **fields)

    def slave_state(self, t_ms: int, state: SafetyState, **fields: Any) -> None:  # noqa: ANN401
        usual: dict[str, Any] = {"reason": "", "position_m": 0.0, "counters": {}}
        self.say(topics.SLAVE_STATE, t_ms, state=state, **usual | fields)


@contextmanager
def recorded(path: Path, axis: str = "insertion") -> Iterator[RunBuilder]:
    with RunWriter(path) as writer:
        yield RunBuilder(writer, axis)


COMMANDS = 1000


def write_known_run(path: Path, reason: str = "deadman pressed", seed: str = "7") -> None:
    """Ten seconds. Command k of 1000 is predicted wrong by k mN, held wrong by -2 k mN, signs alternating.

    It is answered by +-k N; 101 of the round trips are k ms. The slave: idle for 1 s, ready for 1 s, armed
    for 6 s, ready for 2 s. The operator let go for 0.5 s.
    """
    with RunWriter(path) as writer:
        run = RunBuilder(writer)
        writer.add_metadata("run", {"seed": seed, "impairment": "wan", "vessel": VESSEL})
        run.say(topics.SLAVE_HANDSHAKE, 0, **HANDSHAKE)
        run.say(topics.MASTER_STATE, 0, clutched_s=7.0)  # the recorder starts later than the daemons
        for t_ms in range(0, 10_001, 20):
            state = S.IDLE if t_ms < 1000 else S.ARMED if 2000 <= t_ms < 8000 else S.READY
            run.slave_state(t_ms, state, stops=3 + t_ms // 5000, counters={"refused_late": t_ms})
        run.say(topics.SAFETY_EVENT, 2000, before=S.READY, event="engage", after=S.ENGAGING, reason=reason)
        for k in range(1, COMMANDS + 1):
            force_n, sign = float(k), 1 if k % 2 else -1
            delay = min(k, 101)
            run.haptics(
                2000 + 5 * k, k, force_n + sign * k * 1e-3, force_n - sign * k * 2e-3, delay, delay * 1e-3
            )
            run.force(2000 + 5 * k + 1, force_n, k)
            run.force(2000 + 5 * k + 2, force_n + 100.0, k)  # a later answer does not count
        run.say(topics.LIMIT_EVENT, 3000, count=4)
        run.say(topics.LIMIT_EVENT, 4000, count=3)
        run.say(topics.MASTER_IMPAIRMENT, 4000, delays_ns=((5,), (), (7, 7), (9,)))
        for t_ms in range(2000, 10_000, 500):
            run.say(
                topics.PARAMETERS, t_ms, names=("bias.force_n", "spring.stiffness_n_m"),
                values=(0.5, 7.0 + t_ms / 1e4), standard_deviations=(0.25, 0.125),
                identifiable=("m and k only as k - 0.99 m",),
            )  # fmt: skip
        run.say(
            topics.MASTER_STATE, 10_000, clutched_s=7.5, clock_offset_ns=-2 * MS, clock_bound_ns=3 * MS,
            counters={"forces_unused": 3},
        )  # fmt: skip
        for topic, t_ms in product((topics.MASTER_TIMING, topics.SLAVE_TIMING), (9000, 9900)):
            counts = tuple(t_ms if i == 10 else 0 for i in range(len(EDGES_US) + 1))
            run.say(
                topic, t_ms, loop=topic.publisher, ticks=t_ms, p50_us=70.0, p99_us=110.5, edges_us=EDGES_US,
                counts=counts, scheduling="SCHED_FIFO 50",
            )  # fmt: skip
