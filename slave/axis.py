"""One axis of the slave: devices, gate, control loop and its traffic.

Knows ports only; `forefeel.slave.daemon` composes it.
"""

from collections import Counter
from collections.abc import Iterable
from math import inf

from forefeel.common import topics
from forefeel.common.bus import Bus, Publisher
from forefeel.common.errors import DeviceError
from forefeel.common.events.sink import HALTED, NULL_EVENT_SINK, EventSink
from forefeel.common.events.text import DECLARES, obstacle
from forefeel.common.limiter import LimitHit
from forefeel.common.messages import (
    EmergencyStop,
    Grip,
    MotionCommand,
    SafetyState,
    SlaveState,
)
from forefeel.common.slots import LatestValue
from forefeel.slave.command_receiver import CommandReceiver
from forefeel.slave.control import AxisControl, ControlInputs, ControlOutputs, Transition
from forefeel.slave.devices import DeviceReports, Devices, DeviceWatch, ShapePublisher
from forefeel.slave.events import SlaveEvents
from forefeel.slave.following import following_watch
from forefeel.slave.forces import ForcePublisher, Instant, PolarityWatch, PushWatch
from forefeel.slave.instrument import InstrumentWatch
from forefeel.slave.session import SlaveSession
from forefeel.slave.settings import SlaveAxisSettings

_LATCHED = "latched before the slave was started: "
_EXACT_M = 1e-9  # a drive that applies a setpoint to the nanometre did not change it


class SlaveAxis:
    """Takes commands, moves stage and gripper within gate and limits, publishes forces and state. Threads:
    `tick` runs in the control loop; `_on_*` where the transport delivers; the rest on asyncio.
    """

    def __init__(
        self,
        cell: str,
        settings: SlaveAxisSettings,
        devices: Devices,
        bus: Bus,
        instance_id: int,
        event_sink: EventSink = NULL_EVENT_SINK,
    ) -> None:
        self.name = settings.name
        self.settings = settings
        self.counters: Counter[str] = Counter()
        self.events = SlaveEvents(bus, event_sink, cell, settings.name)
        self.shutdown = False
        self._devices = devices
        self._event_sink = event_sink
        self._watch = DeviceWatch(devices, following_watch(settings), self._device_failed)
        self._pushes = PushWatch(settings.limits.max_force_n if settings.pushes_only else inf)
        recorded = settings.gate.force_timeout_s is None  # in which sense, nobody knows
        self._polarity = PolarityWatch(
            inf if recorded else settings.limits.max_force_n, settings.sign_setting
        )
        self._instrument = InstrumentWatch(settings.instrument)
        self._device_reports = DeviceReports(devices.stage, devices.load_cell, bus)
        self._session = SlaveSession(cell, settings, devices, bus, instance_id, self.events)
        self._receiver = CommandReceiver(settings, self._session, self.events)
        self._estop: LatestValue[str] = LatestValue()
        self._fault: LatestValue[str] = LatestValue()
        self._clear: LatestValue[bool] = LatestValue()
        self._executing: MotionCommand | None = None
        self._behind_ns = 0
        self._grip = Grip.CLOSED
        self._lost_reason = ""
        self._control: AxisControl | None = None
        self._bus = bus
        self._connect(bus)

    def _connect(self, bus: Bus) -> None:
        """Creates publishers and subscribes to emergency stops. Commands are polled: `_take_commands`, called
        at each tick, hands those that arrived to the command receiver.
        """
        self._forces = ForcePublisher(bus.publisher(topics.FORCE))
        self._state: Publisher = bus.publisher(topics.SLAVE_STATE)
        shape_m = self._devices.shape_m
        self._shape = None if shape_m is None else ShapePublisher(shape_m, bus.publisher(topics.SHAPE))
        self._take_commands = bus.polled(topics.COMMAND, self._receiver.on_command)
        bus.subscribe(topics.EMERGENCY_STOP, self._on_estop, self._on_garbled_estop)

    # --- where the transport delivers ---

    def _on_estop(self, stop: EmergencyStop, receive_ns: int) -> None:
        del receive_ns
        self.events.stop_asked(stop.source, stop.reason)
        self._estop.put(f"{stop.source}: {stop.reason}")

    def _on_garbled_estop(self) -> None:
        """Latches a stop: whoever sent this meant one."""
        self.emergency_stop("an emergency stop that can not be read", "unknown")

    # --- from anyone ---

    def emergency_stop(self, reason: str, by: str = "slave") -> None:
        """Logs an emergency stop and has the next tick latch it; one that is latched already stays."""
        self.events.stop_asked(by, reason)
        self._estop.put(reason or "emergency stop")

    def clear(self) -> None:
        """Has the next tick clear a latched stop or fault; only ever called by a local act at the slave. A
        stop or fault that waits for that tick is latched after the clearing.
        """
        self._clear.put(True)

    def fail(self, error: BaseException) -> None:
        """Holds the stage at once after a fault of any thread, and has the next tick enter FAULT, or `settle`
        when the control loop has ended. A DeviceError of the stage is counted, not raised.
        """
        self._fault.put(f"{type(error).__name__}: {error}"[:200])
        try:
            self._devices.stage.hold(0)
        except DeviceError:
            self.counters["hold_failed"] += 1

    @property
    def at_rest(self) -> bool:
        return self._control is None or self._control.at_rest

    @property
    def state(self) -> SafetyState:
        return SafetyState.IDLE if self._control is None else self._control.machine.state

    @property
    def reason(self) -> str:
        """Reason for the safety state; in READY what prevents arming, else, before the first arming, a note
        that it declares the instrument out of contact; in IDLE why a session without any heartbeat ended.
        """
        if self._control is None:
            return "not open"
        machine = self._control.machine
        if machine.state is SafetyState.READY:
            hit = self._control.obstacle(self._session.offset)
            return obstacle(*hit[:3]) if hit else machine.reason if self._control.zeroed else DECLARES
        return (machine.state is SafetyState.IDLE and self._lost_reason) or machine.reason

    @property
    def halted(self) -> bool:
        return self.state in HALTED

    def session(self, now_ns: int) -> int:
        """The session that holds the lease, or 0."""
        return self._session.holder if self._session.live(now_ns) else 0

    @property
    def latch_persisted(self) -> bool:
        """True when a new start would find the axis latched, or not, as it is now."""
        return self._event_sink.is_persisted(self.name, self.state is SafetyState.ESTOPPED)

    def _device_failed(self, device: str, reason: str) -> None:
        self.events.device_fault(device, reason)
        self._fault.put(reason)

    def status(self, now_ns: int) -> str:
        del now_ns
        return "not open" if self._control is None else f"{self.state.value} ({self.reason})"

    # --- the control loop ---

    def open(self, now_ns: int) -> None:
        """Opens the devices and creates the control with its setpoint at the stage's position. A stop or
        fault that was latched before the start is latched again at once, as an emergency stop.

        Raises:
            DeviceError: a device does not answer, or the stage does not say where it is.
        """
        self._watch.open(now_ns)
        self._control = AxisControl(
            self.settings.limits, self.settings.gate, self.settings.reaction(), self._watch.stage.position_m
        )
        latched = self._event_sink.latched.get(self.name, self._event_sink.latched.get(""))
        if latched is not None:
            self._estop.put(f"{_LATCHED}{latched.removeprefix(_LATCHED)}")
            self.settle(now_ns)  # before anyone can ask what is latched

    def close(self) -> None:
        self._watch.close()

    def tick(self, now_ns: int) -> None:
        """Runs one control tick: takes the commands, re-arms the devices if a clearing is asked for, reads
        them, checks the load cell's sign, steps the control, moves stage and gripper; publishes forces and
        reports the events. AssertionError before `open`.
        """
        assert self._control is not None, "open() comes first"
        self._take_commands()
        cleared = self._clear.take() is not None
        if cleared:
            self._watch.rearm()
        readings = self._watch.read(now_ns, self._executing.recording_time_s if self._executing else None)
        stage, force_n = self._watch.stage, self._watch.force.force_n
        follows = self._executing is not None
        sensed = stage, force_n, self._watch.force.valid, follows
        if wrong := self._pushes.fault(now_ns, *sensed) or self._polarity.fault(now_ns, *sensed, self._grip):
            self._device_failed("load_cell", wrong)
        setpoint = self._control.limiter.position_m, self._control.limiter.force_limited
        outputs = self._control.tick(now_ns, self._inputs(now_ns, cleared))
        self._report_transitions(now_ns, outputs.transitions)  # first: a stop is latched whatever fails below
        holder = self._session.holder
        followed = self._executing, self._behind_ns
        self._forces.note(Instant(now_ns, self._watch.stage, *followed, self._grip, *setpoint))
        for reading in readings:
            self._forces.send(reading, holder, self._session.offset)
        self._executing, self._behind_ns = outputs.executing, outputs.behind_ns
        self._apply(outputs, now_ns)
        self.events.cycle(now_ns, outputs, self._watch, self._grip, self._control.machine.state, holder)
        held = self._grip is Grip.CLOSED and follows
        warned = self._instrument.take(now_ns, stage, force_n, self._watch.force.valid, held)
        for hit in (*outputs.limits, *warned):
            self.events.limit(hit)
        if self._shape is not None:
            self._shape.tick(now_ns, holder)
        self._bus.end_batches(now_ns)

    def settle(self, now_ns: int) -> None:
        """Latches the stop and the fault that wait for a tick, without one; reports the transitions."""
        assert self._control is not None, "open() comes first"
        self._report_transitions(now_ns, self._control.halt(now_ns, self._estop.take(), self._fault.take()))

    def _report_transitions(self, now_ns: int, transitions: Iterable[Transition]) -> None:
        for transition in transitions:
            self.events.transition(transition, self._session.holder, now_ns)

    def _inputs(self, now_ns: int, cleared: bool) -> ControlInputs:
        """Collects the inputs of a control tick; empties the slots of command, emergency stop and fault. Two
        writers count as no live session; a failing event log and a master's clock that runs wrong as a
        fault. `cleared`: a clearing was asked for.
        """
        command, released = self._receiver.slot.take()
        conflict = self._receiver.conflict
        live = conflict is None and self._session.live(now_ns)
        if (stop := self._estop.take()) is not None:
            self.events.stop_taken(stop, self.state is SafetyState.ESTOPPED, now_ns)
        return ControlInputs(
            command=command,
            released=released,
            position_m=self._watch.stage.position_m,
            force_n=self._watch.force.force_n,
            force_valid=self._watch.force.valid,
            force_age_s=self._watch.force_age_s(now_ns),
            session_live=live,
            lost_reason="" if live else conflict or self._session.lost_reason,
            clock=self._session.offset,
            estop=stop,
            fault=self._fault.take() or self._event_sink.problem or self._session.clock_fault(now_ns),
            shutdown=self.shutdown,
            clear=cleared,
            stage_rests=self._watch.following.at_rest,
            strayed=self._watch.following.strayed,
            stage_reaction_s=self._watch.following.reaction_s,
        )

    def _apply(self, outputs: ControlOutputs, now_ns: int) -> None:
        """Commands or holds the stage and sets the gripper; a DeviceError becomes a fault of the axis, and
        one of the stage leaves the gripper alone. Reports a limit where the drive's travel cut the target.
        """
        try:
            if outputs.moving:
                asked_m = outputs.target_m
                applied_m = self._devices.stage.command(asked_m, outputs.velocity_m_s, now_ns)
                self._watch.following.command(applied_m, outputs.velocity_m_s, now_ns)
                if abs(applied_m - asked_m) > _EXACT_M:
                    self.events.limit(LimitHit("travel", asked_m, applied_m, "m"))
            else:
                self._watch.following.hold()
                self._devices.stage.hold(now_ns)
        except DeviceError as error:
            self._device_failed("stage", str(error))
            return
        try:
            self._grip = self._devices.gripper.set(outputs.grip, now_ns)
        except DeviceError as error:
            self._device_failed("gripper", str(error))

    # --- on asyncio ---

    def serve(self, now_ns: int, last: bool = False) -> None:
        """Answers handshakes, releases the session where the command receiver says so, then publishes and
        logs events, those even where publishing raises; every 10 ms. Adds a notice for a session that ended
        without any heartbeat. `last`: all events that are gathered, else those that are due.
        """
        try:
            if lost := self._session.ended_unrenewed(now_ns):
                self._lost_reason = lost
                self.events.notices.add(f"session lost: {lost}")
            self._session.serve(now_ns, self.at_rest, self._opened)
            reason = self._receiver.should_drop_session(now_ns, self.at_rest)
            if reason is not None:
                self._session.release(now_ns, reason)
            self.events.publish(self._session.holder, now_ns, last)
            if last:
                self._bus.end_batches(now_ns, last)
        finally:  # what can not be published is written down all the same
            if not self._session.live(now_ns):
                self.events.session_lost(self._session.lost_reason, now_ns)
            self.events.write(dict(self._bus.malformed), now_ns, last)

    def _opened(self, session_id: int) -> None:
        self._receiver.open(session_id)
        self._lost_reason = ""
        declares = "" if self._control and self._control.zeroed else f": {DECLARES}"
        self.events.notices.add(f"session open{declares}")

    def beat(self, now_ns: int) -> None:
        self._session.beat(now_ns)

    def announce(self, now_ns: int) -> None:
        self._device_reports.publish_calibrations(self._session.holder, now_ns)

    def report(self, now_ns: int) -> None:
        """Publishes `SlaveState`: safety state with reason, readback, grip, clock offset and counters; the
        session is 0 where none is live.
        """
        assert self._control is not None
        best, holder = self._session.offset, self.session(now_ns)
        self._state.send(
            SlaveState(
                **self._state.header(holder, now_ns),
                state=self.state,
                reason=self.reason[:256],
                latch_persisted=self.latch_persisted,
                position_m=self._watch.stage.position_m,
                velocity_m_s=self._watch.stage.velocity_m_s,
                gripper=self._control.grip,
                stops=self._control.stops,
                clock_offset_ns=best.offset_ns if best else None,
                clock_bound_ns=best.bound_ns if best else None,
                over_limit=self._control.over_limit,
                slipped_m=self._instrument.slipped_m,
                slipped_since_ns=self._instrument.since_ns,
                near_load=self._instrument.near_load,
                reaction_s=self._control.limiter.reaction,
                counters=self._count(),
                caveats=self.settings.caveats,
            )
        )

    def _count(self) -> dict[str, int]:
        """Counters of commands, events, devices, session and bus in one dict, by name."""
        return {
            "commands_superseded": self._receiver.slot.superseded,
            **self.events.counts(),
            **self._device_reports.counts(),
            **self.counters,
            **self._receiver.counters,
            **self._session.counters,
            **self._bus.counts(),
        }
