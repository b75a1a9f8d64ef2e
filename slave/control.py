"""The control loop of one axis, pure: `tick(now, inputs) -> outputs` (docs/explanation/safety.md)."""

from dataclasses import dataclass, field
from typing import NamedTuple

from forefeel.common.clock_offset import OffsetEstimate
from forefeel.common.events.text import NO_FORCE, OVER_LIMIT, ROUND_TRIP, SLOW_LIMIT, ZERO, obstacle, quantity
from forefeel.common.limiter import LEAST_M_S, LimitHit, MotionLimiter, Reaction, claim, open_speed_m_s
from forefeel.common.messages import Grip, MotionCommand, SafetyState
from forefeel.common.settings import AxisLimits
from forefeel.slave.forces import ForceWatch
from forefeel.slave.safety import SafetyEventName, SafetyMachine
from forefeel.slave.settings import GateSettings

E = SafetyEventName
_MAX_STEP_S = 0.010  # a late tick moves the setpoint by at most this much time
_MISALIGNED = 5.0  # while engaging, this many alignment tolerances end it
_TRANSIT_SHARE = 1 / 500  # of each command in the usual transit: half a second at 1 kHz
_CONTINUES_NS = 600_000_000_000
"""A session within ten minutes of the last goes on with the instrument where it is: the link was cut, or the
master started again."""
_MAX_LEAD_NS = 20_000_000  # jitter up to this is evened out
Transition = tuple[SafetyState, SafetyEventName, SafetyState, str]


class ControlInputs(NamedTuple):
    """Inputs of a tick.

    `command`: newest admitted one and its receive stamp, or None when there is no new one. `released`: one
    that came since the last tick released the deadman, though a newer one may hold it again. `estop`,
    `fault`, `clear`: what came since the last tick; the machine latches it. `stage_rests`: by its readback.
    `strayed`: it is not where it was sent. `stage_reaction_s`: `FollowingWatch.reaction_s`.
    """

    command: tuple[MotionCommand, int] | None
    position_m: float
    force_n: float
    force_valid: bool
    force_age_s: float
    session_live: bool
    clock: OffsetEstimate | None
    estop: str | None = None
    fault: str | None = None
    shutdown: bool = False
    clear: bool = False
    released: bool = False
    stage_rests: bool = True
    strayed: bool = False
    stage_reaction_s: tuple[float, float] | None = None
    lost_reason: str = "no session"


@dataclass(slots=True)
class ControlOutputs:
    """Results of a tick: setpoint, or hold; grip; events.

    `executing`: the command that is followed. `behind_ns`: the time now, less that of the operator's motion
    which is followed: the command's stamp, and since when it is carried on.
    """

    target_m: float
    velocity_m_s: float
    moving: bool
    grip: Grip
    executing: MotionCommand | None
    behind_ns: int = 0
    transitions: list[Transition] = field(default_factory=list)
    limits: list[LimitHit] = field(default_factory=list)


class AxisControl:
    """Moves the setpoint of one axis by inputs and safety machine; keeps the newest command."""

    def __init__(self, limits: AxisLimits, gate: GateSettings, reaction: Reaction, position_m: float) -> None:
        self.machine = SafetyMachine()
        self.limiter = MotionLimiter(limits, gate.stop_deceleration_m_s2)
        self.limiter.place(position_m)
        self.grip = Grip.CLOSED
        self.stops = 0
        self._limits, self._gate = limits, gate
        self.limiter.reaction = reaction
        self._watchdog_ns = gate.watchdog_s * 1e9
        self._max_round_trip_ns = gate.max_round_trip_s * 1e9
        self._command: MotionCommand | None = None
        self._received_ns = 0
        self._usual_transit_ns: float | None = None
        self._behind_ns = 0
        self._released = False
        self._engaged_ns = 0
        self._zeroed_ns: int | None = None
        self._force = ForceWatch(limits.max_force_n, gate.force_timeout_s)
        self._stage_rests = True
        self._previous_ns: int | None = None

    @property
    def over_limit(self) -> bool:
        return self._force.is_over

    @property
    def zeroed(self) -> bool:
        """True after an arming: the instrument touches nothing. Lapses after 10 min without a session."""
        return self._zeroed_ns is not None

    @property
    def at_rest(self) -> bool:
        """True when neither setpoint nor stage moves, and nothing will without a new command."""
        return not self.machine.following and self.limiter.velocity_m_s == 0.0 and self._stage_rests

    def tick(self, now_ns: int, inputs: ControlInputs) -> ControlOutputs:
        """Runs one control tick: fires the events that the inputs cause, then moves the setpoint along the
        command while following, else brakes it to rest. A strayed stage puts the setpoint on the readback; so
        does a loop that stood still beyond the watchdog, which fires WATCHDOG, too.
        """
        stood_ns = 0 if self._previous_ns is None else now_ns - self._previous_ns
        elapsed_s = 1e-3 if self._previous_ns is None else stood_ns * 1e-9
        dt_s, self._previous_ns = min(max(elapsed_s, 1e-6), _MAX_STEP_S), now_ns
        transitions: list[Transition] = []
        hits: list[LimitHit] = []
        self._take(inputs)
        self._stage_rests = inputs.stage_rests
        if inputs.strayed:  # a setpoint ahead of a stuck stage would make it leap once it is freed
            self.limiter.place(inputs.position_m)
        force, follows = self._force, self.machine.following
        force.take(now_ns, inputs.force_n, inputs.force_valid, inputs.force_age_s, stood_ns * 1e-9, follows)
        stage_s, run_on_s = inputs.stage_reaction_s or self.limiter.reaction[2:]
        self.limiter.reaction = Reaction(force.reading_s, self.limiter.reaction.filter_s, stage_s, run_on_s)
        self.limiter.age_s = force.age_s
        if follows and force.is_late:
            hits.append(LimitHit("reading_late", force.late_s, force.reading_s, "s"))
        if force.is_over:
            hits.append(LimitHit(OVER_LIMIT, force.force_n, self._limits.max_force_n, "N"))
        if self._zeroed_ns is not None and now_ns - self._zeroed_ns > _CONTINUES_NS:
            self._zeroed_ns = None
        elif self._zeroed_ns is not None and inputs.session_live:
            self._zeroed_ns = now_ns
        if 0 < self._watchdog_ns < stood_ns:
            # Whatever stopped this loop, the drive's own watchdog has stopped the stage: there it stays.
            self.limiter.place(inputs.position_m)
            reason = f"the control loop stood still for {quantity(stood_ns * 1e-9, 's')}"
            self._fire(E.WATCHDOG, reason, now_ns, transitions)
        for event, reason in self._events(now_ns, inputs, hits):
            self._fire(event, reason, now_ns, transitions)
            if event is E.ENGAGE and self.machine.following:
                self.limiter.place(inputs.position_m)  # where the stage is, whatever moved it meanwhile
        if self.machine.following:
            hits += self._follow(now_ns, dt_s)
        else:
            self.limiter.stop(dt_s, force.force_n, force.limit_share)
            if self.machine.state is SafetyState.STOPPING and self.at_rest:
                self._fire(E.AT_REST, "stage at rest", now_ns, transitions)
        following = self.machine.following
        return ControlOutputs(
            target_m=self.limiter.position_m,
            velocity_m_s=self.limiter.velocity_m_s,
            moving=following or self.limiter.velocity_m_s != 0.0,
            grip=self.grip,
            executing=self._command if following else None,
            behind_ns=self._behind_ns,
            transitions=transitions,
            limits=hits,
        )

    def obstacle(self, clock: OffsetEstimate | None) -> LimitHit | None:
        """Limit that keeps the axis from arming wherever hand and stage are: round trip too long (not judged
        while `clock` is None), force limit that leaves too little speed, no valid force yet, load cell not at
        zero; else None.
        """
        if (hit := self._long_round_trip(clock)) is not None:
            return hit
        leaves_m_s = open_speed_m_s(self._limits, self.limiter.reaction)
        if leaves_m_s < LEAST_M_S:
            return LimitHit(SLOW_LIMIT, leaves_m_s, LEAST_M_S, "m/s")
        if self.zeroed or self._gate.force_timeout_s is None:  # a recording's, wherever that begins
            return None
        zero_n, tolerance_n = self._force.zero_n, self._force.tolerance_n
        if zero_n is None:
            return LimitHit(NO_FORCE, 0.0, 0.0, "N")
        return LimitHit(ZERO, zero_n, tolerance_n, "N") if abs(zero_n) > tolerance_n else None

    def _long_round_trip(self, clock: OffsetEstimate | None) -> LimitHit | None:
        if clock is None or clock.round_trip_ns <= self._max_round_trip_ns:
            return None
        return LimitHit(ROUND_TRIP, clock.round_trip_ns * 1e-9, self._gate.max_round_trip_s, "s")

    def halt(self, now_ns: int, estop: str | None, fault: str | None) -> list[Transition]:
        """Fires the stop and the fault that are given, outside a tick; the setpoint stays."""
        transitions: list[Transition] = []
        for event, reason in ((E.ESTOP, estop), (E.FAULT, fault)):  # the gravest first
            if reason is not None:
                self._fire(event, reason, now_ns, transitions)
        return transitions

    def _take(self, inputs: ControlInputs) -> None:
        """Keeps a new command with its receive stamp, and how far it is behind; notes that the deadman was
        released, which engaging requires. Does nothing without a new command.
        """
        if inputs.command is None:
            return
        self._command, self._received_ns = inputs.command
        self._even_out(self._received_ns - self._command.stamp_ns)
        if inputs.released or not self._command.deadman:
            # an engagement needs a press after a release, never a deadman that is simply held
            self._released = True

    def _even_out(self, transit_ns: int) -> None:
        """Sets `_behind_ns` to the usual transit of commands, a slow mean that is updated first; one that
        deviates by over 20 ms shifts it by the rest. So jitter of the network is no jitter of the stage,
        which is behind the hand by the usual transit (and the clocks' offset).
        """
        if self._usual_transit_ns is None:
            self._usual_transit_ns = float(transit_ns)
        late_ns = transit_ns - self._usual_transit_ns
        self._usual_transit_ns += late_ns * _TRANSIT_SHARE
        self._behind_ns = transit_ns - round(min(max(late_ns, -_MAX_LEAD_NS), _MAX_LEAD_NS))

    def _events(self, now_ns: int, inputs: ControlInputs, hits: list[LimitHit]) -> list[tuple[E, str]]:
        """Events with reasons that the inputs cause, in firing order: clear (first, so that a cause that
        lasts latches again), emergency stop, fault, shutdown, session lost or opened, those of the command.
        Adds to `hits` the limit that refuses to arm.
        """
        events: list[tuple[E, str]] = []
        if inputs.clear:
            events.append((E.CLEAR, "cleared at the slave"))
        if inputs.estop is not None:
            events.append((E.ESTOP, inputs.estop))
        fault = inputs.fault or self._force.fault(now_ns, inputs.force_valid, self.machine.following)
        if fault is not None:
            events.append((E.FAULT, fault))
        if inputs.shutdown:
            events.append((E.SHUTDOWN, "the slave is shutting down"))
        if not inputs.session_live:
            events.append((E.SESSION_LOST, inputs.lost_reason))
        elif inputs.clock is None:
            events.append((E.SESSION_LOST, "another session, its clock is not compared"))
        elif not inputs.shutdown:
            if events or self.machine.state is SafetyState.IDLE:  # nothing else heeds it
                events.append((E.SESSION_OPENED, "a session holds the lease, the clocks are compared"))
            events += self._command_events(now_ns, inputs, inputs.clock, hits)
        return events

    def _command_events(
        self, now_ns: int, inputs: ControlInputs, clock: OffsetEstimate, hits: list[LimitHit]
    ) -> list[tuple[E, str]]:
        """Event with reason, at most one, that follows from the newest command or its silence: while
        following one of `_following_events`; in READY at rest ENGAGE, for a deadman pressed after a release.
        Empty where none; the limit that refuses to arm is added to `hits`.
        """
        command = self._command
        if command is None:
            return []
        if self.machine.following:
            return self._following_events(now_ns, inputs.released, command, clock)
        pressed = inputs.command is not None and command.deadman and self._released
        ready = self.machine.state is SafetyState.READY and self.at_rest
        if ready and pressed and self._may_engage(command, inputs.position_m, clock, hits):
            return [(E.ENGAGE, f"deadman pressed, aligned; {claim(self._limits, self.limiter.reaction)}")]
        return []

    def _following_events(
        self, now_ns: int, released: bool, command: MotionCommand, clock: OffsetEstimate
    ) -> list[tuple[E, str]]:
        """Event with reason that ends the following, at most one: release, silence beyond the watchdog, long
        round trip; while engaging also misalignment, or the end of the ramp (ENGAGED). Empty where none.
        """
        if released or not command.deadman:
            return [(E.RELEASE, "deadman released")]
        silent_ns = now_ns - self._received_ns
        if 0 < self._watchdog_ns < silent_ns:
            return [(E.WATCHDOG, f"no valid command for {quantity(silent_ns * 1e-9, 's')}")]
        if (hit := self._long_round_trip(clock)) is not None:
            return [(E.ROUND_TRIP, obstacle(*hit[:3]))]
        engaging = self.machine.state is SafetyState.ENGAGING
        return self._engaging_events(now_ns, command) if engaging else []

    def _engaging_events(self, now_ns: int, command: MotionCommand) -> list[tuple[E, str]]:
        distance_m = abs(command.position_m - self.limiter.position_m)
        if distance_m > _MISALIGNED * self._gate.alignment_m:
            return [(E.MISALIGNED, f"command {distance_m * 1e3:.2f} mm away while engaging")]
        ramped = now_ns - self._engaged_ns >= self._gate.engage_ramp_s * 1e9
        return [(E.ENGAGED, "ramp done")] if ramped and distance_m <= self._gate.alignment_m else []

    def _may_engage(
        self, command: MotionCommand, position_m: float, clock: OffsetEstimate, hits: list[LimitHit]
    ) -> bool:
        """True if the axis may arm at that command; else adds the limit that forbids it to `hits`."""
        hit = self.obstacle(clock)
        if hit is None and abs(command.position_m - position_m) > self._gate.alignment_m:
            hit = LimitHit("alignment", command.position_m, position_m, "m")
        hits += [] if hit is None else [hit]
        return hit is None

    def _fire(self, event: E, reason: str, now_ns: int, transitions: list[Transition]) -> None:
        """Fires an event in the safety machine; does nothing where its state has no transition for it. Else
        appends the transition to `transitions`. ENGAGING stores the time; leaving ENGAGING or ARMED asks for
        a new release and counts in `stops`, except by RELEASE and ESTOP; SESSION_OPENED forgets the command.
        """
        changed = self.machine.fire(event, reason)
        if changed is None:
            return
        before, after = changed
        transitions.append((before, event, after, reason))
        if after is SafetyState.ENGAGING:
            self._engaged_ns = self._zeroed_ns = now_ns
        elif before in (SafetyState.ENGAGING, SafetyState.ARMED) and after is not SafetyState.ARMED:
            self._released = False
            self.stops += event not in (E.RELEASE, E.ESTOP)
        elif event is E.SESSION_OPENED:
            self._command, self._released, self._usual_transit_ns = None, False, None

    def _follow(self, now_ns: int, dt_s: float) -> list[LimitHit]:
        """Moves the setpoint for dt towards the newest command, carried on with its velocity; returns the
        limits that acted. Takes over the command's grip; while engaging the speed ramps up.
        """
        assert self._command is not None
        command = self._command
        self.grip = command.gripper
        ahead_s = (now_ns - self._behind_ns - command.stamp_ns) * 1e-9
        share = 1.0
        if self.machine.state is SafetyState.ENGAGING:
            share = min(1.0, (now_ns - self._engaged_ns) * 1e-9 / self._gate.engage_ramp_s)
        return self.limiter.follow(
            command.position_m + command.velocity_m_s * ahead_s,
            command.velocity_m_s,
            self._force.force_n,
            dt_s,
            share,
            self._force.limit_share,
            command.band_n,
        )
