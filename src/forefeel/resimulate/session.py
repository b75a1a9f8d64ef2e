"""A recorded session predicted anew: its messages as the calls that the master's loop and task have made.

A prediction is a function of what the master sent and of what it knew. The one is in the commands; the other
is named by the haptic samples, see `HapticSample`. So version and machine of the recording repeat it bit for
bit.
"""

import json
from collections import deque
from concurrent.futures import Future
from itertools import pairwise
from math import isfinite, nan

import numpy as np
from pydantic import TypeAdapter

from forefeel.common.causes.model import ContactModel
from forefeel.common.error_size import Floats
from forefeel.common.errors import RecordingError
from forefeel.common.estimation.contact import Contact
from forefeel.common.estimation.contact_prior import ContactPrior
from forefeel.common.estimation.evaluator import Estimate
from forefeel.common.estimation.learner import Fit, Learner
from forefeel.common.limiter import Reaction
from forefeel.common.messages import MOST_FORCE_N, ForceSample, Grip, HapticSample, MotionCommand, within
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.settings import AxisLimits
from forefeel.common.topics import COMMAND, FORCE, HAPTICS, MASTER_HANDSHAKE, PARAMETERS, SLAVE_STATE
from forefeel.loopback.plan import MODEL, PRIOR
from forefeel.master.prediction import ForcePrediction, IdentificationTask


def resimulate(run: Run, axis: str) -> tuple[Floats, int]:
    """Predicts a recorded session anew. Returns predictions with lower and upper ends of their bands in N,
    (3, n) for n haptic samples, NaN for none; and the number of messages that the recording lacks.

    Raises:
        RecordingError: no session, one that has begun before the recording, two masters, or one whose prior
            or limits, or the forces that its predictions knew, were not recorded.
    """
    where, samples = f"{run.path}: axis {axis}", list(run.messages(axis, HAPTICS)) if axis in run.axes else []
    if not samples:
        raise RecordingError(f"{where}: no session; expected the recording of a master in one")
    if samples[0].snapshot is None:
        raise RecordingError(
            f"{where}: protocol {samples[0].protocol} does not say what a prediction knew; expected "
            "protocol 7 or later (forefeel 0.3.0)"
        )
    if samples[0].sequence != 1:
        raise RecordingError(
            f"{where}: begins at command {samples[0].sequence}; expected one from the start on"
        )
    if any(later.sequence <= sample.sequence for sample, later in pairwise(samples)):
        raise RecordingError(f"{where}: holds two masters, one after the other; expected one")
    commands = {(command.session_id, command.sequence): command for command in run.messages(axis, COMMAND)}
    session, rows = _Session(run, axis), list[list[float]]()
    for sample in samples:
        estimate = session.tick(sample, commands.get((sample.session_id, sample.sequence)))
        known = estimate is not None and isfinite(sum(estimate[:3]))
        rows.append([within(n, MOST_FORCE_N) for n in estimate[:3]] if estimate and known else [nan] * 3)
    return np.array(rows).T, session.lost


class _Fitted(Future[Contact | None]):
    """A fit that is late where the recorded one was: a host that was busy is no property of a version."""

    def __init__(self, session: "_Session") -> None:
        super().__init__()
        self._session = session

    def done(self) -> bool:
        return not self._session.fit_late


class _Session:
    """Prediction and identification of one axis of a run."""

    def __init__(self, run: Run, axis: str) -> None:
        limits, prior, model = _starting_point(run, axis)
        self.fit_late, self.lost = False, 0
        self._prediction = ForcePrediction(limits)
        learner = Learner(self._prediction.evaluator, prior, model, self._solve)
        self._task = IdentificationTask(self._prediction, learner)
        self._forces = {(force.session_id, force.sequence): force for force in run.messages(axis, FORCE)}
        self._reactions = {state.sequence: state.reaction_s for state in run.messages(axis, SLAVE_STATE)}
        self._waiting: deque[ForceSample | None] = deque()  # None: not recorded
        self._newest: ForceSample | None = None
        self._slave_state: int | None = None
        self._sequence = self._number = self._drained = 0

    def tick(self, sample: HapticSample, command: MotionCommand | None) -> Estimate | None:
        """Predicts one haptic sample anew from the forces that the recorded prediction knew; first runs the
        identification, if that used a new snapshot. None where the command was not recorded, or opens the
        gripper, which resets the prediction. Adds the number of missing messages to `lost`.
        """
        taken = [self._forces.get((sample.session_id, sequence)) for sequence in sample.forces]
        self.lost += taken.count(None) + (command is None) + sample.sequence - self._sequence - 1
        self._sequence = sample.sequence
        self._waiting.extend(taken)
        newest = sample.answered_sequence, sample.zoh_n
        self._newest = None if sample.zoh_n is None else self._newest
        for force in taken:
            if force is not None and force.valid and (force.answers_sequence, force.force_n) == newest:
                self._newest = force
        self._identify(sample)
        if sample.slave_state is not None and sample.slave_state != self._slave_state:
            self._slave_state = sample.slave_state
            if reaction_s := self._reactions.get(self._slave_state):
                self._prediction.setpoint.react(Reaction(*reaction_s))
            self.lost += reaction_s is None
        if command is None:
            return None
        if command.gripper is Grip.OPEN:
            self._prediction.reset()
            return None
        motion = command.stamp_ns, command.position_m, command.velocity_m_s, command.deadman
        return self._prediction.predict(*motion, self._task.snapshot, self._newest)

    def _identify(self, sample: HapticSample) -> None:
        """Runs the identification once with the waiting forces that the sample's snapshot newly contains,
        also where several runs made it; does nothing where the snapshot is the one before.
        """
        if sample.snapshot == self._number:
            return
        self._number, self.fit_late = sample.snapshot or 0, sample.fit_late
        while self._waiting and self._drained < sample.snapshot_forces:
            self._drained += 1
            if (force := self._waiting.popleft()) is not None:
                self._task.queue.put(force)
        self._task.run()

    def _solve(self, fit: Fit) -> Future[Contact | None]:
        future = _Fitted(self)
        future.set_result(fit(lambda: None))
        return future


def _starting_point(run: Run, axis: str) -> tuple[AxisLimits, ContactPrior | None, ContactModel | None]:
    """Limits on which both ends agreed; prior and model that the session started from, None without.

    Raises:
        RecordingError: no handshake, a prior or model that was not recorded, or one of them is damaged.
    """
    where, started = f"{run.path}: axis {axis}", run.metadata.get("run", {})
    handshake = next(run.messages(axis, MASTER_HANDSHAKE), None)
    if handshake is None:
        raise RecordingError(f"{where}: no handshake; expected one from the start on")
    first = next(run.messages(axis, PARAMETERS), None)
    origin, causes = (first.prior, first.model) if first else ("", ())
    expected = "is not in the recording; expected a session without one, or a recording of forefeel loopback"
    if origin and not origin.startswith("none") and PRIOR not in started:  # see `forefeel.master.prior.load`
        raise RecordingError(f"{where}: the prior it started from ({origin}) {expected}")
    if causes and MODEL not in started:
        raise RecordingError(f"{where}: the model.yaml it predicts with ({', '.join(causes)}) {expected}")
    try:
        shared = json.loads(handshake.settings)
        limits = json.dumps({name: shared[name] for name in AxisLimits.model_fields})
        prior = TypeAdapter(ContactPrior).validate_json(started[PRIOR]) if PRIOR in started else None
        model = ContactModel.from_mapping(json.loads(started[MODEL])) if MODEL in started else None
        return AxisLimits.model_validate_json(limits), prior, model
    except (ValueError, KeyError, TypeError) as error:
        reason = " ".join(str(error).split())[:200]
        raise RecordingError(f"{where}: limits, prior or model are damaged: {reason}") from error
