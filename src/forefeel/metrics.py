"""`forefeel metrics`: the newest of what a cell says, as metric families at a port for Prometheus.

A viewer in a process of its own. Everything that a stranger may say is bounded.
"""

import threading
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing
from itertools import accumulate
from typing import Any
from wsgiref.simple_server import WSGIServer

from prometheus_client import CollectorRegistry, start_http_server
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.registry import Collector

from forefeel.common.clock import Clock, MonotonicClock
from forefeel.common.codec import counted, decode
from forefeel.common.errors import CodecError, EndpointError, RunError
from forefeel.common.messages import LoopTiming, MasterState, Message, SafetyState, SlaveState
from forefeel.common.topics import MASTER_STATE, MASTER_TIMING, SLAVE_STATE, SLAVE_TIMING, parse_key
from forefeel.common.transport.security import Party
from forefeel.common.transport.zenoh_bus import ZenohTransport
from forefeel.interrupt import signal_flag
from forefeel.network_settings import ObserverSettings
from forefeel.reachability import cell_watch
from forefeel.terminal import say

_POLL_S = 0.2
_READ = {topic.name for topic in (SLAVE_STATE, MASTER_STATE, MASTER_TIMING, SLAVE_TIMING)}
_MOST_AXES = 32  # whose names come from the network
Kind = type[CounterMetricFamily | GaugeMetricFamily | HistogramMetricFamily]


class Families(dict[str, Any]):
    """Metric families by name, each with the samples of all axes."""

    def add(self, kind: Kind, name: str, text: str, value: Sequence[Any], /, **labels: str) -> None:
        if name not in self:
            self[name] = kind(f"forefeel_{name}", text, labels=list(labels))
        self[name].add_metric(list(labels.values()), *value)

    def gauge(self, name: str, text: str, value: float, /, **labels: str) -> None:
        self.add(GaugeMetricFamily, name, text, [value], **labels)

    def counter(self, name: str, text: str, value: float, /, **labels: str) -> None:
        self.add(CounterMetricFamily, name, text, [value], **labels)


class CellMetrics(Collector):
    """Keeps the newest messages of a cell, from `hear`, and gives them as metric families to Prometheus'
    client, which calls `collect` at each scrape from a thread of its own.

    Attributes:
        malformed: payloads that were no message of their topic.
    """

    def __init__(self, clock: Clock) -> None:
        self.malformed = 0
        self._clock, self._lock = clock, threading.Lock()
        self.axes: set[str] = set()
        self._counts: Counter[tuple[str, str]] = Counter()
        self._newest: dict[tuple[str, str], tuple[Message, int]] = {}

    def hear(self, key: str, payload: bytes, receive_ns: int) -> None:
        """Counts the messages of a payload by axis and topic, and stores the newest state or loop timing; one
        that can not be decoded counts in `malformed`. Ignores other keys, and every axis after the first 32.
        """
        parsed = parse_key(key)
        if parsed is None:
            return
        _, axis, topic = parsed
        with self._lock:
            if axis not in self.axes:
                if len(self.axes) == _MOST_AXES:
                    return
                self.axes.add(axis)
            self._counts[axis, topic.name] += counted(payload)
            if topic.name not in _READ:
                return
            try:
                self._newest[axis, topic.name] = decode(topic.message, payload), receive_ns
            except CodecError:
                self.malformed += 1

    def collect(self) -> Iterator[Metric]:
        """Yields the metric families of a scrape: messages by axis and topic, malformed payloads, ages in s
        of the newest states, and what these say.
        """
        families, now_ns = Families(), self._clock.now_ns()
        with self._lock:
            for (axis, topic), count in sorted(self._counts.items()):
                families.counter("messages", "heard here", count, axis=axis, topic=topic)
            families.counter("malformed", "payloads that were no message", self.malformed)
            for (axis, topic), (message, receive_ns) in sorted(self._newest.items()):
                age_s = (now_ns - receive_ns) * 1e-9
                families.gauge("state_age_seconds", "since the newest", age_s, axis=axis, topic=topic)
                _add(families, axis, topic.partition("/")[0], message)
        yield from families.values()


def _add(families: Families, axis: str, role: str, message: Message) -> None:
    """Adds the samples of a slave's or master's state (safety state, motion, counters, clocks) or of a loop's
    timing, in SI units; ignores other messages.
    """
    match message:
        case SlaveState():
            for state in SafetyState:
                in_it = float(message.state is state)
                families.gauge("safety_state", "1 for the one it is in", in_it, axis=axis, state=state.value)
            families.counter("stops", "out of motion, asked for by nobody", message.stops, axis=axis)
            families.gauge("position_metres", "the stage's readback", message.position_m, axis=axis)
            families.gauge(
                "velocity_metres_per_second", "the stage's readback", message.velocity_m_s, axis=axis
            )
        case MasterState():
            families.gauge("indication", "1: what it shows", 1.0, axis=axis, indication=message.indication)
            families.gauge("deadman", "1: pressed", float(message.deadman), axis=axis)
        case LoopTiming():
            _add_loop(families, message, axis=axis, role=role, loop=message.loop)
    if isinstance(message, SlaveState | MasterState):
        for name, count in sorted(message.counters.items()):
            families.counter("counter", "its own counters", count, axis=axis, role=role, name=name)
        for family, value_ns, text in (
            ("clock_offset_seconds", message.clock_offset_ns, "the other clock minus its own"),
            ("clock_bound_seconds", message.clock_bound_ns, "how far that may be off"),
        ):
            if value_ns is not None:
                families.gauge(family, text, value_ns * 1e-9, axis=axis, role=role)


def _add_loop(families: Families, timing: LoopTiming, **labels: str) -> None:
    """Adds the lateness of a loop's ticks as a histogram in s, with its sum from the middles of the bins (the
    open last one left out), and the count of missed ticks; only that where counts and edges do not fit.
    """
    families.counter("loop_missed", "deadlines that were skipped", timing.missed, **labels)
    if len(timing.counts) != len(timing.edges_us) + 1:
        return
    ends = [*(f"{edge * 1e-6:g}" for edge in timing.edges_us), "+Inf"]
    buckets = list(zip(ends, accumulate(timing.counts), strict=True))
    mean_s = sum(
        0.5e-6 * (low + high) * count
        for low, high, count in zip((0.0, *timing.edges_us), timing.edges_us, timing.counts, strict=False)
    )
    name = "loop_lateness_seconds"
    families.add(HistogramMetricFamily, name, "of its ticks", (buckets, mean_s), **labels)


def serve(collector: Collector, address: str, port: int) -> tuple[WSGIServer, threading.Thread]:
    """Starts a thread that serves the metrics over HTTP; returns (server, thread); `shutdown` of the server
    ends it.

    Raises:
        EndpointError: the port can not be opened.
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
    """Serves the metrics of a cell over HTTP, as a viewer, until SIGINT, SIGTERM, SIGHUP or the duration;
    says every 5 s why nobody is heard.

    Raises:
        InputError: an endpoint, a certificate or the port can not be used.
        RunError: the network failed.
    """
    clock, failed = MonotonicClock(), list[Exception]()
    collector = CellMetrics(clock)
    server, thread = serve(collector, address, port)
    try:
        party = Party("viewer", (settings.cell,))
        transport = ZenohTransport.open(settings.transport, clock, failed.append, party, insecure=insecure)
        with signal_flag() as stop, closing(transport):
            transport.subscribe_all(f"forefeel/{settings.cell}", collector.hear)
            if transport.notice:
                say(transport.notice)
            say(f"metrics of cell {settings.cell} at http://{address}:{port}/metrics; Ctrl-C ends")
            look = cell_watch(settings.transport, party, transport, clock)
            for _ in stop.polls(duration_s, _POLL_S):
                look(bool(collector.axes))
                if failed:
                    error = failed[0]
                    raise RunError(f"metrics: the network failed: {type(error).__name__}: {error}") from error
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
