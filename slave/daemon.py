"""The slave's composition root: the only place that knows concrete classes; and the clearing of latched stops
and faults, a local act, for all axes that hang together in one tick.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import ExitStack
from typing import NamedTuple

from forefeel.common.bus import Bus
from forefeel.common.clock import Clock
from forefeel.common.daemon import SECOND_NS, Reports, for_each, impaired
from forefeel.common.events.sink import NULL_EVENT_SINK, EventSink
from forefeel.common.hardware.driver import driver_of
from forefeel.common.runtime.port import Runtime
from forefeel.common.settings import TICK_NS
from forefeel.common.slots import BoundedQueue
from forefeel.common.transport.port import Transport
from forefeel.slave.axis import SlaveAxis
from forefeel.slave.devices import Devices
from forefeel.slave.plant.world import SimulatedWorld
from forefeel.slave.settings import SlaveAxisSettings, SlaveSettings

_ANNOUNCE_NS = 2 * SECOND_NS  # who begins to record hears the calibrations soon
_CLEARINGS = 64  # between two ticks; far more than the local socket serves at once


FOLLOWS = "axis {} is halted"
"""Reason for which an axis stops with another one."""


class Clearing(NamedTuple):
    """Result for one axis: what was latched, and why it still is; empty when it is not any more."""

    axis: str
    was: str
    still: str


class ClearRequest:
    """Clearing that the next tick is to do, unless `done`, its result, is cancelled before."""

    def __init__(self, axis: str | None) -> None:
        self.done: Future[list[Clearing]] = Future()
        self._axis = axis
        self._was: list[tuple[SlaveAxis, str]] = []

    def begin(self, axes: Sequence[SlaveAxis]) -> bool:
        """Makes the halted axes that the request names clear at their next tick, and stores their reasons;
        returns True. False, and nothing is cleared, if the request was cancelled: `end` must not follow.
        """
        if not self.done.set_running_or_notify_cancel():
            return False
        chosen = [axis for axis in axes if axis.halted and self._means(axis)]
        self._was = [(axis, f"{axis.state.value}: {axis.reason}") for axis in chosen]
        for axis in chosen:
            axis.clear()
        return True

    def end(self) -> None:
        self.done.set_result(
            [Clearing(axis.name, was, axis.reason if axis.halted else "") for axis, was in self._was]
        )

    def _means(self, axis: SlaveAxis) -> bool:
        """True for the named axis and those that were halted by it; for any, where none is named."""
        return self._axis in (None, axis.name) or axis.reason == FOLLOWS.format(self._axis)


class SlaveDaemon:
    """Every axis of the slave on one runtime. `axes`: in the order of the settings."""

    def __init__(
        self,
        settings: SlaveSettings,
        inner: Transport,
        runtime: Runtime,
        new_id: Callable[[], int],
        event_sink: EventSink = NULL_EVENT_SINK,
    ) -> None:
        """Builds the axes, opens their devices and registers loops and tasks; on an error closes the devices.
        Nothing moves before the runtime starts.

        Raises:
            InputError: a file that the settings name can not be used.
            DeviceError: a device does not answer.
        """
        self.transport = impaired(inner, settings.impairment, "slave", runtime)
        buses = [
            Bus(self.transport, settings.cell, axis.name, runtime.clock, event_sink.rings)
            for axis in settings.axes
        ]
        self._event_sink, self._now_ns = event_sink, runtime.clock.now_ns
        self._clear: BoundedQueue[ClearRequest] = BoundedQueue(_CLEARINGS)
        worlds = {axis.name: SimulatedWorld(axis.simulation, axis.seed) for axis in settings.axes}
        for wanted in settings.axes:
            worlds[wanted.name].others = {name: worlds[name] for name in wanted.columns}
        devices = [_devices(wanted, worlds[wanted.name], runtime.clock) for wanted in settings.axes]
        self.axes = [
            SlaveAxis(settings.cell, axis, of, bus, new_id(), event_sink)
            for axis, of, bus in zip(settings.axes, devices, buses, strict=True)
        ]
        with ExitStack() as opened:  # closed again when the daemon can not be composed
            for axis in self.axes:
                opened.callback(axis.close)
                axis.open(runtime.clock.now_ns())
            self._register(runtime, buses[0])
            opened.pop_all()

    def _register(self, runtime: Runtime, bus: Bus) -> None:
        """Registers control loop (`tick`), fault handler and periodic tasks of all axes with the runtime;
        adds the reports on timing and impairment. `bus`: of the first axis, which publishes these.
        """
        self._loop = runtime.loop("control", TICK_NS, self.tick)
        runtime.on_fault(self.fail)
        runtime.task("serve", SECOND_NS // 100, self._serve)
        runtime.task("heartbeat", SECOND_NS // 20, for_each(self.axes, SlaveAxis.beat))
        runtime.task("state", SECOND_NS // 50, for_each(self.axes, SlaveAxis.report))
        runtime.task("calibration", _ANNOUNCE_NS, for_each(self.axes, SlaveAxis.announce))
        self._reports = Reports(bus, "slave", self._loop, self.transport, runtime)

    def tick(self, now_ns: int) -> None:
        """Ticks every axis; waiting clear requests begin before and end after, even if a tick raises. If then
        an axis is in FAULT or ESTOPPED, every other that is not gets an emergency stop that names the first.
        """
        clearings = [request for request in self._clear.drain() if request.begin(self.axes)]
        try:
            for axis in self.axes:
                axis.tick(now_ns)
        finally:  # also of the last tick: who waits is told what became of it
            for clearing in clearings:
                clearing.end()
        halted = [axis.name for axis in self.axes if axis.halted]
        if halted:
            for axis in self.axes:
                if not axis.halted:
                    axis.emergency_stop(FOLLOWS.format(halted[0]))

    def clear(self, axis: str | None = None) -> Future[list[Clearing]]:
        """Asks the next tick to clear what is latched, of one axis and those that follow it, or of all.

        Only ever called by a local act at the slave. The result is of that tick: a cause that lasts may
        show later. Who does not wait for it cancels it: what is cancelled before that tick clears nothing.
        """
        request = ClearRequest(axis)
        self._clear.put(request)
        return request.done

    def fail(self, error: BaseException) -> None:
        """Fails every axis, latches what waits for a tick if the control loop has ended, then logs the fault.
        Every step runs even if another raises; the exception is raised at the end.
        """
        with ExitStack() as reactions:
            reactions.callback(self._event_sink.thread_fault, self.axes[0].name, error, self._now_ns())
            for axis in self.axes:
                reactions.callback(self._settle, axis)
            for axis in self.axes:  # a stack: these are the first
                reactions.callback(axis.fail, error)

    def _settle(self, axis: SlaveAxis) -> None:
        """Stands in for the tick that never comes, when the control loop has ended by a fault."""
        if self._loop.ended:
            axis.settle(self._now_ns())

    def shut_down(self) -> None:
        """Asks every axis to come to rest and to arm no more; see `at_rest`."""
        for axis in self.axes:
            axis.shutdown = True

    @property
    def at_rest(self) -> bool:
        return all(axis.at_rest for axis in self.axes)

    def close(self, now_ns: int) -> None:
        """Latches the stops and faults that wait for a tick, publishes the last events, states and reports,
        closes devices and transport; to be called after the loops have ended. Every step runs even if another
        raises; the exception is raised at the end.
        """
        with ExitStack() as steps:  # a stack: the last one first
            steps.callback(self.transport.close)
            for axis in reversed(self.axes):
                steps.callback(axis.close)
            steps.callback(self._reports.flush, now_ns)
            for axis in reversed(self.axes):
                steps.callback(axis.report, now_ns)
            for axis in reversed(self.axes):
                steps.callback(axis.serve, now_ns, last=True)
                steps.callback(axis.settle, now_ns)

    def _serve(self, now_ns: int) -> None:
        for axis in self.axes:
            self._settle(axis)  # a stop is heeded while the daemon comes to its end
            axis.serve(now_ns)


def _devices(settings: SlaveAxisSettings, world: SimulatedWorld, clock: Clock) -> Devices:
    """Builds the drivers that the settings name, not opened, with the origin of each by slot. Simulated ones
    share the axis's world; the others get the clock.
    """
    sections = settings.sections
    drivers = {slot: driver_of(slot, section) for slot, section in sections.items()}
    ports = {
        slot: driver.make(sections[slot], world if driver.driver.in_world else clock)
        for slot, driver in drivers.items()
    }
    origins: dict[str, str] = {slot: driver.origin for slot, driver in drivers.items()}
    return Devices(**ports, drivers=origins, shape_m=world.shape_m)
