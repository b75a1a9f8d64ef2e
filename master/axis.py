"""One axis of the master: handle, haptic loop, identification and its traffic. Knows ports only;
`master.daemon` composes it.
"""

from collections import Counter
from collections.abc import Callable
from typing import TypedDict

from common import topics
from common.bus import Bus, Outlet
from common.errors import DeviceError
from common.estimation.forecast import Estimate
from common.heartbeats import Heartbeats
from common.messages import (
    EmergencyStop,
    ForceSample,
    Handshake,
    HapticSample,
    Heartbeat,
    MasterState,
    ModelParameters,
    MotionCommand,
    SafetyState,
    SlaveState,
)
from common.settings import differences, settings_hash, shared_text
from master.handles.port import Handle, Indication
from master.handles.watch import HandleWatch
from master.haptics import HapticInputs, HapticLoop, HapticOutputs, NewestForce
from master.identification import IdentificationTask
from master.session import Link, Session
from master.settings import MasterAxisSettings
from master.slave_events import SlaveEvents


class MasterAxis:
    """Hand in, commands out; late forces in, felt force out.

    Threads: `_on_*` run where the transport delivers; `tick` in the haptic loop; the rest on asyncio.
    """

    def __init__(
        self,
        cell: str,
        settings: MasterAxisSettings,
        handle: Handle,
        loop: HapticLoop,
        identification: IdentificationTask,
        bus: Bus,
        new_id: Callable[[], int],
    ) -> None:
        self.name = settings.name
        self.counters: Counter[str] = Counter()
        self.session = Session(new_id)
        self.identification = identification
        self.handle = handle
        self._instance_id = new_id()
        self._shared = shared_text(cell, settings.name, settings.limits)
        self._loop = loop
        self._bus = bus
        self._heartbeats = Heartbeats(bus.outlet(topics.MASTER_HEARTBEAT))
        self._force: NewestForce | None = None
        self._force_stamp_ns: int | None = None
        self._stage_position_m: float | None = None
        self._slave_state: SlaveState | None = None
        self._state_heard_ns = 0
        self.events = SlaveEvents(bus)
        self._hand = HandleWatch(handle, self.events.notices, loop.let_go)
        self._deadman = False
        self._identifiable: tuple[str, ...] = ()
        self.stopping = False
        self._failed = False
        self._connect(bus)

    def _connect(self, bus: Bus) -> None:
        self._command: Outlet = bus.outlet(topics.COMMAND)
        self._haptics: Outlet = bus.outlet(topics.HAPTICS)
        self._parameters: Outlet = bus.outlet(topics.PARAMETERS)
        self._state: Outlet = bus.outlet(topics.MASTER_STATE)
        self._handshake: Outlet = bus.outlet(topics.MASTER_HANDSHAKE)
        self._estop: Outlet = bus.outlet(topics.EMERGENCY_STOP)
        bus.subscribe(topics.FORCE, self._on_force)
        bus.subscribe(topics.SLAVE_STATE, self._on_state)
        bus.subscribe(topics.SLAVE_HANDSHAKE, self._on_handshake)
        bus.subscribe(topics.SLAVE_HEARTBEAT, self._on_heartbeat)

    # --- where the transport delivers ---

    def _on_force(self, sample: ForceSample, receive_ns: int) -> None:
        if sample.session_id != self.session.session_id:
            self.counters["forces_of_another_session"] += sample.session_id != 0
            return
        self.identification.queue.put(sample)
        if self._force_stamp_ns is not None and sample.stamp_ns <= self._force_stamp_ns:
            self.counters["forces_reordered"] += 1
            return
        self._force_stamp_ns = sample.stamp_ns
        self._stage_position_m = sample.position_m
        if sample.valid:
            self._force = NewestForce(sample, receive_ns)

    def _on_state(self, state: SlaveState, receive_ns: int) -> None:
        self.session.heard_state(state.session_id, receive_ns)
        if self._slave_state is None or state.stamp_ns > self._slave_state.stamp_ns or state.sequence == 1:
            self._slave_state, self._state_heard_ns = state, receive_ns

    def _on_handshake(self, handshake: Handshake, receive_ns: int) -> None:
        before, accepted, reason = self.session.link, handshake.accepted, handshake.reason
        if accepted and handshake.settings_hash != settings_hash(self._shared):
            accepted, reason = False, f"settings differ: {differences(self._shared, handshake.settings)}"
        self.session.answered(handshake.session_id, accepted, reason, receive_ns)
        if before is not Link.OPEN and self.session.link is Link.OPEN:
            self._heartbeats.restart()
            self._force = self._force_stamp_ns = self._slave_state = None

    def _on_heartbeat(self, heartbeat: Heartbeat, receive_ns: int) -> None:
        if heartbeat.session_id == self.session.session_id:
            self._heartbeats.heard(heartbeat, receive_ns)

    # --- the haptic loop ---

    def tick(self, now_ns: int) -> None:
        """One haptic tick: read, command, predict, render."""
        state, stage_position_m, force = self._shown_state(now_ns), self._stage_position_m, self._force
        self.handle.show(Indication(state, stage_position_m))
        reading = self._hand.read(now_ns)
        live_state = None if self.stopping else state  # the force fades before the handle is let go
        outputs = self._loop.tick(
            now_ns, HapticInputs(reading, live_state, stage_position_m, force, self.identification.estimate)
        )
        rendered_n = self._hand.render(0.0 if self._failed else outputs.rendered_n, now_ns)
        self._deadman = outputs.deadman and not self.stopping and self._hand.fault is None
        if self.session.link is Link.OPEN:
            self._publish(now_ns, outputs._replace(rendered_n=rendered_n), reading.position_m, force)

    def _shown_state(self, now_ns: int) -> SafetyState | None:
        """The slave's state; None without a session or when the slave has been silent."""
        state, stale_s = self._slave_state, topics.SLAVE_STATE.stale_after_s
        assert stale_s is not None
        silent = now_ns - self._state_heard_ns > stale_s * 1e9
        if state is None or silent or state.session_id != self.session.session_id:
            return None
        return state.state

    def _publish(
        self, now_ns: int, outputs: HapticOutputs, handle_m: float, force: NewestForce | None
    ) -> None:
        header = self._command.header(self.session.session_id, now_ns)
        self._command.send(
            MotionCommand(
                **header,
                position_m=outputs.position_m,
                velocity_m_s=outputs.velocity_m_s,
                deadman=self._deadman,
                gripper=outputs.gripper,
                recording_time_s=outputs.recording_time_s,
            )
        )
        age_s, delay_s = self._ages(now_ns, force)
        self._haptics.send(
            HapticSample(
                **header,
                handle_position_m=handle_m,
                command_position_m=outputs.position_m,
                **_forecast(outputs.predicted),
                held_n=outputs.held_n,
                rendered_n=outputs.rendered_n,
                force_age_s=age_s,
                delay_s=delay_s,
                answered_sequence=force.sample.answers_sequence if force else None,
                limited=outputs.limited,
                energy_j=outputs.energy_j,
            )
        )

    def _ages(self, now_ns: int, force: NewestForce | None) -> tuple[float | None, float | None]:
        """Age of the newest force on the master's clock, and round trip of the command that it answers."""
        if force is None:
            return None, None
        sample, best = force.sample, self._heartbeats.offset
        age_s = None if best is None else (now_ns - sample.stamp_ns + best.offset_ns) * 1e-9
        sent_ns = sample.answers_stamp_ns
        return age_s, None if sent_ns is None else (force.arrived_ns - sent_ns) * 1e-9

    # --- on asyncio ---

    def serve(self, now_ns: int) -> None:
        """Asks for a session when there is none; about every 50 ms."""
        if self.session.link is Link.MISMATCH or self.stopping or not self.session.should_ask(now_ns):
            return
        self._handshake.send(
            Handshake(
                **self._handshake.header(self.session.session_id, now_ns),
                role="master",
                instance_id=self._instance_id,
                software="forefeel",
                settings_hash=settings_hash(self._shared),
                settings=self._shared,
            )
        )

    def beat(self, now_ns: int) -> None:
        """Heartbeat with the four stamps, about 20 Hz."""
        if self.session.link is not Link.OPEN:
            return
        self._heartbeats.beat(self.session.session_id, now_ns)

    def identify(self, now_ns: int) -> None:
        """Learns from the forces that arrived; about every 5 ms."""
        del now_ns
        self.identification.run()

    def describe(self, now_ns: int) -> None:
        """Works out what is identifiable, about 1 Hz."""
        del now_ns
        self._identifiable = self.identification.identifiable()

    def publish_parameters(self, now_ns: int) -> None:
        """Gives the loop the contact model as it is known now, and publishes it; about 20 Hz."""
        self.identification.update_estimate()
        estimate = self.identification.estimate
        assert estimate is not None
        self._parameters.send(
            ModelParameters(
                **self._parameters.header(self.session.session_id, now_ns),
                names=estimate.names,
                values=estimate.values,
                standard_deviations=estimate.standard_deviations,
                identifiable=self._identifiable,
                valid=estimate.valid,
                samples=estimate.samples,
                updates=estimate.updates,
                resets=estimate.resets,
                innovation_rms_n=estimate.innovation_rms_n,
            )
        )

    def report(self, now_ns: int) -> None:
        """The axis' state, about 10 Hz."""
        best, state, fault = self._heartbeats.offset, self._shown_state(now_ns), self._hand.fault
        self._state.send(
            MasterState(
                **self._state.header(self.session.session_id, now_ns),
                indication="handle_fault" if fault else state.value if state else "no_link",
                reason=(fault or self.session.reason)[:256],
                deadman=self._deadman,
                clutched_s=self.handle.clutched_out_s,
                clock_offset_ns=best.offset_ns if best else None,
                clock_bound_ns=best.bound_ns if best else None,
                counters=self._count(),
            )
        )

    def emergency_stop(self, reason: str, now_ns: int) -> None:
        """Tells the slave to stop; repeat it until the state shows it."""
        header = self._estop.header(self.session.session_id, now_ns)
        self._estop.send(EmergencyStop(**header, source="master", reason=reason[:256]))

    def fail(self, error: BaseException) -> None:
        """A fault of any thread: no force on the hand, no deadman; the slave's watchdog does the rest."""
        self.stopping = self._failed = True
        self.counters[f"fault_{type(error).__name__}"] += 1
        try:
            self.handle.render(0.0, 0)
        except DeviceError:
            self.counters["render_failed"] += 1

    def _count(self) -> dict[str, int]:
        identification = self.identification
        return {
            "forces_dropped": identification.queue.dropped,
            "forces_unused": identification.unused,
            **{f"handle_{name}": number for name, number in dict(self.handle.counters).items()},
            **self.counters,
            **self.events.counters,
            **self._bus.counts(),
        }


class _Forecast(TypedDict):
    """The fields of a HapticSample that say what was predicted."""

    predicted_n: float | None
    low_n: float | None
    high_n: float | None
    leading: str


_NOTHING: _Forecast = {"predicted_n": None, "low_n": None, "high_n": None, "leading": ""}


def _forecast(predicted: Estimate | None) -> _Forecast:
    if predicted is None:
        return _NOTHING
    force_n, low_n, high_n, leading = predicted
    return {"predicted_n": force_n, "low_n": low_n, "high_n": high_n, "leading": leading}
