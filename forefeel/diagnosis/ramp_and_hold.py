"""A ramp and hold, the relaxation test of tissue: the position stands while the force fades, or does not.

    f = k x + sum_i k_i q_i + f_0,   q_i' = x' - q_i / tau_i     (Maxwell branches)

That a force fades is no proof of it: a load cell that drifts fades, too. The fading over the hold, described
by a Prony series with times spread evenly in the logarithm and weights of one sign (non-negative least
squares), has to foretell the bins that it was not fitted to, and a straight line must not.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from forefeel.common.causes.candidate import Model
from forefeel.common.causes.motion import SettledLag
from forefeel.common.causes.numerics import intervals_s
from forefeel.common.causes.wall import StressRelaxation
from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.analysis import Analysis, fitted_elsewhere
from forefeel.diagnosis.held_out import gain_over
from forefeel.diagnosis.identifiability import GENERAL_MOTION, turning_points
from forefeel.diagnosis.sensor_faults import clean
from forefeel.diagnosis.separable import Separable, separable
from forefeel.diagnosis.verdict import Cause, Diagnosis, HeldOut, Interval, ModelError, VerdictName

FLAG = "ramp_and_hold"
_HELD, _STILL = 0.7, 0.03  # of the samples in one run, within so much of the range from the median
_STROKE, _MOST_TURNS = 0.2, 3  # of the range; to the hold, back, and what overshoots
_MOST_SAMPLES = 20_000
_TIMES, _BINS = 12, 40
_LEAST_FADE, _EARLY, _AT_ONCE = 0.05, 0.1, 0.3  # of the rise; first part of the hold; of the fading in it
_FOLLOWS, _FAR_BELOW = 0.05, 5.0  # left of the held-out bins' variance; times more that a line leaves
_SECOND = 0.9  # of what one branch leaves, that two leave at most
_NAMES = ("stiffness_n_m", "time_constant_s"), ("second_stiffness_n_m", "second_time_constant_s")


@dataclass(frozen=True, slots=True, eq=False)
class Hold:
    """Stamps from the start, position and force of a ramp and hold, and which samples are the hold."""

    t: Floats
    x: Floats
    f: Floats
    run: slice

    def branches(self, log_times: Floats) -> Floats:
        """Columns of k, f_0 and each branch."""
        decays = [np.exp(-intervals_s(self.t) / tau) for tau in np.exp(log_times)]
        springs = [self.x - SettledLag.run(self.x, decay) for decay in decays]
        return np.column_stack([self.x, np.ones_like(self.x), *springs])

    @property
    def since_s(self) -> Floats:
        return np.asarray(self.t[self.run] - self.t[self.run.start])

    @property
    def bins(self) -> NDArray[np.int64]:
        """Bin of each sample of the hold, even in the logarithm of the time since it began."""
        since_s = self.since_s
        first_s = max(float(since_s[min(3, len(since_s) - 1)]), 1e-3 * float(since_s[-1]))
        edges_s = np.geomspace(first_s, since_s[-1], _BINS)[:-1]
        return np.asarray(np.searchsorted(edges_s, since_s, side="right"))

    def fitted(self) -> list[Separable]:
        """Fits of a spring with no, one and two branches."""
        times = np.log(np.geomspace(4.0 * np.median(np.diff(self.t)), 0.5 * self.since_s[-1], _TIMES))
        starts = [list(map(np.array, combinations(times, count))) for count in range(3)]
        return [separable(self.branches, self.f, points) for points in starts]

    def relaxes(self) -> bool:
        """True if the force fades early and much, as a Prony series and not as a line."""
        since_s, f, bins = self.since_s, self.f[self.run], self.bins
        count = np.bincount(bins)
        used = count > 0
        until_s, mean = (np.bincount(bins, values)[used] / count[used] for values in (since_s, f))
        rise = float(mean[0]) - float(self.f[0] if self.run.start else f[0])
        fading = (mean[0] - mean) * np.sign(rise)
        early = float(np.interp(_EARLY * since_s[-1], until_s, fading))
        if fading[-1] < _LEAST_FADE * abs(rise) or early < _AT_ONCE * fading[-1]:
            return False
        times = np.geomspace(max(until_s[0], 1e-9), since_s[-1], _TIMES)
        prony, line = (
            _left_of_held_out(table, fading)
            for table in (1.0 - np.exp(-until_s[:, None] / times), until_s[:, None])
        )
        return prony < _FOLLOWS and line > _FAR_BELOW * prony

    def held_out(self, log_times: Floats) -> Floats:
        """Errors over the hold of two fits, each to the ramp and every second bin, at the other bins."""
        table, left, odd = self.branches(log_times), np.empty_like(self.f), np.full(len(self.f), -1)
        odd[self.run] = self.bins % 2
        for fold in (0, 1):
            theta = np.linalg.lstsq(table[odd != fold], self.f[odd != fold], rcond=None)[0]
            left[odd == fold] = self.f[odd == fold] - table[odd == fold] @ theta
        return left[self.run]


def find_hold(recording: Recording) -> Hold | None:
    """The ramp and hold that a recording is; None where it is none."""
    assert recording.force_n is not None
    every = slice(None, None, 1 + len(recording) // _MOST_SAMPLES)
    t, x, f = (c[every] for c in (recording.time_s, recording.position_m, recording.force_n))
    still = np.abs(x - np.median(x)) < _STILL * np.ptp(x)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(np.int8), [0]])))
    start, stop = max(zip(edges[::2], edges[1::2], strict=True), key=lambda run: run[1] - run[0])
    if stop - start <= _HELD * len(x):
        return None
    if len(turning_points(x.tolist(), _STROKE * float(np.ptp(x)))) > _MOST_TURNS:
        return None
    return Hold(t - t[0], x, f, slice(int(start), int(stop)))


def diagnosed_hold(recording: Recording) -> tuple[Diagnosis, Analysis] | None:
    """Diagnosis of a ramp and hold, which names relaxation or nothing. None where the recording is none.

    Raises:
        RecordingError: too few samples in a row.
    """
    hold = find_hold(recording)
    if hold is None:
        return None
    spring, one, two = hold.fitted()
    sense = float(np.sign(spring.theta[0])) or 1.0
    better = np.sum(two.left**2) < _SECOND * np.sum(one.left**2)
    fit = two if better and _known(two, sense) else one  # a ramp that bends makes a second one of any sign
    relaxes = _known(fit, sense) and hold.relaxes()
    fit = fit if relaxes else spring
    before, after = (hold.held_out(model.log_shape) for model in (spring, fit))
    held_out = gain_over(hold.bins, before, after)
    models = _model_error(spring, before, hold, sense), _model_error(fit, after, hold, sense)
    causes = (_relaxation(fit, sense, held_out),) if relaxes else ()
    analysis = fitted_elsewhere(recording, clean(recording), sense, *map(_coefficients, (spring, fit)))
    verdict: VerdictName = "cause_found" if relaxes else "nothing_found"
    motion, flags = None if relaxes else GENERAL_MOTION, (*analysis.flags(), FLAG)
    return Diagnosis(verdict, causes, (), motion, flags, None, *models, held_out), analysis


def _known(fit: Separable, sense: float) -> bool:
    """True if each branch is stiffer than its doubt."""
    return bool(np.all(sense * fit.theta[2:] > fit.doubts()[len(fit.log_shape) + 2 :]))


def _coefficients(fit: Separable) -> tuple[Model, list[float]]:
    """Model, and its mass, damping, stiffness, bias and each branch with nothing of an earlier stroke."""
    shape = tuple(map(float, np.exp(fit.log_shape)))
    name = "stress_relaxation:two" if len(shape) == 2 else StressRelaxation.name
    branches = [value for size in fit.theta[2:] for value in (size, 0.0)]
    return {"bias": (), **({name: shape} if shape else {})}, [0.0, 0.0, *fit.theta[:2], *branches]


def _relaxation(fit: Separable, sense: float, held_out: HeldOut) -> Cause:
    doubts, count = fit.doubts(), len(fit.log_shape)
    parameters = {}
    for i, (stiffness, time) in enumerate(_NAMES[:count]):
        parameters[stiffness] = Interval.about(sense * fit.theta[2 + i], doubts[count + 2 + i])
        ends = np.exp(fit.log_shape[i] + doubts[i] * np.array([0.0, -1.0, 1.0]))
        parameters[time] = Interval(*map(float, ends))
    words = "the force of the hold fades as a Prony series that foretells every second part of it"
    return Cause.fitted(StressRelaxation.name, parameters, 0.0, held_out, words)


def _model_error(fit: Separable, errors: Floats, hold: Hold, sense: float) -> ModelError:
    stiffness, bias = (
        Interval.about(sense * fit.theta[i], fit.doubts()[len(fit.log_shape) + i]) for i in (0, 1)
    )
    rms_n = float(np.sqrt(np.mean(errors**2)))
    parameters = {"": {"stiffness_n_m": stiffness}, "bias": {"force_n": bias}}
    return ModelError.of(rms_n, float(np.std(hold.f)), parameters)


def _left_of_held_out(table: Floats, fading: Floats) -> float:
    """Share of the variance of every second bin that a fit to the others leaves; the start is free."""
    columns = np.column_stack([np.ones(len(table)), -np.ones(len(table)), table])
    theta, _ = nnls(columns[::2], fading[::2])
    rest = fading[1::2]
    return float(np.mean((rest - columns[1::2] @ theta) ** 2) / max(np.var(rest), 1e-300))
