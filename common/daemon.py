"""Common parts of both daemons: one impaired transport, the reports on loop timing and impairment."""

from collections.abc import Callable, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import TypeVar

from forefeel.common.bus import Bus
from forefeel.common.errors import RecordingError
from forefeel.common.lateness import EDGES_US, Lateness
from forefeel.common.messages import ImpairmentTrace, LoopTiming
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.runtime.port import Runtime, Tick
from forefeel.common.settings import LinkImpairment
from forefeel.common.topics import BY_NAME, Role
from forefeel.common.transport.impaired import ImpairedTransport
from forefeel.common.transport.impairment import ImpairedLink, Impairment, ReplayedImpairment
from forefeel.common.transport.port import Transport
from forefeel.common.transport.settings import ImpairmentSettings

A = TypeVar("A")
SECOND_NS = 1_000_000_000  # ns in a second, from which the periods of the tasks are derived
_KNOWN_NS = SECOND_NS
"""Time after its start until a daemon knows who listens; nobody receives what is published before."""


@cache
def software_version() -> str:
    try:
        return version("forefeel")
    except PackageNotFoundError:  # run from a source tree
        return "not installed"


def impaired(inner: Transport, settings: LinkImpairment, role: Role, runtime: Runtime) -> ImpairedTransport:
    """Wraps `inner` with the impairment of the settings: drawn from seeds, one for each role and direction,
    or replayed from a recorded run. A direction without any passes unchanged.

    Raises:
        RecordingError: `replay` is no run of ours, or one without impairment of this end.
    """
    first_seed = 4 * settings.seed + (2 if role == "slave" else 0)
    if settings.replay is not None:
        run = Run(settings.replay)
        inbound, outbound = _replayed(run, role, "inbound"), _replayed(run, role, "outbound")
        if inbound is None and outbound is None:
            raise RecordingError(
                f"{settings.replay}: no impairment of the {role}'s links, expected a run that had one"
            )
    else:
        inbound, outbound = _drawn(settings.inbound, first_seed), _drawn(settings.outbound, first_seed + 1)
    return ImpairedTransport(inner, runtime.timers, runtime.clock, inbound, outbound)


def _drawn(settings: ImpairmentSettings, seed: int) -> ImpairedLink | None:
    return None if settings.transparent else Impairment(settings, seed)


def _replayed(run: Run, role: Role, link: str) -> ImpairedLink | None:
    trace = run.impairment_trace(f"{role}/impairment", link)
    return ReplayedImpairment(trace) if trace else None


def for_each(axes: Sequence[A], action: Callable[[A, int], None]) -> Tick:
    """Tick that calls `action(axis, now_ns)` for each axis in turn."""

    def tick(now_ns: int) -> None:
        for axis in axes:
            action(axis, now_ns)

    return tick


class Reports:
    """Publishes, by two tasks that it registers, the loop's lateness each second and the impairment's trace
    each 0.1 s, under the axis of `bus`.
    """

    def __init__(
        self, bus: Bus, role: Role, lateness: Lateness, transport: ImpairedTransport, runtime: Runtime
    ) -> None:
        self._loop = {"master": "haptic", "slave": "control"}[role]
        self._lateness = lateness
        self._transport = transport
        self._runtime = runtime
        self._since_ns: int | None = None
        self._timing = bus.publisher(BY_NAME[f"{role}/timing"])
        self._trace = bus.publisher(BY_NAME[f"{role}/impairment"])
        runtime.task(f"{role} timing", SECOND_NS, self.timing)
        runtime.task(f"{role} impairment trace", SECOND_NS // 10, self.impairment)

    def timing(self, now_ns: int) -> None:
        """Publishes the loop's lateness since its start: ticks, missed ones, quantiles, histogram."""
        lateness = self._lateness
        self._timing.send(
            LoopTiming(
                **self._timing.header(0, now_ns),
                loop=self._loop,
                ticks=lateness.ticks,
                missed=lateness.missed,
                p50_us=lateness.quantile_us(0.50),
                p99_us=lateness.quantile_us(0.99),
                max_us=lateness.max_us,
                edges_us=EDGES_US,
                counts=tuple(lateness.counts),
                scheduling=self._runtime.scheduling,
            )
        )

    def flush(self, now_ns: int) -> None:
        """Publishes lateness and trace a last time, after the loop's end; the trace in any case."""
        try:
            self.timing(now_ns)
        finally:
            self.impairment(now_ns, last=True)

    def impairment(self, now_ns: int, last: bool = False) -> None:
        """Publishes the impairment's trace since the last call. In the first second after the first call it
        keeps the trace for later, as no recorder listens yet, unless `last`.
        """
        self._since_ns = now_ns if self._since_ns is None else self._since_ns
        if now_ns - self._since_ns < _KNOWN_NS and not last:
            return
        for chunk in self._transport.drain_trace():
            header = self._trace.header(0, now_ns)
            self._trace.send(ImpairmentTrace(**header, **chunk._asdict()))
