"""Small recorded runs of which every figure is known."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from forefeel.common.bus import Header
from forefeel.common.codec import encode
from forefeel.common.lateness import EDGES_US
from forefeel.common.messages import Calibration, Handshake, ImpairmentTrace, Message, SafetyState
from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.common.topics import BY_NAME
from tests.unit.dashboard import said

MS = 1_000_000
START_NS = 5_000 * MS
VESSEL = '{"instrument_radius_mm": 1, "lumen_radius_mm": {"0": 2, "90": 0.5}}'
SESSION = 2**62 + 1  # no float holds it
S = SafetyState


class RunBuilder:
    """Writes messages at times in ms since the start of the run."""

    def __init__(self, writer: RunWriter, axis: str = "insertion") -> None:
        self._writer = writer
        self._axis = axis
        self._sequence = 0
        self.late_ms = 0
        """How much later than it was sent the recorder gets a message."""

    def put(self, topic: str, message: Message, t_ms: int) -> None:
        key = BY_NAME[topic].key("cell", self._axis)
        self._writer.write(key, encode(message), START_NS + (t_ms + self.late_ms) * MS)

    def header(self, t_ms: int, session_id: int = SESSION) -> Header:
        self._sequence += 1
        return {"session_id": session_id, "sequence": self._sequence, "stamp_ns": START_NS + t_ms * MS}

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
        message = said.haptics(
            sequence, START_NS + t_ms * MS, session_id=session_id, handle_position_m=0.0,
            command_position_m=0.001 * sequence, predicted_n=predicted_n, low_n=None, high_n=None,
            leading="", zoh_n=zoh_n, rendered_n=predicted_n or 0.0, delay_s=delay_s,
            force_age_s=None if delay_s is None else delay_s / 2, answered_sequence=answered, energy_j=0.0,
        )  # fmt: skip
        self.put("master/haptics", message, t_ms)

    def force(
        self, t_ms: int, force_n: float, answers: int | None, valid: bool = True, session_id: int = SESSION
    ) -> None:
        answered = None if answers is None else (answers, START_NS)
        header = self.header(t_ms, session_id)
        message = said.force(
            header["sequence"], header["stamp_ns"], answered, session_id=session_id, position_m=0.001,
            force_n=force_n, raw_counts=0, valid=valid,
        )  # fmt: skip
        self.put("slave/force", message, t_ms)

    def slave_state(
        self, t_ms: int, state: SafetyState, stops: int = 0, counters: dict[str, int] | None = None
    ) -> None:
        message = said.slave_state(
            **self.header(t_ms), state=state, reason="", position_m=0.0, stops=stops, counters=counters or {}
        )
        self.put("slave/state", message, t_ms)

    def master_state(
        self,
        t_ms: int,
        clutched_s: float = 0.0,
        offset_ns: int | None = None,
        bound_ns: int | None = None,
        deadman: bool = True,
        indication: str = "armed",
    ) -> None:
        message = said.master_state(
            **self.header(t_ms), indication=indication, reason="", deadman=deadman, clutched_s=clutched_s,
            clock_offset_ns=offset_ns, clock_bound_ns=bound_ns, counters={"forces_unused": 3},
        )  # fmt: skip
        self.put("master/state", message, t_ms)

    def timing(self, t_ms: int, role: str, scheduling: str = "SCHED_FIFO 50") -> None:
        counts = [0] * (len(EDGES_US) + 1)
        counts[10] = t_ms
        message = said.timing(
            **self.header(t_ms), loop=role, ticks=t_ms, p50_us=70.0, p99_us=110.5, edges_us=EDGES_US,
            counts=tuple(counts), scheduling=scheduling,
        )  # fmt: skip
        self.put(f"{role}/timing", message, t_ms)

    def parameters(self, t_ms: int, value: float, *identifiable: str) -> None:
        message = said.parameters(
            **self.header(t_ms), names=("bias.force_n", "spring.stiffness_n_m"), values=(0.5, value),
            standard_deviations=(0.25, 0.125), identifiable=identifiable,
        )  # fmt: skip
        self.put("master/parameters", message, t_ms)

    def limit(self, t_ms: int, rule: str, count: int) -> None:
        message = said.limit(**self.header(t_ms), rule=rule, requested=2.0, applied=1.0, count=count)
        self.put("slave/limit", message, t_ms)

    def safety(
        self,
        t_ms: int,
        event: str,
        reason: str,
        before: SafetyState = S.READY,
        after: SafetyState = S.ENGAGING,
    ) -> None:
        message = said.safety(**self.header(t_ms), before=before, event=event, after=after, reason=reason)
        self.put("slave/safety", message, t_ms)

    def calibration(self, t_ms: int, **fields: str | float | None) -> None:
        self.put("slave/calibration", Calibration.model_validate({**self.header(t_ms), **fields}), t_ms)

    def impairment(self, t_ms: int, role: str, delays_ns: tuple[tuple[int, ...], ...]) -> None:
        message = ImpairmentTrace(**self.header(t_ms), link="inbound", first_index=0, delays_ns=delays_ns)
        self.put(f"{role}/impairment", message, t_ms)

    def handshake(self, t_ms: int, settings: str, accepted: bool = True, reason: str = "") -> None:
        message = Handshake(
            **self.header(t_ms), role="slave", instance_id=1, software="forefeel", settings_hash="0",
            settings=settings, accepted=accepted, reason=reason,
        )  # fmt: skip
        self.put("slave/handshake", message, t_ms)


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
        run.handshake(0, '{"axis": "insertion", "max_force_n": 3.0}')
        for t_ms in range(0, 10_001, 20):
            state = S.IDLE if t_ms < 1000 else S.ARMED if 2000 <= t_ms < 8000 else S.READY
            run.slave_state(t_ms, state, stops=t_ms // 5000, counters={"refused_late": t_ms})
        run.safety(2000, "engage", reason)
        for k in range(1, COMMANDS + 1):
            force_n, sign = float(k), 1 if k % 2 else -1
            delay = min(k, 101)
            run.haptics(
                2000 + 5 * k, k, force_n + sign * k * 1e-3, force_n - sign * k * 2e-3, delay, delay * 1e-3
            )
            run.force(2000 + 5 * k + 1, force_n, k)
            run.force(2000 + 5 * k + 2, force_n + 100.0, k)  # a later answer does not count
        run.limit(3000, "velocity", 4)
        run.limit(4000, "velocity", 3)
        run.impairment(4000, "master", ((5,), (), (7, 7), (9,)))
        for t_ms in range(2000, 10_000, 500):
            run.parameters(t_ms, 7.0 + t_ms / 1e4, "m and k only as k - 0.99 m")
        run.master_state(10_000, clutched_s=0.5, offset_ns=-2 * MS, bound_ns=3 * MS)
        for role in "master", "slave":
            run.timing(9000, role)
            run.timing(9900, role)
