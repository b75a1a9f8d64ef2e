"""One axis of the slave: devices, gate, control loop and its traffic. Knows ports only; `slave.daemon`
composes it.
"""

from collections import Counter
from dataclasses import dataclass
from math import isfinite

from common import topics
from common.bus import Bus, Outlet
from common.clock_offset import ClockOffset
from common.errors import DeviceError
from common.messages import (
    EmergencyStop,
    ForceSample,
    Handshake,
    Heartbeat,
    LimitEvent,
    MotionCommand,
    SafetyEvent,
    SafetyState,
    SlaveState,
)
from common.settings import differences, settings_hash, shared_text
from common.slots import BoundedQueue, LatestValue
from slave.control import AxisControl, ControlInputs, ControlOutputs, Transition
from slave.gate import CommandGate, GateLimits, Refusal
from slave.grippers.port import Gripper
from slave.limit_log import LimitLog
from slave.limiter import LimitHit
from slave.load_cells.port import LoadCell, LoadCellReading
from slave.session import Lease
from slave.settings import SlaveAxisSettings
from slave.stages.port import Stage, StageReading

_RANGE_MARGIN_M = 0.05  # beyond the workspace by this much a position is nonsense, not merely too far
_RANGE_SPEEDS = 10.0
_HALTED = frozenset({SafetyState.FAULT, SafetyState.ESTOPPED})
_NO_FORCE = LoadCellReading(0.0, 0, False)
_EXACT_M = 1e-9  # a drive that applies a setpoint to the nanometre did not change it


@dataclass(frozen=True, slots=True)
class Devices:
    """The three ports of one axis."""

    stage: Stage
    gripper: Gripper
    load_cell: LoadCell


class SlaveAxis:
    """Commands in, motion and forces out.

    Threads: `_on_*` run where the transport delivers; `tick` in the control loop; the rest on asyncio.
    """

    def __init__(
        self, cell: str, settings: SlaveAxisSettings, devices: Devices, bus: Bus, instance_id: int
    ) -> None:
        self.name = settings.name
        self.settings = settings
        self.counters: Counter[str] = Counter()
        self.shutdown = False
        self._devices = devices
        self._instance_id = instance_id
        self._shared = shared_text(cell, settings.name, settings.limits)
        self._gate = CommandGate(_gate_limits(settings))
        self._lease = Lease(int(settings.gate.lease_s * 1e9))
        self._clock = ClockOffset()
        self._slot: LatestValue[tuple[MotionCommand, int]] = LatestValue()
        self._handshakes: BoundedQueue[tuple[Handshake, int]] = BoundedQueue(16)
        self._transitions: BoundedQueue[tuple[int, Transition]] = BoundedQueue(256)
        self._limits = LimitLog()
        self._peer_heartbeat: tuple[int, int] | None = None
        self._estop: str | None = None
        self._fault: str | None = None
        self._clear = False
        self._stage_reading = StageReading(0.0, 0.0)
        self._executing: MotionCommand | None = None
        self._control: AxisControl | None = None
        self._bus = bus
        self._connect(bus)

    def _connect(self, bus: Bus) -> None:
        self._force: Outlet = bus.outlet(topics.FORCE)
        self._state: Outlet = bus.outlet(topics.SLAVE_STATE)
        self._handshake: Outlet = bus.outlet(topics.SLAVE_HANDSHAKE)
        self._heartbeat: Outlet = bus.outlet(topics.SLAVE_HEARTBEAT)
        self._limit_event: Outlet = bus.outlet(topics.LIMIT_EVENT)
        self._safety_event: Outlet = bus.outlet(topics.SAFETY_EVENT)
        bus.subscribe(topics.COMMAND, self._on_command)
        bus.subscribe(topics.MASTER_HANDSHAKE, self._on_handshake)
        bus.subscribe(topics.MASTER_HEARTBEAT, self._on_heartbeat)
        bus.subscribe(topics.EMERGENCY_STOP, self._on_estop)

    # --- where the transport delivers ---

    def _on_command(self, command: MotionCommand, receive_ns: int) -> None:
        refusal = self._gate.admit(command, receive_ns, self._clock.best)
        if refusal is None:
            self._slot.put((command, receive_ns))
        else:
            self._count_refusal(refusal)

    def _count_refusal(self, refusal: Refusal) -> None:
        self.counters[f"refused_{refusal.rule}"] += 1
        self._limits.add(LimitHit(refusal.rule, refusal.requested, refusal.limit, refusal.unit))

    def _on_handshake(self, handshake: Handshake, receive_ns: int) -> None:
        self._handshakes.put((handshake, receive_ns))

    def _on_heartbeat(self, heartbeat: Heartbeat, receive_ns: int) -> None:
        if not self._lease.renew(heartbeat.session_id, receive_ns):
            return
        self._peer_heartbeat = heartbeat.stamp_ns, receive_ns
        if heartbeat.echo_stamp_ns is not None and heartbeat.echo_receive_ns is not None:
            self._clock.update(
                heartbeat.echo_stamp_ns, heartbeat.echo_receive_ns, heartbeat.stamp_ns, receive_ns
            )

    def _on_estop(self, stop: EmergencyStop, receive_ns: int) -> None:
        del receive_ns
        self.emergency_stop(f"{stop.source}: {stop.reason}")

    # --- from anyone ---

    def emergency_stop(self, reason: str) -> None:
        """Latches the stop; idempotent, heeded at the next tick whatever else waits."""
        self._estop = reason or "emergency stop"

    def clear(self) -> None:
        """Clears a latched stop or fault; only ever called by a local act at the slave.

        One that the control loop has not heeded yet is none to clear: it stays.
        """
        if self.halted:
            self._estop, self._fault, self._clear = None, None, True

    def fail(self, error: BaseException) -> None:
        """A fault of any thread: the machine goes to FAULT at the next tick and the stage is told to hold at
        once.
        """
        self._fault = f"{type(error).__name__}: {error}"[:200]
        try:
            self._devices.stage.hold(0)
        except DeviceError:
            self.counters["hold_failed"] += 1

    @property
    def at_rest(self) -> bool:
        """Whether nothing moves."""
        return self._control is None or self._control.at_rest

    @property
    def halted(self) -> bool:
        """Whether an emergency stop or a fault is latched."""
        return self._control is not None and self._control.machine.state in _HALTED

    # --- the control loop ---

    def open(self, now_ns: int) -> None:
        """Opens the devices and takes the stage's position as the setpoint.

        Raises:
            DeviceError: a device does not answer, or the stage does not say where it is.
        """
        for device in (self._devices.stage, self._devices.gripper, self._devices.load_cell):
            device.open()
        self._read_stage(now_ns)
        self._control = AxisControl(self.settings.limits, self.settings.gate, self._stage_reading.position_m)

    def close(self) -> None:
        """Closes the devices."""
        for device in (self._devices.load_cell, self._devices.gripper, self._devices.stage):
            device.close()

    def tick(self, now_ns: int) -> None:
        """One control tick: read, decide, move, answer."""
        assert self._control is not None, "open() comes first"
        force = self._read(now_ns)
        outputs = self._control.tick(now_ns, self._inputs(now_ns, force))
        self._answer(now_ns, force)
        self._executing = outputs.executing
        self._apply(outputs, now_ns)
        for transition in outputs.transitions:
            self._transitions.put((now_ns, transition))
        for hit in outputs.limits:
            self._limits.add(hit)

    def _read(self, now_ns: int) -> LoadCellReading:
        recording_time_s = self._executing.recording_time_s if self._executing else None
        try:
            self._read_stage(now_ns)
            force = self._devices.load_cell.read(now_ns, recording_time_s)
            if not isfinite(force.force_n):
                raise DeviceError(f"load cell = {force.force_n} N: expected a finite force")
        except DeviceError as error:
            self._fault = str(error)
            return _NO_FORCE
        return force

    def _read_stage(self, now_ns: int) -> None:
        reading = self._devices.stage.read(now_ns)
        if not (isfinite(reading.position_m) and isfinite(reading.velocity_m_s)):
            raise DeviceError(
                f"stage = ({reading.position_m} m, {reading.velocity_m_s} m/s): expected finite numbers"
            )
        self._stage_reading = reading

    def _inputs(self, now_ns: int, force: LoadCellReading) -> ControlInputs:
        clear, self._clear = self._clear, False
        return ControlInputs(
            command=self._slot.take(),
            position_m=self._stage_reading.position_m,
            force_n=force.force_n,
            force_valid=force.valid,
            session_live=self._lease.live(now_ns),
            clock=self._clock.best,
            estop=self._estop,
            fault=self._fault,
            shutdown=self.shutdown,
            clear=clear,
        )

    def _apply(self, outputs: ControlOutputs, now_ns: int) -> None:
        try:
            if outputs.moving:
                asked_m = outputs.target_m
                applied_m = self._devices.stage.command(asked_m, outputs.velocity_m_s, now_ns)
                if abs(applied_m - asked_m) > _EXACT_M:
                    self._limits.add(LimitHit("travel", asked_m, applied_m, "m"))
            else:
                self._devices.stage.hold(now_ns)
            self._devices.gripper.set(outputs.grip, now_ns)
        except DeviceError as error:
            self._fault = str(error)

    def _answer(self, now_ns: int, force: LoadCellReading) -> None:
        """The force belongs to the command that the stage executed until now."""
        executing, best = self._executing, self._clock.best
        self._force.send(
            ForceSample(
                **self._force.header(self._lease.holder, now_ns),
                position_m=self._stage_reading.position_m,
                velocity_m_s=self._stage_reading.velocity_m_s,
                force_n=force.force_n,
                raw_counts=force.raw_counts,
                valid=force.valid,
                answers_sequence=executing.sequence if executing else None,
                answers_stamp_ns=executing.stamp_ns if executing else None,
                recording_time_s=executing.recording_time_s if executing else None,
                clock_offset_ns=best.offset_ns if best else None,
                clock_bound_ns=best.bound_ns if best else None,
            )
        )

    # --- on asyncio ---

    def serve(self, now_ns: int) -> None:
        """Answers handshakes and publishes what happened; about every 10 ms."""
        for handshake, receive_ns in self._handshakes.drain():
            self._open_session(handshake, receive_ns, now_ns)
        for stamp_ns, (before, event, after, reason) in self._transitions.drain():
            header = self._safety_event.header(self._lease.holder, stamp_ns)
            self._safety_event.send(
                SafetyEvent(**header, before=before, event=event.value, after=after, reason=reason[:256])
            )
        for hit, count in self._limits.due(now_ns):
            header = self._limit_event.header(self._lease.holder, now_ns)
            self._limit_event.send(
                LimitEvent(
                    **header,
                    rule=hit.rule,
                    requested=hit.requested,
                    applied=hit.applied,
                    unit=hit.unit,
                    count=count,
                )
            )

    def _open_session(self, handshake: Handshake, receive_ns: int, now_ns: int) -> None:
        reason = self._refuse(handshake)
        known = handshake.session_id == self._lease.holder
        if not reason:
            reason = self._lease.request(handshake.session_id, receive_ns, self.at_rest) or ""
        if not reason and not known:
            self._clock = ClockOffset()  # a new one: an exchange of the old session may be under way
            self._peer_heartbeat = None
            self._gate.open(handshake.session_id)
        self.counters["handshakes_refused" if reason else "handshakes_accepted"] += 1
        self._handshake.send(
            Handshake(
                **self._handshake.header(handshake.session_id, now_ns),
                role="slave",
                instance_id=self._instance_id,
                software="forefeel",
                settings_hash=settings_hash(self._shared),
                settings=self._shared,
                accepted=not reason,
                reason=reason,
            )
        )

    def _refuse(self, handshake: Handshake) -> str:
        if handshake.role != "master":
            return "only a master may open a session"
        if handshake.settings_hash != settings_hash(self._shared):
            return f"settings differ: {differences(self._shared, handshake.settings)}"
        return ""

    def beat(self, now_ns: int) -> None:
        """Heartbeat with the four stamps, about 20 Hz; none without a session."""
        if not self._lease.live(now_ns):
            return
        echo = self._peer_heartbeat
        header = self._heartbeat.header(self._lease.holder, now_ns)
        self._heartbeat.send(
            Heartbeat(
                **header, echo_stamp_ns=echo[0] if echo else None, echo_receive_ns=echo[1] if echo else None
            )
        )

    def report(self, now_ns: int) -> None:
        """The axis' state, about 50 Hz."""
        assert self._control is not None
        machine, best = self._control.machine, self._clock.best
        holder = self._lease.holder if self._lease.live(now_ns) else 0
        self._state.send(
            SlaveState(
                **self._state.header(holder, now_ns),
                state=machine.state,
                reason=machine.reason[:256],
                position_m=self._stage_reading.position_m,
                velocity_m_s=self._stage_reading.velocity_m_s,
                gripper=self._control.grip,
                stops=self._control.stops,
                clock_offset_ns=best.offset_ns if best else None,
                clock_bound_ns=best.bound_ns if best else None,
                counters=self._count(),
            )
        )

    def _count(self) -> dict[str, int]:
        counted = list(self._bus.malformed.items())  # at once: the transport's threads go on counting
        malformed = {f"malformed_{name.replace('/', '_')}": n for name, n in counted}
        return {
            "commands_superseded": self._slot.superseded,
            "events_dropped": self._transitions.dropped,
            "limit_interventions": self._limits.total,
            **self.counters,
            **malformed,
        }


def _gate_limits(settings: SlaveAxisSettings) -> GateLimits:
    low, high = settings.limits.workspace_m
    return GateLimits(
        max_age_ns=int(settings.gate.max_age_s * 1e9),
        position_m=(low - _RANGE_MARGIN_M, high + _RANGE_MARGIN_M),
        velocity_m_s=_RANGE_SPEEDS * settings.limits.max_velocity_m_s,
    )
