"""A CiA 402 drive in cyclic synchronous position mode behind the stage port."""

from forefeel.common.clock import Clock, MonotonicClock
from forefeel.common.errors import DeviceError
from forefeel.common.hardware import cia402
from forefeel.common.hardware.calibration import StageCalibration
from forefeel.common.hardware.can_network import SharedNetwork
from forefeel.common.hardware.cia402 import DriveState, Phase, drive_state
from forefeel.common.hardware.conversation import Conversation
from forefeel.common.hardware.link import LinkState
from forefeel.common.hardware.pacing import Pacer
from forefeel.common.hardware.sdo import RemoteDevice, can_link, talking_to
from forefeel.slave.stages.cia402_setup import calibration_of, checked, configure, scale_of
from forefeel.slave.stages.drive_cycle import DriveCycle, Readback, Tracker
from forefeel.slave.stages.drive_wire import DriveEars, DriveVoice
from forefeel.slave.stages.port import StageReading, require_finite
from forefeel.slave.stages.scale import PositionScale
from forefeel.slave.stages.setpoint import Setpoint, Wanted
from forefeel.slave.stages.settings import Cia402Settings

_OPEN_S = 8.0
_DECELERATION_M_S2 = 4.0
_STAND_CYCLES = 3


class Cia402Stage:
    """Stage port on a CANopen drive.

    One thread sends setpoint, SYNC and our heartbeat and judges what the drive says; after any fault it sends
    quick stops until `rearm`. The network of the bus is shared with the other drivers of this process.
    """

    def __init__(self, settings: Cia402Settings, clock: Clock | None = None) -> None:
        self._settings = settings
        self._clock = clock or MonotonicClock()
        self.link = can_link("stage", settings.driver, settings.can, settings.node_id)
        self.calibration: StageCalibration | None = None
        self._conversation: Conversation | None = None
        self._wanted: Wanted | None = None
        self._rearm = False
        self._readback: Readback | None = None
        self._limits = self._new_setpoint()

    # --- the port ---

    def open(self) -> None:
        """Identifies, configures and enables the drive; it holds where it is.

        Raises:
            DeviceSetupError: it is not the drive that the settings describe.
            DeviceError: it does not answer, or is in a fault: only a fault reset at the drive helps then.
        """
        checked(self._settings)
        self._wanted, self._rearm = None, False
        self._conversation = Conversation(self.link, self._converse)
        self._conversation.start(_OPEN_S)

    def close(self) -> None:
        """Comes to rest, quick stop, lets go."""
        if self._conversation is not None:
            self._conversation.stop()

    def rearm(self) -> None:
        """Resets a fault of the drive and enables it; it holds where it is until commanded.

        The drive follows some cycles later; if it does not within a second, that is a new fault.
        """
        if self.link.inhibited is not None:
            self._wanted = None
            self.link.rearm()
            self._rearm = True

    def command(self, position_m: float, velocity_m_s: float, now_ns: int) -> float:
        """See the port."""
        require_finite(position_m, velocity_m_s)
        self.link.require_ready()
        applied_m = self._limits.within_travel(position_m)
        self._wanted = Wanted(applied_m, velocity_m_s, now_ns)
        return applied_m

    def hold(self, now_ns: int) -> None:
        """See the port."""
        del now_ns
        self._wanted = None
        self.link.require_ready()

    def read(self, now_ns: int) -> StageReading:
        """See the port; velocity is the difference of the drive's positions at SYNC."""
        self.link.require_ready()
        found = self._readback
        if found is None:
            raise DeviceError(f"{self.link.name}: no position yet")
        return StageReading(found.position_m, found.velocity_m_s).carried_on(found.host_ns, now_ns)

    # --- the conversation ---

    def _converse(self, conversation: Conversation) -> None:
        settings = self._settings
        with talking_to(settings.can, settings.node_id, self.link) as (shared, device):
            self._talk(conversation, shared, device)

    def _talk(self, conversation: Conversation, shared: SharedNetwork, device: RemoteDevice) -> None:
        device.introduce(cia402.PROFILE)
        scale = self._scale()
        actual_m = configure(device, self._settings, scale, conversation.pause)
        self.link.advance(LinkState.CONFIGURED)
        tracker = self._new_tracker()
        voice = DriveVoice(shared, self._settings, self.link)

        def believe(host_ns: int, statusword: int, counts: float) -> Readback | None:
            heard = tracker.take(host_ns, statusword, scale.metres(counts))
            if heard is not None:
                self._readback = heard
                self.link.exchanged(None if voice.asked_ns is None else host_ns - voice.asked_ns)
            return heard

        with DriveEars(shared, self._settings.node_id, self.link, self._clock, believe) as ears:
            _CyclicExchange(self, conversation, ears, voice, scale, actual_m).run()

    def _scale(self) -> PositionScale:
        self.calibration = calibration_of(self._settings, self.link.serial)
        return scale_of(self._settings, self.calibration)

    def _new_tracker(self) -> Tracker:
        s = self._settings
        return Tracker(1.0 / s.sync_hz, s.max_velocity_m_s, s.following_error_m)

    def _new_setpoint(self) -> Setpoint:
        s = self._settings
        return Setpoint(1.0 / s.sync_hz, s.travel_m, s.max_velocity_m_s, _DECELERATION_M_S2)

    def _take_rearm(self) -> bool:
        """Whether `rearm` was called since; a fault after it voids it."""
        asked, self._rearm = self._rearm, False
        return asked and self.link.inhibited is None


class _CyclicExchange:
    """The cyclic part: from CONFIGURED until the conversation ends or a fault is raised."""

    def __init__(
        self,
        stage: Cia402Stage,
        conversation: Conversation,
        ears: DriveEars,
        voice: DriveVoice,
        scale: PositionScale,
        actual_m: float,
    ) -> None:
        settings = stage._settings
        self._stage, self._conversation, self._ears = stage, conversation, ears
        self._voice, self._scale = voice, scale
        setpoint = stage._new_setpoint()
        setpoint.restart(actual_m)
        self._cycle = DriveCycle(
            1.0 / settings.sync_hz, settings.heartbeat_s, settings.following_error_m, setpoint
        )

    def run(self) -> None:
        """Cycles at absolute deadlines; comes to rest before it returns, quick stop in any case."""
        link, clock = self._stage.link, self._stage._clock
        first = link.inhibited is None
        if not first:
            self._conversation.settled()
        pacer = Pacer(clock, self._voice.period_ns)
        try:
            while not self._may_end():
                self._cycle_once(clock.now_ns())
                self._begin(first)
                pacer.wait()
                link.counters["late_cycles"] += pacer.missed
                pacer.missed = 0
                self._voice.tell()
        finally:
            self._let_go()

    def _may_end(self) -> bool:
        at_rest = self._cycle.setpoint.velocity_m_s == 0.0 or self._phase is not Phase.FOLLOWING
        return self._conversation.stopping and at_rest

    @property
    def _phase(self) -> Phase:
        return self._cycle.machine.phase

    def _begin(self, first: bool) -> None:
        """Enables at the start, re-arms when asked to; READY once the drive follows. Else it stands."""
        link, machine = self._stage.link, self._cycle.machine
        if self._stage._take_rearm():
            machine.rearm()
        elif link.inhibited is not None:
            machine.stop()
        elif first and link.state is LinkState.CONFIGURED and self._cycle.passive_cycles >= _STAND_CYCLES:
            machine.enable()
            if machine.phase is Phase.FOLLOWING:
                link.advance(LinkState.READY)
                self._conversation.settled()

    def _cycle_once(self, now_ns: int) -> None:
        heard, beat, emergency_code = self._ears.take()
        self._stage.link.counters["silent_periods"] += heard is None and self._stage._readback is not None
        self._refuse_fault_at_start(heard)
        wanted = None if self._conversation.stopping else self._stage._wanted
        word = self._cycle.step(heard, beat, emergency_code, wanted, now_ns)
        self._send(word, now_ns)

    def _refuse_fault_at_start(self, heard: Readback | None) -> None:
        if heard is None or self._stage.link.state is not LinkState.CONFIGURED:
            return
        if self._stage.link.inhibited is None and drive_state(heard.statusword) is DriveState.FAULT:
            raise DeviceError("the drive is in a fault; expected none at the start: clear it at the drive")

    def _send(self, word: int, now_ns: int) -> None:
        self._voice.send(word, self._target(), now_ns)

    def _target(self) -> int:
        return self._scale.native(self._cycle.setpoint.position_m)

    def _let_go(self) -> None:
        self._cycle.machine.stop()
        self._voice.release(self._target(), self._stage._clock.now_ns())
