"""`forefeel metrics`: the newest of what a cell says, as metric families at a port for Prometheus.

A viewer in a process of its own. Everything that a stranger may say is bounded.
"""

import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from itertools import accumulate
from wsgiref.simple_server import WSGIServer

from prometheus_client import CollectorRegistry, start_http_server
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    Metric,
)
from prometheus_client.registry import Collector

from forefeel.common.clock import MonotonicClock
from forefeel.common.codec import decode
from forefeel.common.errors import CodecError, EndpointError, RunError
from forefeel.common.messages import (
    LimitEvent,
    LoopTiming,
    MasterEvent,
    MasterState,
    Message,
    ModelParameters,
    SafetyEvent,
    SafetyState,
    SlaveState,
)
from forefeel.common.topics import (
    LIMIT_EVENT,
    MASTER_EVENT,
    MASTER_LIMIT,
    MASTER_STATE,
    MASTER_TIMING,
    PARAMETERS,
    SAFETY_EVENT,
    SLAVE_STATE,
    SLAVE_TIMING,
    parse_key,
)
from forefeel.common.transport.security import Party
from forefeel.common.transport.zenoh_bus import ZenohTransport
from forefeel.interrupt import Stop, heeded
from forefeel.network_settings import ObserverSettings
from forefeel.terminal import say

_POLL_S = 0.2
_STATES = (SLAVE_STATE, MASTER_STATE, PARAMETERS, MASTER_TIMING, SLAVE_TIMING)
_EVENTS = (LIMIT_EVENT, MASTER_LIMIT, SAFETY_EVENT, MASTER_EVENT)
_READ = {topic.name: topic for topic in (*_STATES, *_EVENTS)}
_MOST_AXES, _MOST_NAMES = 32, 64  # that are counted apart: both come from the network
_OTHER = "other"


class CellMetrics:
    """Fed with payloads as they come, asked for families at each scrape.

    Attributes:
        malformed: payloads that were no message of their topic.
    """

    def __init__(self) -> None:
        self.malformed = 0
        self._axes: set[str] = set()
        self._counts: Counter[tuple[str, str]] = Counter()
        self._newest: dict[tuple[str, str], tuple[Message, int]] = {}
        self._limits: Counter[tuple[str, str, str]] = Counter()
        self._events: Counter[tuple[str, str, str]] = Counter()

    def hear(self, key: str, payload: bytes, receive_ns: int) -> None:
        """A payload from the network; the 1 kHz streams are counted only."""
        parsed = parse_key(key)
        if parsed is None:
            return
        _, axis, topic = parsed
        if axis not in self._axes:
            if len(self._axes) == _MOST_AXES:
                return
            self._axes.add(axis)
        self._counts[axis, topic.name] += 1
        if topic.name not in _READ:
            return
        try:
            self._take(axis, topic.name, decode(topic.message, payload), receive_ns)
        except CodecError:
            self.malformed += 1

    def _take(self, axis: str, name: str, message: Message, receive_ns: int) -> None:
        role = name.partition("/")[0]
        match message:
            case LimitEvent():
                self._limits[_known(self._limits, (axis, role, message.rule))] += message.count
            case SafetyEvent() | MasterEvent():
                self._events[_known(self._events, (axis, role, message.event))] += 1
            case _:
                self._newest[axis, name] = message, receive_ns

    def families(self, now_ns: int) -> Iterator[Metric]:
        messages = CounterMetricFamily("forefeel_messages", "heard here", labels=["axis", "topic"])
        for (axis, topic), count in sorted(self._counts.items()):
            messages.add_metric([axis, topic], count)
        yield messages
        yield CounterMetricFamily("forefeel_malformed", "payloads that were no message", self.malformed)
        yield from self._states(now_ns)
        yield from _counted("forefeel_limits", "interventions, by their rule", "rule", self._limits)
        yield from _counted("forefeel_transitions", "transitions, by their event", "event", self._events)

    def _states(self, now_ns: int) -> Iterator[Metric]:
        age = GaugeMetricFamily("forefeel_state_age_seconds", "since the newest", labels=["axis", "topic"])
        found: list[Metric] = [age]
        for (axis, topic), (message, receive_ns) in sorted(self._newest.items()):
            age.add_metric([axis, topic], (now_ns - receive_ns) * 1e-9)
            match message:
                case SlaveState():
                    found += _of_slave(axis, message)
                case MasterState():
                    found += _of_master(axis, message)
                case ModelParameters():
                    found += _of_model(axis, message)
                case LoopTiming():
                    found += _of_loop(axis, topic.partition("/")[0], message)
        yield from _joined(found)


def _known(counts: Counter[tuple[str, str, str]], key: tuple[str, str, str]) -> tuple[str, str, str]:
    """The key, or one for all that came after so many: names come from the network."""
    return key if key in counts or len(counts) < _MOST_NAMES else (key[0], key[1], _OTHER)


def _counted(
    name: str, text: str, label: str, counts: Counter[tuple[str, str, str]]
) -> Iterator[CounterMetricFamily]:
    family = CounterMetricFamily(name, text, labels=["axis", "role", label])
    for labels, count in sorted(counts.items()):
        family.add_metric(list(labels), count)
    yield family


def _of_slave(axis: str, state: SlaveState) -> Iterator[Metric]:
    for each in SafetyState:
        in_it = float(state.state is each)
        yield _gauge("safety_state", "1 for the one it is in", in_it, axis=axis, state=each.value)
    yield _counter("stops", "out of motion, but by a release", state.stops, axis=axis)
    yield _gauge("position_metres", "the stage's readback", state.position_m, axis=axis)
    yield _gauge("velocity_metres_per_second", "the stage's readback", state.velocity_m_s, axis=axis)
    yield from _common(axis, "slave", state)


def _of_master(axis: str, state: MasterState) -> Iterator[Metric]:
    yield _gauge("indication", "1: what it shows", 1.0, axis=axis, indication=state.indication)
    yield _gauge("deadman", "1: pressed", float(state.deadman), axis=axis)
    yield from _common(axis, "master", state)


def _common(axis: str, role: str, state: SlaveState | MasterState) -> Iterator[Metric]:
    for name, count in sorted(state.counters.items()):
        yield _counter("counter", "its own counters", count, axis=axis, role=role, name=name)
    for name, value_ns, text in (
        ("clock_offset_seconds", state.clock_offset_ns, "the other clock minus its own"),
        ("clock_bound_seconds", state.clock_bound_ns, "how far that may be off"),
    ):
        if value_ns is not None:
            yield _gauge(name, text, value_ns * 1e-9, axis=axis, role=role)


def _of_model(axis: str, model: ModelParameters) -> Iterator[Metric]:
    yield _gauge("innovation_rms_newtons", "of the model", model.innovation_rms_n, axis=axis)
    for name, values, text in (
        ("parameter", model.values, "identified, in the unit of its name"),
        ("parameter_standard_deviation", model.standard_deviations, "of the parameter"),
    ):
        for parameter, value in zip(model.names, values, strict=False):
            yield _gauge(name, text, value, axis=axis, name=parameter)


def _gauge(family: str, text: str, value: float, /, **labels: str) -> Metric:
    found = GaugeMetricFamily(f"forefeel_{family}", text, labels=list(labels))
    found.add_metric(list(labels.values()), value)
    return found


def _counter(family: str, text: str, value: float, /, **labels: str) -> Metric:
    found = CounterMetricFamily(f"forefeel_{family}", text, labels=list(labels))
    found.add_metric(list(labels.values()), value)
    return found


def _of_loop(axis: str, role: str, timing: LoopTiming) -> Iterator[Metric]:
    labels = ["axis", "role", "loop"]
    lateness = HistogramMetricFamily("forefeel_loop_lateness_seconds", "of its ticks", labels=labels)
    ends = [*(f"{edge * 1e-6:g}" for edge in timing.edges_us), "+Inf"]
    total = list(accumulate(timing.counts))
    mean_s = sum(
        0.5e-6 * (low + high) * count
        for low, high, count in zip((0.0, *timing.edges_us), timing.edges_us, timing.counts, strict=False)
    )
    lateness.add_metric([axis, role, timing.loop], list(zip(ends, total, strict=False)), mean_s)
    yield lateness
    text = "deadlines that were skipped"
    yield _counter("loop_missed", text, timing.missed, axis=axis, role=role, loop=timing.loop)


def _joined(families: list[Metric]) -> Iterator[Metric]:
    """One family for each name, with the samples of all axes."""
    found: dict[str, Metric] = {}
    for family in families:
        known = found.setdefault(family.name, family)
        if known is not family:
            known.samples += family.samples
    yield from found.values()


class CellCollector(Collector):
    """Asked by Prometheus' client at each scrape, from a thread of its own."""

    def __init__(self, clock: MonotonicClock) -> None:
        self.cell = CellMetrics()
        self._clock, self._lock = clock, threading.Lock()

    def hear(self, key: str, payload: bytes, receive_ns: int) -> None:
        with self._lock:
            self.cell.hear(key, payload, receive_ns)

    def collect(self) -> Iterator[Metric]:
        with self._lock:
            return iter(list(self.cell.families(self._clock.now_ns())))


def serve(collector: Collector, address: str, port: int) -> tuple[WSGIServer, threading.Thread]:
    """The port; `shutdown` of the server ends it.

    Raises:
        EndpointError: it can not be opened.
    """
    registry = CollectorRegistry(auto_describe=False)
    registry.register(collector)
    try:
        return start_http_server(port, address, registry)
    except OSError as error:
        raise EndpointError(f"--port {port} at {address}: {error.strerror}; expected a free one") from error


def run_metrics(
    settings: ObserverSettings, address: str, port: int, duration_s: float | None, insecure: bool = False
) -> None:
    """Serves until SIGINT, SIGTERM, SIGHUP or the duration.

    Raises:
        InputError: an endpoint, a certificate or the port can not be used.
        RunError: the network failed.
    """
    clock, failed = MonotonicClock(), list[Exception]()
    collector = CellCollector(clock)
    server, thread = serve(collector, address, port)
    try:
        party = Party("viewer", (settings.cell,))
        transport = ZenohTransport.open(settings.transport, clock, failed.append, party, insecure=insecure)
        with heeded() as stop, closing(transport):
            transport.subscribe_all(f"forefeel/{settings.cell}", collector.hear)
            if transport.notice:
                say(transport.notice)
            say(f"metrics of cell {settings.cell} at http://{address}:{port}/metrics; Ctrl-C ends")
            _wait(failed, duration_s, stop)
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def _wait(failed: list[Exception], duration_s: float | None, stop: Stop) -> None:
    start_s = time.monotonic()
    while not (failed or stop.wanted()) and (duration_s is None or time.monotonic() - start_s < duration_s):
        time.sleep(_POLL_S)
    if failed:
        raise RunError(f"metrics: the network failed: {type(failed[0]).__name__}: {failed[0]}") from failed[0]
