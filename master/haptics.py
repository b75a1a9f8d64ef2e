"""The haptic loop of one axis, pure: `tick(now, inputs) -> outputs`. It never waits for the network."""

from math import isfinite
from typing import NamedTuple

from forefeel.common.causes.motion import NO_COLUMNS, Columns
from forefeel.common.estimation.evaluator import Estimate
from forefeel.common.events.text import DISTRUSTED
from forefeel.common.limiter import LimitHit
from forefeel.common.messages import FOLLOWING, MOST_FORCE_N, ForceSample, Grip, SafetyState
from forefeel.common.settings import AxisLimits
from forefeel.master.handle import HandleReading
from forefeel.master.prediction import ForcePrediction, Identified
from forefeel.master.rendering import ForceRenderer, Rendered
from forefeel.master.rendering_watch import RenderingWatch
from forefeel.master.settings import RenderingSettings


class NewestForce(NamedTuple):
    """Newest valid force. `late_ns`: how much longer its way took than that of the fastest message; None
    before the clocks are compared. `ended`: an invalid one has come since.
    """

    sample: ForceSample
    arrived_ns: int
    late_ns: int | None
    ended: bool = False

    def is_fresh(self, now_ns: int, stale_ns: int) -> bool:
        """True if lateness and time since arrival sum to at most `stale_ns`; False if `late_ns` is None."""
        return self.late_ns is not None and now_ns - self.arrived_ns + self.late_ns <= stale_ns


class HapticInputs(NamedTuple):
    """Inputs of a tick. `state`, `stage_position_m`: the slave's, as they arrived last. `further`: where the
    other axes' stages are expected, of those that the contact's model follows. `in_session`: the tick's
    command is sent. `released`: the deadman counts as released in it, whatever the hand does.
    """

    reading: HandleReading
    state: SafetyState | None
    stage_position_m: float | None
    force: NewestForce | None
    snapshot: Identified
    further: Columns = NO_COLUMNS
    in_session: bool = True
    released: bool = False


class HapticOutputs(NamedTuple):
    """Results of a tick: the command, and the force to render beside what it rests on.

    `band_n`: ends of the 95 % band, None while it is not known or the force is stale.
    """

    position_m: float
    velocity_m_s: float
    deadman: bool
    gripper: Grip
    recording_time_s: float | None
    predicted: Estimate | None
    band_n: tuple[float, float] | None
    zoh_n: float | None
    rendered_n: float
    hits: tuple[LimitHit, ...]
    energy_j: float


class Clutch:
    """Command = handle + offset. With the clutch open (no deadman) the offset keeps it on the stage."""

    def __init__(self) -> None:
        self.offset_m = 0.0

    def command_m(self, reading: HandleReading, stage_position_m: float | None) -> float:
        """Absolute position to command; `stage_position_m`: newest known readback, None before any."""
        if not reading.deadman and stage_position_m is not None:
            self.offset_m = stage_position_m - reading.position_m
        return reading.position_m + self.offset_m


class HapticLoop:
    """Turns the reading of the handle into a command and a force to render, once per tick.

    Attributes:
        prediction: of the force; its setpoint is to be told the slave's reaction times. stage_m: where the
            stage is expected now, for the other axes; 0 before it is known.
    """

    def __init__(
        self,
        prediction: ForcePrediction,
        settings: RenderingSettings,
        limits: AxisLimits | None = None,
    ) -> None:
        self.clutch = Clutch()
        self.prediction, self.stage_m = prediction, 0.0
        self._renderer = ForceRenderer(settings)
        self._watch = RenderingWatch(settings, limits or AxisLimits())
        self._rendered = Rendered(0.0, (), 0.0)
        self._feels_zoh = settings.source == "zoh"
        self._stale_ns = int(settings.stale_s * 1e9)

    def tick(self, now_ns: int, inputs: HapticInputs) -> HapticOutputs:
        """Computes command, predicted force and rendered force of one tick; stateful. The rendered force
        fades out unless the newest force is fresh, the deadman pressed and the slave following. While the
        watch distrusts the prediction the newest measured force is rendered in its place, with a hit for it;
        if that lasts, the deadman is released.
        """
        reading, force = inputs.reading, inputs.force
        position_m = self.clutch.command_m(reading, inputs.stage_position_m)
        deadman = reading.deadman and not self._watch.ends
        predicted = self._predict(now_ns, position_m, deadman, inputs)
        fresh = force is not None and force.is_fresh(now_ns, self._stale_ns)
        following = reading.deadman and inputs.state in FOLLOWING
        # one that stays away, or comes and is never fresh, has to be felt, too
        due = following and force is not None and (fresh or not force.ended)
        newest = force.sample if force is not None and due else None
        self._watch.judge(now_ns, position_m, reading.deadman, newest, predicted, self._rendered)
        if predicted is not None and not isfinite(sum(predicted[:3])):
            predicted = None
        if reading.gripper is Grip.OPEN or inputs.state not in FOLLOWING:
            self.stage_m = self.stage_m if inputs.stage_position_m is None else inputs.stage_position_m
        elif deadman:  # just released, it stays there; the readback is of before
            self.stage_m = self.prediction.stage_m
        zoh_n = force.sample.force_n if force else None
        late = self._feels_zoh or self._watch.distrusts
        felt_n = zoh_n if late else predicted.force_n if predicted else None
        live = fresh and following and deadman
        rendered = self._rendered = self._renderer.render(now_ns, felt_n, live, reading.position_m)
        hits, asked_n = rendered.hits, predicted.force_n if predicted else MOST_FORCE_N
        if self._watch.distrusts:
            hits += (LimitHit(DISTRUSTED, asked_n, felt_n or 0.0, "N"),)
        return HapticOutputs(
            position_m=position_m,
            velocity_m_s=reading.velocity_m_s if deadman else 0.0,
            deadman=deadman,
            gripper=reading.gripper,
            recording_time_s=reading.recording_time_s,
            predicted=predicted,
            band_n=predicted[1:3] if predicted and fresh and inputs.snapshot.band_known else None,
            zoh_n=zoh_n,
            rendered_n=rendered.force_n,
            hits=hits,
            energy_j=rendered.energy_j,
        )

    def late_by(self, actuator_delay_s: float) -> None:
        """Sets the actuator delay of the handle and restarts the energy balance; before the first tick."""
        self._renderer.late_by(actuator_delay_s)

    def applied(self, force_n: float) -> None:
        """Stores the force that the handle applied, for the energy balance of the next tick."""
        self._renderer.applied(force_n)

    def release(self) -> None:
        """Restarts the rendered force at zero, to fade in: the hand felt nothing, whatever was rendered."""
        self._renderer.release()

    def _predict(
        self, now_ns: int, position_m: float, deadman: bool, inputs: HapticInputs
    ) -> Estimate | None:
        """Predicts the force for the command as it is sent, so that a recording can be replayed. None before
        any force has arrived, outside a session, and while the gripper is open, which also makes the
        prediction forget its motion.
        """
        reading = inputs.reading
        if not inputs.in_session:
            return None
        if reading.gripper is Grip.OPEN:
            self.prediction.reset()
            return None
        newest = inputs.force.sample if inputs.force else None
        velocity_m_s, held = reading.velocity_m_s if deadman else 0.0, deadman and not inputs.released
        return self.prediction.predict(
            now_ns, position_m, velocity_m_s, held, inputs.snapshot, newest, inputs.further
        )
