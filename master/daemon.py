"""The master's composition root: the only place that knows concrete classes."""

from collections.abc import Callable
from contextlib import ExitStack

from forefeel.common.bus import Bus
from forefeel.common.clock import Clock, now_utc
from forefeel.common.daemon import SECOND_NS, Reports, for_each, impaired
from forefeel.common.estimation.learner import Learner
from forefeel.common.events.sink import NULL_EVENT_SINK, EventSink
from forefeel.common.hardware.driver import driver_of
from forefeel.common.model_file import load_model
from forefeel.common.runtime.port import Runtime
from forefeel.common.settings import TICK_NS
from forefeel.common.transport.port import Transport
from forefeel.master.axis import MasterAxis
from forefeel.master.handle import Handle, HandleDriverSettings
from forefeel.master.haptics import HapticLoop
from forefeel.master.prediction import ForcePrediction, IdentificationTask
from forefeel.master.prior import keep, load
from forefeel.master.settings import MasterAxisSettings, MasterSettings


class MasterDaemon:
    """Every axis of the master on one runtime. `axes`: in the order of the settings."""

    def __init__(
        self,
        settings: MasterSettings,
        inner: Transport,
        runtime: Runtime,
        new_id: Callable[[], int],
        event_sink: EventSink = NULL_EVENT_SINK,
    ) -> None:
        """Builds the axes, opens their handles and registers loops and tasks; on an error closes the handles.

        Raises:
            InputError: a file that the settings name can not be used.
            DeviceError: the handle does not answer.
        """
        self.transport = impaired(inner, settings.impairment, "master", runtime)
        self._event_sink, self._now_ns = event_sink, runtime.clock.now_ns
        self._wanted = [axis.prediction for axis in settings.axes]
        buses = [
            Bus(self.transport, settings.cell, axis.name, runtime.clock, event_sink.rings)
            for axis in settings.axes
        ]
        self.axes = [
            _axis(settings, axis, bus, new_id, runtime, event_sink)
            for axis, bus in zip(settings.axes, buses, strict=True)
        ]
        by_name = {axis.name: axis for axis in self.axes}
        followed = [[by_name[name] for name in axis.columns] for axis in settings.axes]
        # who follows another axis comes after it, and meets its stage of the same tick
        self._ticked = sorted(zip(self.axes, followed, strict=True), key=lambda pair: len(pair[1]))
        with ExitStack() as opened:  # closed again when the daemon can not be composed
            for axis in self.axes:
                opened.callback(axis.handle.close)
                axis.open()
            self._register(runtime, buses[0])
            opened.pop_all()

    def _register(self, runtime: Runtime, bus: Bus) -> None:
        """Registers fault handler, haptic loop (`tick`) and periodic tasks of all axes with the runtime; adds
        the reports on timing and impairment. `bus`: of the first axis, which publishes these.
        """
        runtime.on_fault(self.fail)
        lateness = runtime.loop("haptic", TICK_NS, self.tick)
        for name, period_ns, action in (
            ("serve", SECOND_NS // 20, MasterAxis.serve),
            ("stop", SECOND_NS // 50, MasterAxis.send_stop),
            ("heartbeat", SECOND_NS // 20, MasterAxis.beat),
            ("identification", SECOND_NS // 200, MasterAxis.identify),
            ("parameters", SECOND_NS // 20, MasterAxis.publish_parameters),
            ("state", SECOND_NS // 10, MasterAxis.report),
        ):
            runtime.task(name, period_ns, for_each(self.axes, action))
        self._reports = Reports(bus, "master", lateness, self.transport, runtime)

    @property
    def finished(self) -> bool:
        return all(axis.handle.finished for axis in self.axes)

    def tick(self, now_ns: int) -> None:
        for axis, followed in self._ticked:
            axis.tick(now_ns, {other.name: other.stage_m for other in followed})

    def fail(self, error: BaseException) -> None:
        """Logs a fault of any thread and fails every axis, whatever another one raises."""
        with ExitStack() as reactions:
            reactions.callback(self._event_sink.thread_fault, self.axes[0].name, error, self._now_ns())
            for axis in self.axes:
                reactions.callback(axis.fail, error)

    def shut_down(self) -> None:
        """Sets `stopping` of every axis: from the next tick the deadman is released, the force fades out."""
        for axis in self.axes:
            axis.stopping = True

    def close(self, now_ns: int) -> None:
        """Publishes the last states, reports and events, closes handles and transport, then stores the
        priors; to be called after the loops have ended. The exception of a step is raised after all others.
        """
        with ExitStack() as steps:  # a stack: the last one first
            steps.callback(self._keep_priors)
            steps.callback(self.transport.close)
            for axis in reversed(self.axes):
                steps.callback(axis.handle.close)
                steps.callback(axis.flush, now_ns)
            steps.callback(self._reports.flush, now_ns)
            for axis in reversed(self.axes):
                steps.callback(axis.report, now_ns)

    def _keep_priors(self) -> None:
        """Stores the prior of each axis whose settings name one; adds a notice: stored, or why not."""
        for axis, wanted in zip(self.axes, self._wanted, strict=True):
            faulted = axis.faulted or not axis.stopping
            line = keep(wanted, axis.identification.learner, faulted, now_utc().date())
            if line:
                axis.events.notices.add(f"prior {line}")


def _axis(
    daemon: MasterSettings,
    settings: MasterAxisSettings,
    bus: Bus,
    new_id: Callable[[], int],
    runtime: Runtime,
    event_sink: EventSink,
) -> MasterAxis:
    """Builds an axis with handle (not opened), haptic loop and learner, which starts from the prior and the
    model of the settings. Raises InputError: a file that the settings name can not be used.
    """
    wanted = settings.prediction
    prior, origin = load(wanted, daemon.accept_prior)
    model = None if wanted.model is None else load_model(wanted.model)
    prediction = ForcePrediction(settings.limits)
    identification = IdentificationTask(
        prediction, Learner(prediction.evaluator, prior, model, runtime.compute)
    )
    loop = HapticLoop(prediction, settings.rendering, settings.limits)
    handle = make_handle(settings.handle, runtime.clock)
    return MasterAxis(daemon.cell, settings, handle, loop, identification, bus, new_id, event_sink, origin)


def make_handle(settings: HandleDriverSettings, clock: Clock) -> Handle:
    """The handle that the settings name, not opened yet; `clock`: of the loop that reads it.

    Raises:
        InputError: a file that the settings name can not be used.
    """
    handle: Handle = driver_of("handle", settings).make(settings, clock)
    return handle
