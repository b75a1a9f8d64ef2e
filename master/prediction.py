"""The force now: the predictor on the setpoints that the stage is about to follow. Pure.

One stamp joins everything: that of the command. The predictor moves with the setpoint that the limits leave
of the command, and learns from the force that the slave measured while it executed that command. So the
delay, its jitter and the two clocks stay out of it, and it is asked for just what it has learned on: the
drive's lag is part of what it learns. A model of a model.yaml was learned on positions of the stage: it gets
those that are expected, and takes part in two forms, see `forefeel.common.estimation.loaded`.
"""

from typing import NamedTuple, Protocol

from forefeel.common.causes.model import ContactModel
from forefeel.common.estimation.evaluator import Estimate, Evaluator
from forefeel.common.estimation.identification import ContactEstimate
from forefeel.common.estimation.learner import Learner
from forefeel.common.estimation.loaded import NOTHING, LoadedContact
from forefeel.common.estimation.stage_lag import StageLag
from forefeel.common.limiter import MotionLimiter
from forefeel.common.messages import ForceSample, Grip
from forefeel.common.settings import AxisLimits

_MAX_STEP_S = 0.010  # s, longest step of time that the limits count, as in `slave/control.py`


class Present(NamedTuple):
    """What is known in a tick: the command that it sends, the model's parameters, the newest force."""

    stamp_ns: int
    position_m: float
    velocity_m_s: float
    deadman: bool
    estimate: ContactEstimate | None
    newest: ForceSample | None


class Prediction(Protocol):
    """The contact force at the operator's present motion; asked at every tick of the haptic loop."""

    def predict(self, present: Present) -> Estimate | None:
        """The force for the command that is sent now; None before any force has arrived."""
        ...

    def reset(self) -> None:
        """The motion so far is over, as after a new grip; what was learned stays."""
        ...


class ExpectedStage:
    """Where the stage is expected when it executes a command: behind the limits of both ends, then its
    lag, so that what a drive can not do is not mistaken for its lag.
    """

    def __init__(self, limits: AxisLimits) -> None:
        self._lag, self._workspace_m = StageLag(), limits.workspace_m
        self._limiter = MotionLimiter(limits, limits.max_acceleration_m_s2)
        self._previous_ns: int | None = None

    def setpoint_m(self, stamp_ns: int, position_m: float, velocity_m_s: float, deadman: bool) -> float:
        """What the slave's limits will leave of the command of that stamp.

        Without the deadman nothing moves: the command is the stage's own position, as the network says it.
        """
        position_m = min(max(position_m, self._workspace_m[0]), self._workspace_m[1])
        previous_ns, self._previous_ns = self._previous_ns, stamp_ns
        if not deadman or previous_ns is None or stamp_ns <= previous_ns:
            self._limiter.place(position_m)
        else:
            dt_s = min((stamp_ns - previous_ns) * 1e-9, _MAX_STEP_S)
            self._limiter.follow(position_m, velocity_m_s, 0.0, dt_s)
        return self._limiter.position_m

    def position_m(self, stamp_ns: int, setpoint_m: float) -> float:
        """Where the drive will be when it answers that setpoint, by the lag that has been identified."""
        return self._lag.command(stamp_ns, setpoint_m)

    def observe(self, stamp_ns: int, readback_m: float) -> None:
        self._lag.observe(stamp_ns, readback_m)


class ForcePrediction:
    """One axis. `predict` and `reset` run in the haptic loop, `learn` and `publish` in the identification
    task.

    Args:
        limits: of the axis, as both ends share them.
        model: of a model.yaml, which then takes part with experts of its own; None without one.
        velocity_cutoff_hz: of the filter of the model's velocity.
    """

    def __init__(self, limits: AxisLimits, model: ContactModel | None, velocity_cutoff_hz: float) -> None:
        self._stage = ExpectedStage(limits)
        self._evaluator = Evaluator()
        self._learner = Learner(self._evaluator)
        self._model = None if model is None else LoadedContact(model, velocity_cutoff_hz)
        self._origin_ns: int | None = None
        self._newest: ForceSample | None = None

    def predict(self, present: Present) -> Estimate | None:
        """See `Prediction`. The newest force counts at once, before it is learned from."""
        stamp_ns, position_m, velocity_m_s, deadman, estimate, newest = present
        if self._origin_ns is None:
            self._origin_ns = stamp_ns
        setpoint_m = self._stage.setpoint_m(stamp_ns, position_m, velocity_m_s, deadman)
        forces = NOTHING
        if self._model is not None:
            expected_m = self._stage.position_m(stamp_ns, setpoint_m)
            forces = self._model.move(stamp_ns, expected_m, velocity_m_s, estimate)
        if newest is not None and newest is not self._newest:
            self._newest = newest
            if (heard_s := self._stamp_s(newest)) is not None:
                self._evaluator.hear(heard_s, newest.force_n)
        t_s = (stamp_ns - self._origin_ns) * 1e-9
        self._evaluator.move(t_s, setpoint_m, *forces)
        return self._evaluator.predict()

    def learn(self, sample: ForceSample) -> float:
        """A force that has arrived, with the readback of the same instant; what of it, in N, is a matter of
        the motion."""
        stamp_s, stamp_ns = self._stamp_s(sample), sample.answers_stamp_ns
        if stamp_s is not None:
            self._learner.take(stamp_s, sample.force_n)
        if stamp_ns is None or self._model is None:
            return sample.force_n
        self._stage.observe(stamp_ns, sample.position_m)
        self._model.learn(stamp_ns, sample.force_n)
        return self._model.of_motion_n(stamp_ns, sample.force_n)

    def publish(self) -> None:
        """Gives the loop a snapshot of what has been learned."""
        self._evaluator.snapshot = self._learner.publish()

    def _stamp_s(self, sample: ForceSample) -> float | None:
        """Stamp of the command that a force answers; None where it answers none, or the fixture was open."""
        stamp_ns, origin_ns = sample.answers_stamp_ns, self._origin_ns
        if stamp_ns is None or origin_ns is None or sample.gripper is not Grip.CLOSED:
            return None
        return (stamp_ns - origin_ns) * 1e-9

    def reset(self) -> None:
        self._evaluator.restart()
        if self._model is not None:
            self._model.reset()
