"""State of one axis for the page: chart traces and the newest message of each kind. Pure, bounded."""

from math import nan

from forefeel.common.events.text import gap
from forefeel.common.messages import (
    ForceSample,
    Grip,
    HapticSample,
    InstrumentShape,
    LoopTiming,
    MasterState,
    Message,
    ModelParameters,
    SlaveState,
)
from forefeel.common.slots import CommandRing
from forefeel.common.topics import MASTER_TIMING, Topic
from forefeel.dashboard.detector import Comparison, ModelWatch
from forefeel.dashboard.event_log import EventList
from forefeel.dashboard.timeline import Timeline
from forefeel.dashboard.trace import SPAN_S, MinMaxTrace, SampleRing, ShapeTrace

_RATE_HZ = 1000  # Hz, at most, of answered commands, whose delays are kept for a minute
_AHEAD_S = 1.0  # s by which a force may lie ahead of now
_ENERGY_BIN_S = 0.2  # s, bin of the trace of the energy, which changes slowly


class Newest:
    """Newest message of each kind, None before it; `timings` by role, `heard_ns` by topic."""

    def __init__(self) -> None:
        self.haptics: HapticSample | None = None
        self.force: ForceSample | None = None
        self.slave: SlaveState | None = None
        self.master: MasterState | None = None
        self.model: ModelParameters | None = None
        self.timings: dict[str, LoopTiming] = {}
        self.heard_ns: dict[str, int] = {}


def new_traces() -> dict[str, MinMaxTrace]:
    """Empty traces of the charts. predicted: force, low and high end of the band; late: the newest force that
    has arrived, and the prediction at that moment; readback: position of the stage, and the distance that it
    has moved with the gripper open, without the instrument.
    """
    return {
        "felt": MinMaxTrace(),
        "predicted": MinMaxTrace(3),
        "late": MinMaxTrace(2),
        "measured": MinMaxTrace(),
        "commanded": MinMaxTrace(),
        "readback": MinMaxTrace(2),
        "energy": MinMaxTrace(bin_s=_ENERGY_BIN_S),
    }


class AxisView:
    """Fed with messages as they come, by one thread at a time.

    Measured force, readback and shape are drawn at the time of the command that they answer, on the master's
    clock: the delay, and the difference of the two clocks, stay out of it. What answers no command is drawn
    when it was heard.

    Attributes:
        delays: time of receipt in s and round trip in s of each newly answered command.
        worst_energy_j: the lowest that was received.
        had_session: the master had a session with the slave.
    """

    def __init__(self) -> None:
        self.newest = Newest()
        self.timeline = Timeline()
        self.traces = new_traces()
        self.watch = ModelWatch()
        self.comparison = Comparison()
        self.events = EventList()
        self.delays = SampleRing(round(SPAN_S * _RATE_HZ), 2)
        self.worst_energy_j = 0.0
        self.had_session = False
        self.shapes = ShapeTrace()
        self._samples = CommandRing[HapticSample]()
        self._answered: tuple[int, int] | None = None
        self._slip_m = 0.0

    def take(self, topic: Topic[Message], message: Message, receive_ns: int) -> None:
        """Stores a message as the newest of its kind, or as an event, and adds what it holds to traces and
        statistics; notes when its topic was heard, and as an event that its sender was silent before.
        """
        newest = self.newest
        match message:
            case HapticSample():
                self._add_haptics(message, receive_ns)
            case ForceSample():
                self._add_force(message, receive_ns)
            case SlaveState():
                self._say_gap(topic, newest.slave, message, receive_ns)
                newest.slave = message
            case MasterState():
                self._say_gap(topic, newest.master, message, receive_ns)
                newest.master = message
                self.had_session |= message.indication not in {"no_session", "handle_fault"}
            case ModelParameters():
                newest.model = message
                self.watch.innovation(self.timeline.now_s(receive_ns), message.innovation_rms_n)
            case InstrumentShape():
                now_s = self.timeline.now_s(receive_ns)
                self.shapes.add(
                    now_s if newest.force is None else self._place_s(newest.force, now_s), message
                )
            case LoopTiming():
                newest.timings["master" if topic.name == MASTER_TIMING.name else "slave"] = message
            case _:
                self.events.hear(message, topic.name.partition("/")[0], receive_ns)
        newest.heard_ns[topic.name] = receive_ns

    def _say_gap(
        self, topic: Topic[Message], before: Message | None, state: Message, receive_ns: int
    ) -> None:
        if silence := gap(topic, before, state):
            self.events.add("warn", topic.publisher, silence, receive_ns)

    def _add_haptics(self, sample: HapticSample, receive_ns: int) -> None:
        """Adds a sample to the traces, unless it is out of order; clears traces, model watch and comparison
        if the master's clock began anew. Keeps it for the force that answers its command, and the delay of a
        command that is newly answered.
        """
        anew = self.timeline.add_stamp(sample.stamp_ns, receive_ns)
        if anew is None:
            return
        if anew:
            self.traces, self.watch, self.comparison = new_traces(), ModelWatch(), Comparison()
            self.shapes = ShapeTrace()
        self.newest.haptics, t_s, traces = sample, self.timeline.stamp_s(sample.stamp_ns), self.traces
        traces["felt"].add(t_s, sample.rendered_n)
        traces["commanded"].add(t_s, sample.command_position_m)
        traces["energy"].add(t_s, sample.energy_j)
        self.worst_energy_j = min(self.worst_energy_j, sample.energy_j)
        if sample.predicted_n is not None:
            low_n, high_n = (nan if end is None else end for end in (sample.low_n, sample.high_n))
            traces["predicted"].add(t_s, sample.predicted_n, low_n, high_n)
        if sample.zoh_n is not None:
            traces["late"].add(t_s, sample.zoh_n, nan if sample.predicted_n is None else sample.predicted_n)
        self._samples.put(sample.stamp_ns, sample)
        answered = None if sample.answered_sequence is None else (sample.session_id, sample.answered_sequence)
        if sample.delay_s is not None and answered not in (None, self._answered):
            self._answered = answered
            self.delays.add(receive_ns * 1e-9, sample.delay_s)

    def _add_force(self, sample: ForceSample, receive_ns: int) -> None:
        """Adds readback, slip and a valid force to the traces. Compares prediction and zero-order hold of the
        command that it answers, if still retained, with the force, and tells the watch whether it left the
        band. Slip: signed displacement of the stage while the gripper was not closed.
        """
        now_s = self.timeline.now_s(receive_ns)
        t_s = self._place_s(sample, now_s)
        before, self.newest.force = self.newest.force, sample
        if before is not None and before.gripper is not Grip.CLOSED:
            self._slip_m += sample.position_m - before.position_m
        self.traces["readback"].add(t_s, sample.position_m, self._slip_m)
        if not sample.valid:
            return
        self.traces["measured"].add(t_s, sample.force_n)
        haptics = self._answered_sample(sample)
        if haptics is None:
            return
        if haptics.predicted_n is not None and haptics.zoh_n is not None:
            self.comparison.add(now_s, haptics.predicted_n, haptics.zoh_n, sample.force_n)
        if haptics.low_n is not None and haptics.high_n is not None:
            self.watch.force(now_s, not haptics.low_n <= sample.force_n <= haptics.high_n)

    def _place_s(self, sample: ForceSample, now_s: float) -> float:
        """Time on the charts of the command that a force answers; `now_s` without one of the last minute."""
        stamp_ns = sample.answers_stamp_ns
        if stamp_ns is None:
            return now_s
        t_s = self.timeline.stamp_s(stamp_ns)
        return t_s if now_s - SPAN_S < t_s < now_s + _AHEAD_S else now_s

    def _answered_sample(self, sample: ForceSample) -> HapticSample | None:
        """The master's sample of the motion that the force answers; None: none, or no longer retained."""
        haptics = self._samples.get(sample.answers_stamp_ns or 0)
        return haptics if haptics is not None and haptics.session_id == sample.session_id else None
