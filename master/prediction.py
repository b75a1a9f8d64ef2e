"""The force now: the predictor on the setpoints that the stage is about to follow; and the task that learns
from the forces that arrive late. Pure.

One stamp joins everything: that of the operator's motion, which a force brings back (`ForceSample`). The
predictor moves with the setpoint that the limits leave of a command, and learns from the force that the slave
measured while it followed that motion. So the delay, its jitter and the two clocks stay out of it, and it is
asked for just what it has learned on: the drive's lag is part of what it learns. The contact model is one of
the instrument's tip: it moves with the position at which the stage is expected.
"""

from collections import deque
from dataclasses import dataclass
from operator import itemgetter
from typing import NamedTuple

from forefeel.common.causes.motion import NO_COLUMNS, Columns
from forefeel.common.estimation.evaluator import Estimate, Evaluator, Snapshot
from forefeel.common.estimation.learner import Learner
from forefeel.common.estimation.stage_lag import StageLag
from forefeel.common.limiter import LATEST_S, MotionLimiter, Reaction
from forefeel.common.messages import ForceSample, Grip
from forefeel.common.settings import AxisLimits
from forefeel.common.slots import BoundedQueue, CommandRing

_MAX_STEP_S = 0.010  # s, longest step of time that the limits count, as in `slave/control.py`


class _Expected(NamedTuple):
    """Position of one command, the setpoint expected for it, and the sum of the corrections by then."""

    stamp_ns: int
    position_m: float
    setpoint_m: float
    corrected_m: float
    force_limited: bool


class ExpectedSetpoint:
    """Setpoint that the slave's limits leave of a command; what they forbid is not the drive's lag.

    The slave's force limit acts on a force that is here only predicted. So each force brings back what it has
    left of its command, and the expected setpoint is corrected by the difference.
    """

    def __init__(self, limits: AxisLimits) -> None:
        self._workspace_m, self._limit_n = limits.workspace_m, limits.max_force_n
        self._limiter = MotionLimiter(limits, limits.max_acceleration_m_s2)
        self._previous_ns: int | None = None
        self._expected_n: deque[tuple[int, float]] = deque([(0, 0.0)])
        self._sent = CommandRing[_Expected]()
        self._corrected_m = 0.0

    def answered_ns(self, sample: ForceSample) -> int | None:
        """Stamp of the last command within 5 ms before the motion that a force answers; None without one."""
        sent = self._sent.get(sample.answers_stamp_ns or 0)
        return None if sent is None else sent.stamp_ns

    def error_m(self, sample: ForceSample) -> float:
        """The slave's setpoint less the one expected for the same motion, in m; 0 where the force limit acted
        on neither, for other differences are those of the way that commands take, or one is not known.
        """
        sent = self._sent.get(sample.answers_stamp_ns or 0)
        if sent is None or sample.setpoint_m is None or not (sample.force_limited or sent.force_limited):
            return 0.0
        return sample.setpoint_m - sent.setpoint_m

    def correct(self, sample: ForceSample, asked_m: float) -> None:
        """Moves the expected setpoint, within the workspace, by the slave's deviation from it, less the
        corrections made since the sample's command was sent. Does nothing unless the slave's force limit
        acted, that command is known, and the hand (`asked_m`, position asked for now) still asks beyond the
        slave's setpoint on the same side.
        """
        setpoint_m = sample.setpoint_m
        if not sample.force_limited or setpoint_m is None:
            return
        sent = self._sent.get(sample.answers_stamp_ns or 0)
        if sent is not None and (asked_m - setpoint_m) * (sent.position_m - setpoint_m) > 0.0:
            # forces under way do not know the corrections since their commands were sent
            change_m = self.error_m(sample) - (self._corrected_m - sent.corrected_m)
            self._corrected_m += change_m
            corrected_m = self._limiter.position_m + change_m
            self._limiter.position_m = min(max(corrected_m, self._workspace_m[0]), self._workspace_m[1])

    def follow(
        self,
        stamp_ns: int,
        position_m: float,
        velocity_m_s: float,
        deadman: bool,
        expected: Estimate | None = None,
    ) -> float:
        """Advances the expected setpoint to a command and returns it in m: what the slave's motion and force
        limits leave; stored under the stamp. Without the deadman, after `restart`, or if the stamp does not
        increase, it jumps to the command within the workspace. `expected`: force that the limit is applied
        to; None: 0 N.
        """
        position_m = min(max(position_m, self._workspace_m[0]), self._workspace_m[1])
        previous_ns, self._previous_ns = self._previous_ns, stamp_ns
        if not deadman or previous_ns is None or stamp_ns <= previous_ns:
            self._limiter.place(position_m)
        else:
            dt_s = min((stamp_ns - previous_ns) * 1e-9, _MAX_STEP_S)
            force_n, low_n, high_n = expected[:3] if expected else (0.0, 0.0, 0.0)
            self._expected_n.append((stamp_ns, force_n))
            while self._expected_n[0][0] < stamp_ns - self._limiter.reaction.reading_s * 1e9:
                self._expected_n.popleft()
            # The newest reading has this one. How far the stage yields to more than the limit comes back.
            shown_n = min(self._expected_n[0][1], self._limit_n)
            self._limiter.follow(position_m, velocity_m_s, shown_n, dt_s, band_n=(low_n, high_n))
        setpoint_m, force_limited = self._limiter.position_m, self._limiter.force_limited
        sent = _Expected(stamp_ns, position_m, setpoint_m, self._corrected_m, force_limited)
        self._sent.put(stamp_ns, sent)
        return setpoint_m

    def restart(self) -> None:
        """Makes the next command place the setpoint anew; commands sent before can still be answered."""
        self._previous_ns = None

    def react(self, reaction: Reaction) -> None:
        """Sets the lateness with which the slave's force limit sees a force; 1 s at most in each part."""
        self._limiter.reaction = Reaction(*(min(part_s, LATEST_S) for part_s in reaction))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Identified(Snapshot):
    """Snapshot of all that was identified, with the lags of the stage, see `StageLag`.

    `number` of the run, `forces` drained from the queue by then, and `fit_late` as of the learner: a replay
    makes the snapshot anew from these three.
    """

    lags: tuple[float, float] | None = None
    number: int = 0
    forces: int = 0
    fit_late: bool = False


class ForcePrediction:
    """Predicts the contact force at the operator's present motion, of one axis, at every tick of its loop.

    Args:
        limits: of the axis, as both ends share them.

    Attributes:
        evaluator, lag, setpoint: what the identification task reads of the loop. stage_m: where the stage is
            expected at the newest command.
    """

    def __init__(self, limits: AxisLimits) -> None:
        self.lag = StageLag()
        self.setpoint = ExpectedSetpoint(limits)
        self.evaluator = Evaluator()
        self.stage_m = 0.0
        self._origin_ns: int | None = None
        self._newest: ForceSample | None = None
        self._expected: Estimate | None = None

    def predict(
        self,
        stamp_ns: int,
        position_m: float,
        velocity_m_s: float,
        deadman: bool,
        snapshot: Identified,
        newest: ForceSample | None,
        further: Columns = NO_COLUMNS,
    ) -> Estimate | None:
        """Predicts the force where the slave's setpoint and its lagging stage will be by this command; None
        before any force has arrived. Stateful, once per command: a `newest` that was not given before first
        corrects setpoint and prediction; without `deadman` the setpoint jumps to the command. `further`:
        positions of other axes that the contact model follows.
        """
        if self._origin_ns is None:
            self._origin_ns = stamp_ns
        if newest is not None and newest is not self._newest:
            self._newest = newest
            self.setpoint.correct(newest, position_m)
            if (answered_s := self.stamp_s(newest)) is not None:
                self.evaluator.hear(answered_s, newest.force_n)
        setpoint_m = self.setpoint.follow(stamp_ns, position_m, velocity_m_s, deadman, self._expected)
        self.stage_m = self.lag.command(stamp_ns, setpoint_m, snapshot.lags)
        self.evaluator.snapshot = snapshot
        stamp_s = (stamp_ns - self._origin_ns) * 1e-9
        self.evaluator.move(stamp_s, setpoint_m, self.stage_m, velocity_m_s, further)
        self._expected = self.evaluator.predict()
        return self._expected

    def stamp_s(self, sample: ForceSample) -> float | None:
        """Stamp in s, from the first command on, of the command whose motion a force answers; None where that
        is not known, the force is not valid or the gripper was open.
        """
        stamp_ns, origin_ns = self.setpoint.answered_ns(sample), self._origin_ns
        usable = sample.valid and sample.gripper is Grip.CLOSED
        if stamp_ns is None or origin_ns is None or not usable:
            return None
        return (stamp_ns - origin_ns) * 1e-9

    def reset(self) -> None:
        """Forgets the motion so far, as after a new grip; what was learned stays."""
        self._expected = None
        self.setpoint.restart()
        self.evaluator.restart()


_QUEUE = 8192  # eight seconds at 1 kHz


class IdentificationTask:
    """Learns from the late forces, on asyncio; the haptic loop reads `snapshot`, one reference, without lock.

    A force and the readback of the same instant travel in one sample with the stamp of the command that
    they answer: the network can delay, lose or reorder such samples, and mixes nothing.

    Args:
        prediction: in the loop.
        learner: learns what the prediction's evaluator is to know.

    Attributes:
        queue: filled with the samples to learn from. snapshot: what is known. used, unused: samples so far.
    """

    def __init__(self, prediction: ForcePrediction, learner: Learner) -> None:
        self.queue: BoundedQueue[ForceSample] = BoundedQueue(_QUEUE)
        self._prediction = prediction
        self.learner = learner
        self.used = self.unused = 0
        self.snapshot = self._make_snapshot(0)

    def run(self) -> None:
        """Drains `queue`, learns from its samples in the order of the stamps and renews `snapshot`. Samples
        that are invalid, answer no command or had the gripper open only count, in `unused`; others in `used`.
        """
        samples = self.queue.drain()
        known = [(s, sample) for sample in samples if (s := self._prediction.stamp_s(sample)) is not None]
        self.used += len(known)
        self.unused += len(samples) - len(known)
        for stamp_s, sample in sorted(known, key=itemgetter(0)):
            error_m = self._prediction.setpoint.error_m(sample)
            self._prediction.lag.observe(sample.answers_stamp_ns or 0, sample.position_m - error_m)
            self.learner.take(stamp_s, sample.force_n, error_m)
        self.snapshot = self._make_snapshot(self.snapshot.number + 1)

    def _make_snapshot(self, number: int) -> Identified:
        """Snapshot, with its `number`, of the learner's model, the stage's lags and the count of samples."""
        published = self.learner.publish()
        return Identified(
            published.learned,
            published.contact,
            published.band_known,
            published.taught,
            lags=self._prediction.lag.lags,
            number=number,
            forces=self.used + self.unused,
            fit_late=self.learner.fit_late,
        )
