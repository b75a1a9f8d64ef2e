"""One axis of the master: handle, haptic loop, identification and its traffic. Knows ports only;
`forefeel.master.daemon` composes it.
"""

from collections import Counter
from collections.abc import Callable

from forefeel.common import topics
from forefeel.common.bus import Bus, Publisher
from forefeel.common.causes.motion import NO_COLUMNS, Columns
from forefeel.common.daemon import software_version
from forefeel.common.errors import DeviceError
from forefeel.common.events.console import printable
from forefeel.common.events.sink import HALTED, NULL_EVENT_SINK, EventSink
from forefeel.common.events.text import CONTACT_LOST
from forefeel.common.hardware.driver import driver_of
from forefeel.common.heartbeats import Heartbeats
from forefeel.common.limiter import LimitHit, Reaction
from forefeel.common.messages import (
    MOST_POSITION_M,
    EmergencyStop,
    ForceSample,
    Handshake,
    HapticSample,
    Heartbeat,
    MasterState,
    Message,
    MotionCommand,
    SafetyState,
    SlaveState,
    within,
)
from forefeel.common.settings import differences, settings_hash, shared_text
from forefeel.common.stamp_order import Order, StampOrder
from forefeel.common.topics import Topic
from forefeel.master.events import AxisStatus, MasterEvents
from forefeel.master.handle import Handle, HandleWatch, Indication
from forefeel.master.haptics import HapticInputs, HapticLoop, HapticOutputs, NewestForce
from forefeel.master.prediction import IdentificationTask
from forefeel.master.prior import suspicion
from forefeel.master.samples import bounded, haptic_sample, model_parameters, saturated
from forefeel.master.session import Session, SessionState
from forefeel.master.settings import MasterAxisSettings
from forefeel.master.stop import StopRequest


class MasterAxis:
    """Reads the handle, publishes commands, learns from the late forces and renders the predicted one.
    Threads: `tick` and `_on_force` run in the haptic loop; the other `_on_*` where the transport delivers;
    the rest on asyncio.
    """

    def __init__(  # noqa: PLR0913, PLR0917 - who it is, what it works with, where it is written down
        self,
        cell: str,
        settings: MasterAxisSettings,
        handle: Handle,
        loop: HapticLoop,
        identification: IdentificationTask,
        bus: Bus,
        new_id: Callable[[], int],
        event_sink: EventSink = NULL_EVENT_SINK,
        prior: str = "",
    ) -> None:
        """`prior`: origin of the prior in one line, published and added as a notice; empty where none is."""
        self.name = settings.name
        self.counters: Counter[str] = Counter()
        self.session = Session(new_id)
        self.identification = identification
        self.handle = handle
        self._instance_id = new_id()
        self._shared = shared_text(cell, settings.name, settings.limits)
        self._drivers = {"handle": driver_of("handle", settings.handle).origin}
        self._caveats, self._force_scale = settings.caveats, settings.rendering.force_scale
        self._slave_caveats: tuple[str, ...] = ()
        self._loop = loop
        self._delay_s = settings.handle.actuator_delay_s
        self._bus = bus
        self._heartbeats = Heartbeats(bus.publisher(topics.MASTER_HEARTBEAT))
        self._force: NewestForce | None = None
        self._taken: list[int] = []  # sequences of forces that no haptic sample has named yet
        self._reacts_by: int | None = None  # sequence of the state that the expected setpoint reacts by
        self._full_scale_n = 0.0
        self._stage_position_m: float | None = None
        self._slave_state: SlaveState | None = None
        self._state_received_ns = 0
        self.stop = StopRequest()
        self.events = MasterEvents(bus, event_sink, settings.name)
        self._hand = HandleWatch(handle, self.events.notices, loop.release)
        self._deadman = False
        self.stopping = False
        self._failed = self._pressed = False
        self.faulted = False
        self._prior, self._suspicion, self._judged_fits = printable(prior), "", 0
        if prior:
            self.events.notices.add(f"prior: {prior}")
        self._begin_orders()
        self._connect(bus)

    def _connect(self, bus: Bus) -> None:
        """Creates the publishers of the axis and subscribes to the slave's state, handshake and heartbeat.
        Forces are polled: `_take_forces`, called at each tick, hands those that arrived to `_on_force`.
        """
        self._command: Publisher = bus.publisher(topics.COMMAND)
        self._haptics: Publisher = bus.publisher(topics.HAPTICS)
        self._parameters: Publisher = bus.publisher(topics.PARAMETERS)
        self._state: Publisher = bus.publisher(topics.MASTER_STATE)
        self._handshake: Publisher = bus.publisher(topics.MASTER_HANDSHAKE)
        self._estop: Publisher = bus.publisher(topics.EMERGENCY_STOP)
        self._take_forces = bus.polled(topics.FORCE, self._on_force)
        bus.subscribe(topics.SLAVE_STATE, self._on_state)
        bus.subscribe(topics.SLAVE_HANDSHAKE, self._on_handshake)
        bus.subscribe(topics.SLAVE_HEARTBEAT, self._on_heartbeat)

    def open(self) -> None:
        """Opens the handle and tells the haptic loop its actuator delay: of settings and device the larger.

        Raises:
            DeviceError: the handle does not answer.
        """
        self.handle.open()
        self._loop.late_by(max(self._delay_s, self.handle.actuator_delay_s))

    # --- where the transport delivers ---

    def _on_force(self, sample: ForceSample, receive_ns: int) -> None:
        """Queues a force sample for learning; drops and counts one of another session, beyond full scale or
        stamped ahead. Unless it is older than one before, which is counted, it also sets the stage position
        and becomes the newest force, or, if invalid, marks that as `ended`.
        """
        if sample.session_id != self.session.session_id:
            self.counters["forces_of_another_session"] += sample.session_id != 0
            return
        if not abs(sample.force_n) <= self._full_scale_n:
            self.counters["forces_out_of_range"] += 1
            return
        answered_ns = sample.answers_stamp_ns  # on the master's clock: it can not have stepped
        ahead = answered_ns is not None and (
            answered_ns > receive_ns or self._answers.judge(answered_ns, receive_ns) == "ahead"
        )
        order = "ahead" if ahead else self._judge(self._forces, topics.FORCE, sample, receive_ns)
        if order == "ahead":
            self.counters["forces_ahead"] += 1
            return
        self.identification.queue.put(sample)
        self._taken.append(sample.sequence)
        if order == "older":
            self.counters["forces_reordered"] += 1
            return
        self._stage_position_m = sample.position_m
        if sample.valid:
            clock, transit_ns = self._heartbeats.offset, receive_ns - sample.stamp_ns
            known = clock is not None and clock.ahead_ns(transit_ns) == 0
            late_ns = max(0, clock.excess_ns(transit_ns)) if clock and known else None
            self._force = NewestForce(sample, receive_ns, late_ns)
        elif self._force is not None:
            self._force = self._force._replace(ended=True)

    def _on_state(self, state: SlaveState, receive_ns: int) -> None:
        """Stores a newer state of the slave, notes its session id and passes its reaction times to the
        expected setpoint; a state older or stamped ahead is only counted. Adds a notice where the caveats
        changed; FAULT and ESTOPPED set `faulted`.
        """
        order = self._judge(self._states, topics.SLAVE_STATE, state, receive_ns)
        if order != "newer":
            self.counters[f"states_{order}"] += 1
            return
        self.session.heard_state(state.session_id, receive_ns)
        self._slave_state, self._state_received_ns = state, receive_ns
        if state.caveats != self._slave_caveats:
            self._slave_caveats = state.caveats
            self.events.notices.add(f"slave: {'; '.join(state.caveats) or 'nothing simulated or unsafe'}")
        if state.state in HALTED:
            self.faulted = True
        if len(state.reaction_s) == len(Reaction._fields):
            self._loop.prediction.setpoint.react(Reaction(*state.reaction_s))
            self._reacts_by = state.sequence

    def _begin_orders(self) -> None:
        self._forces, self._answers, self._states = StampOrder(backwards=True), StampOrder(), StampOrder()

    def _judge(self, order: StampOrder, topic: Topic[Message], message: Message, receive_ns: int) -> Order:
        """Order of a message in its stream; a step of the peer's clock is counted, logged and noticed."""
        place = order.judge(message.stamp_ns, receive_ns)
        if order.step_ns:
            self.events.clock_step(topic.name, order.step_ns * 1e-9, receive_ns)
        return place

    def _on_handshake(self, handshake: Handshake, receive_ns: int) -> None:
        """Passes the slave's answer to the session and logs it; an acceptance with other settings than ours
        counts as a refusal. If the session opens: restarts heartbeats and stamp orders, forgets newest force
        and slave state, and takes over the load cell's full scale; what was learned stays.
        """
        before, accepted, reason = self.session.state, handshake.accepted, printable(handshake.reason)
        if accepted and handshake.settings_hash != settings_hash(self._shared):
            accepted, reason = False, f"settings differ: {differences(self._shared, handshake.settings)}"
        self.session.answered(handshake.session_id, accepted, reason, handshake.answers_stamp_ns, receive_ns)
        opened = before is not SessionState.OPEN and self.session.state is SessionState.OPEN
        self.events.session_answered(handshake, opened, None if accepted else reason, receive_ns)
        if opened:
            self._heartbeats.restart()
            self._force = self._slave_state = None
            self._begin_orders()
            self._full_scale_n = handshake.full_scale_n

    def _on_heartbeat(self, heartbeat: Heartbeat, receive_ns: int) -> None:
        if heartbeat.session_id == self.session.session_id:
            self.counters["heartbeats_refused"] += not self._heartbeats.receive(heartbeat, receive_ns)

    # --- the haptic loop ---

    def tick(self, now_ns: int, further: Columns = NO_COLUMNS) -> None:
        """Runs one haptic tick: takes the forces that arrived, shows the slave's state on the handle and
        reads it, predicts and renders the force; in an open session publishes command and haptic sample. The
        handle's button requests an emergency stop. After `fail` the rendered force is 0; while stopping it
        fades out and the deadman counts as released. `further`: expected stage positions of other axes.
        """
        self._take_forces()
        state, stage_position_m, force = self._shown_state(now_ns), self._stage_position_m, self._force
        self.handle.show(Indication(state, stage_position_m))
        reading = self._hand.read(now_ns)
        live_state = None if self.stopping else state  # the force fades before the handle is let go
        snapshot, reacts_by = self.identification.snapshot, self._reacts_by
        in_session = self.session.state is SessionState.OPEN
        inputs = HapticInputs(
            reading, live_state, stage_position_m, force, snapshot, further, in_session, self._released
        )
        outputs = self._loop.tick(now_ns, inputs)
        rendered_n = self._hand.render(0.0 if self._failed else outputs.rendered_n, now_ns)
        self._loop.applied(rendered_n)
        self._take_button(reading.estop, now_ns)
        for hit in outputs.hits:
            self.events.limit(hit)
        self._deadman = outputs.deadman and not self._released
        if in_session:
            self._publish(now_ns, inputs, outputs, rendered_n, reacts_by)
        self._bus.end_batches(now_ns)

    def _take_button(self, estop: bool, now_ns: int) -> None:
        """Requests a stop when the handle's button is pressed, and while it stays in whenever the slave is
        not stopped and no stop is wanted, as after a clearing. Publishes the stop while it is due.
        """
        if estop:
            state = self._newest_state(now_ns)
            stopped = state is not None and state.acknowledges_stop
            if not self._pressed or not (stopped or self.stop.wanted):
                self.emergency_stop("the handle's button", now_ns, "handle")
            self.send_stop(now_ns)  # asyncio may be busy
        self._pressed = estop

    @property
    def _released(self) -> bool:
        """True where the deadman counts as released: stopping, after a fault of the handle, in a stop."""
        return self.stopping or self._hand.fault is not None or self.stop.wanted

    def _status(self, now_ns: int) -> tuple[AxisStatus, str]:
        """Status of the axis and its reason: the first that holds of failed, handle_fault, in_session,
        no_session.
        """
        if self._failed:
            return "failed", "a fault of the master"
        if self._hand.fault is not None:
            return "handle_fault", self._hand.fault
        status: AxisStatus = "in_session" if self.session.state is SessionState.OPEN else "no_session"
        return status, self.session.cause(now_ns)

    def _newest_state(self, now_ns: int) -> SlaveState | None:
        """State of the slave in whatever session; None before any and once it is stale."""
        stale_s = topics.SLAVE_STATE.stale_after_s
        assert stale_s is not None
        return None if now_ns - self._state_received_ns > stale_s * 1e9 else self._slave_state

    def _shown_state(self, now_ns: int) -> SafetyState | None:
        """Safety state of the slave; None before any, once it is stale, or of another session than ours."""
        state = self._newest_state(now_ns)
        return state.state if state is not None and state.session_id == self.session.session_id else None

    def _publish(
        self,
        now_ns: int,
        inputs: HapticInputs,
        outputs: HapticOutputs,
        rendered_n: float,
        reacts_by: int | None,
    ) -> None:
        """Publishes the command and the haptic sample of a tick with the same stamp and number. Clips the
        command's position and band to the range of the messages; the sample names at most 32 of the forces
        in `_taken`, which are removed from it.
        """
        header = self._command.header(self.session.session_id, now_ns)
        low_n, high_n = bounded(outputs.band_n) if outputs.band_n else (None, None)
        self._command.send(
            MotionCommand(
                **header,
                position_m=within(outputs.position_m, MOST_POSITION_M),
                velocity_m_s=outputs.velocity_m_s,
                deadman=self._deadman,
                gripper=outputs.gripper,
                recording_time_s=outputs.recording_time_s,
                low_n=low_n,
                high_n=high_n,
            )
        )
        # at most 32 in a tick (decision 0029); those of a session that opened late follow in the next ticks
        forces, clock = tuple(self._taken[: HapticSample.most_items]), self._heartbeats.offset
        del self._taken[: HapticSample.most_items]
        self._haptics.send(haptic_sample(header, inputs, outputs, rendered_n, clock, forces, reacts_by))

    @property
    def stage_m(self) -> float:
        """Expected position of the stage now; 0 before any is known."""
        return self._loop.stage_m

    # --- on asyncio ---

    def status(self, now_ns: int) -> str:
        """One line: the slave's safety state, or the session's where there is none, and why."""
        state = self._shown_state(now_ns)
        return f"{f'slave {state.value}' if state else self.session.state.value}: {self._reason(now_ns)}"

    def _reason(self, now_ns: int) -> str:
        """The slave's reason for its state; the session's where the slave has no state now."""
        slave = self._slave_state
        if slave is None or self._shown_state(now_ns) is None:
            return self.session.cause(now_ns)
        return printable(slave.reason)

    def serve(self, now_ns: int) -> None:
        """Logs and publishes events, a lost session among them, and sets `faulted` on a handle fault; about
        every 50 ms. Sends a handshake where the session asks for one, unless stopping or the settings differ.
        """
        self.events.check(self._hand.fault, now_ns)
        if self._hand.fault is not None:
            self.faulted = True
        self.events.write(dict(self._bus.malformed), now_ns)
        self._publish_events(now_ns)
        asks = (
            not self.stopping
            and self.session.state is not SessionState.MISMATCH
            and self.session.should_ask(now_ns)
        )
        if self.session.state is not SessionState.OPEN:
            self.events.session_lost(self.session.cause(now_ns), now_ns)
        if not asks:
            return
        self._handshake.send(
            Handshake(
                **self._handshake.header(self.session.session_id, now_ns),
                role="master",
                instance_id=self._instance_id,
                software=f"forefeel {software_version()}",
                settings_hash=settings_hash(self._shared),
                settings=self._shared,
                drivers=self._drivers,
            )
        )

    def flush(self, now_ns: int) -> None:
        """Publishes and logs all that is still gathered; at the end, after the loop."""
        try:
            self._bus.end_batches(now_ns, last=True)
            self._publish_events(now_ns, last=True)
        finally:  # a link that is broken keeps nothing out of the event log
            self.events.write(dict(self._bus.malformed), now_ns, last=True)

    def _publish_events(self, now_ns: int, last: bool = False) -> None:
        session_id = self.session.session_id
        self.events.publish_status(*self._status(now_ns), session_id, now_ns)
        self.events.publish(session_id, now_ns, last)

    def beat(self, now_ns: int) -> None:
        if self.session.state is not SessionState.OPEN:
            return
        self._heartbeats.beat(self.session.session_id, now_ns)

    def identify(self, now_ns: int) -> None:
        """Learns from the queued forces and renews the snapshot that the haptic loop uses; adds a
        CONTACT_LOST event for each contact that gave way and was forgotten. `now_ns` is not used.
        """
        del now_ns
        learner = self.identification.learner
        lost = len(learner.lost_n)
        self.identification.run()
        for foretold_n in learner.lost_n[lost:]:
            self.events.limit(LimitHit(CONTACT_LOST, foretold_n, 0.0, "N"))

    def publish_parameters(self, now_ns: int) -> None:
        """Publishes the contact model. Judges each new fit until forces and prior differ in one, adds a
        notice of that one, and judges no later fit.
        """
        learner = self.identification.learner
        if learner.fits != self._judged_fits and not self._suspicion:
            self._judged_fits = learner.fits
            self._suspicion = suspicion(learner)
            if self._suspicion:
                self.events.notices.add(self._suspicion)
        header = self._parameters.header(self.session.session_id, now_ns)
        self._parameters.send(model_parameters(header, self.identification, self._prior))

    def report(self, now_ns: int) -> None:
        """Publishes `MasterState`: as its indication a handle fault, else the slave's state, else no_session;
        with reason, deadman, clock offset and counters.
        """
        best, state, fault = self._heartbeats.offset, self._shown_state(now_ns), self._hand.fault
        self._state.send(
            MasterState(
                **self._state.header(self.session.session_id, now_ns),
                indication="handle_fault" if fault else state.value if state else "no_session",
                reason=(fault or self._reason(now_ns))[:256],
                deadman=self._deadman,
                clutched_s=self.handle.clutched_out_s,
                force_scale=self._force_scale,
                clock_offset_ns=best.offset_ns if best else None,
                clock_bound_ns=best.bound_ns if best else None,
                counters=saturated(self._count()),
                caveats=self._caveats,
            )
        )

    def emergency_stop(self, reason: str, now_ns: int, by: str = "master") -> None:
        """Requests an emergency stop, logs the request and publishes the stop; `send_stop` repeats it. Until
        the slave's state acknowledges it the deadman counts as released and the first reason stands.
        """
        if self.stop.ask(reason, now_ns):
            self.events.stop_asked(by, reason, now_ns)
        self.send_stop(now_ns)

    @property
    def slave_state(self) -> SlaveState | None:
        return self._slave_state

    def send_stop(self, now_ns: int) -> None:
        """Publishes the requested emergency stop if it is due, see `StopRequest`; called every 20 ms."""
        clock = self._heartbeats.offset if self.session.state is SessionState.OPEN else None
        outward_ns = None if clock is None else clock.outward_ns
        if not self.stop.due(now_ns, self._slave_state, self._state_received_ns, outward_ns):
            return
        header = self._estop.header(self.session.session_id, now_ns)
        self._estop.send(EmergencyStop(**header, source="master", reason=self.stop.reason[:256]))

    def fail(self, error: BaseException) -> None:
        """Stops the axis for good after a fault of any thread: force 0 at once, deadman released from now on.
        Sets `stopping` and `faulted`; counts the fault by its class, and a DeviceError of the handle.
        """
        self.stopping = self._failed = self.faulted = True
        self.counters[f"fault_{type(error).__name__}"] += 1
        try:
            self.handle.render(0.0, 0)
        except DeviceError:
            self.counters["render_failed"] += 1

    def _count(self) -> dict[str, int]:
        """Counters of learning, handle, axis, events and bus in one dict, by name."""
        identification = self.identification
        return {
            "forces_dropped": identification.queue.dropped,
            "forces_unused": identification.unused,
            **{f"handle_{name}": number for name, number in dict(self.handle.counters).items()},
            **self.counters,
            **self.events.counts(),
            **self._bus.counts(),
        }
