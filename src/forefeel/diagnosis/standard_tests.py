"""Two standard tests, of which less is learned than of strokes.

A step response: the force has a few levels, and the motion answers it. Of such a force nothing is learned as
a function of the motion: it is constant while the motion rings. The motion is simulated from the force
instead (output error; Ljung, System Identification, 2nd ed., 1999, section 4.2):

    x = x_0 + y / k + free decay,   y'' + 2 zeta w y' + w^2 y = w^2 f,   m = k / w^2,   b = 2 zeta w m

For w and zeta the rest is linear.

Ramps and holds, the relaxation test of tissue: the position stands while the force fades, or does not.

    f = k x + sum_i k_i q_i + f_0,   q_i' = x' - q_i / tau_i     (Maxwell branches)

That a force fades is no proof of it: a load cell that drifts fades, too. The fading over the hold, described
by a Prony series with times spread evenly in the logarithm and weights of one sign (non-negative least
squares), has to foretell the bins that it was not fitted to, and a straight line must not.

In both, shapes are searched and the rest is solved for (Golub and Pereyra, SIAM J. Numer. Anal. 10(2), 1973).
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, nnls
from scipy.signal import cont2discrete, lfilter

from forefeel.common.causes.candidate import Model
from forefeel.common.causes.motion import SettledLag
from forefeel.common.causes.numerics import intervals_s
from forefeel.common.causes.wall import StressRelaxation
from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.analysis import Analysis, fitted_elsewhere
from forefeel.diagnosis.identifiability import EXCITATION, turning_points
from forefeel.diagnosis.regression import BASE
from forefeel.diagnosis.sensor_faults import Cleaned, clean
from forefeel.diagnosis.uncertainty import gain_over
from forefeel.diagnosis.verdict import Cause, Diagnosis, HeldOut, Interval, ModelError, VerdictName

Columns = Callable[[Floats], Floats]
"""From the logarithms of the shapes to the columns, shape (n, linear parameters)."""

_STEP = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Separable:
    """Logarithms of the shapes, linear parameters, what is left, and the covariance of both, shapes first."""

    log_shape: Floats
    theta: Floats
    left: Floats
    covariance: Floats

    def doubts(self) -> Floats:
        """1.96 standard deviations of each, shapes first."""
        return np.asarray(1.96 * np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))


def separable(columns: Columns, target: Floats, starts: Iterable[Floats]) -> Separable:
    """Fits logarithms of shapes, from the best of several starts, and linear parameters to `target` by least
    squares; a start of length 0 has no shape. In the covariance neighbouring errors that are alike count as
    one.
    """

    def left(log_shape: Floats) -> Floats:
        table = columns(log_shape)
        if not np.isfinite(table).all():
            return target - np.mean(target)
        return np.asarray(target - table @ np.linalg.lstsq(table, target, rcond=None)[0])

    start = min(starts, key=lambda at: float(np.sum(left(at) ** 2)))
    log_shape = least_squares(left, start, x_scale=0.1, max_nfev=200).x if len(start) else start
    table = columns(log_shape)
    theta = np.linalg.lstsq(table, target, rcond=None)[0]
    rest = np.asarray(target - table @ theta)
    steps = _STEP * np.eye(len(log_shape))
    slopes = [(columns(log_shape + step) - table) @ theta / _STEP for step in steps]
    design = np.column_stack([*slopes, table])
    size = np.maximum(np.sqrt(np.sum(design**2, axis=0)), 1e-300)
    inverse = np.linalg.pinv((design / size).T @ (design / size)) / np.outer(size, size)
    covariance = _alike(rest) * float(np.mean(rest**2)) * inverse
    return Separable(np.asarray(log_shape), np.asarray(theta), rest, np.asarray(covariance))


def _alike(left: Floats) -> float:
    """Number of neighbours that count as one error: the sum of the autocorrelation up to its first zero."""
    power = np.abs(np.fft.rfft(left, 2 * len(left))) ** 2
    correlation = np.fft.irfft(power)[: len(left)]
    until = int(np.argmax(correlation <= 0.0)) or len(left)
    return max(1.0, 2.0 * float(np.sum(correlation[:until])) / max(float(correlation[0]), 1e-300) - 1.0)


_LEVELS, _OF_THE_SAMPLES = 4, 0.95
_RARELY = 0.02  # of the samples, at most, between which the force changes
_MOST_SAMPLES = 20_000
_FASTEST = 0.25  # of the sampling rate
_FREQUENCIES, _RATIOS = 24, (0.03, 0.1, 0.3, 0.7, 1.5, 4.0)
_UNKNOWN = 1.5  # of a logarithm, half of its interval: more is not told by the recording
_ANSWERS = 0.95  # of the variance of position and force, for the answer to be that of mass, damper and spring


@dataclass(frozen=True, slots=True)
class StepResponse:
    """Those of mass, damping and stiffness that show, with 95 % intervals; `sense` -1: the force pulls.

    `force_n`, `left_n`: standard deviation of the spring's force, and rms of what is left of it.
    """

    parameters: dict[str, Interval]
    sense: float
    force_n: float
    left_n: float


def diagnosed_step(recording: Recording) -> tuple[Diagnosis, Analysis] | None:
    """Diagnosis and analysis of a stepped force, by the mass, damper and spring that it moves; names no
    cause: `nothing_missing` if one of them shows and what is left is at most 5 % of the variance of position
    and force, else `unexplained`. None without steps.

    Raises:
        RecordingError: too few samples in a row.
    """
    force_n = recording.force_n
    assert force_n is not None
    if not _is_step(force_n):
        return None
    response = _response(recording)
    parameters, sense = response.parameters, response.sense
    known = [parameters[name].value if name in parameters else 0.0 for name in BASE]
    bias_n = float(np.mean(force_n) - sense * known[2] * np.mean(recording.position_m))
    model = {"bias": ()}, [*(sense * value for value in known), bias_n]
    nowhere = np.zeros(len(recording), dtype=np.bool_)
    cleaned = Cleaned(force_n, nowhere, nowhere)
    analysis = fitted_elsewhere(recording, cleaned, sense, model, model)
    bias = Interval.about(sense * bias_n, 0.0)
    error = ModelError.of(response.left_n, response.force_n, {"": parameters, "bias": {"force_n": bias}})
    held_out = HeldOut(response.left_n, response.left_n, 0.0, 0.0, 0.0)
    # free ringing beside hardly any answer to the force leaves little of the position, but not of the force
    least_n = min(response.force_n, float(np.std(force_n)))
    answers = bool(parameters) and response.left_n**2 < (1.0 - _ANSWERS) * least_n**2
    verdict: VerdictName = "nothing_missing" if answers else "unexplained"
    motion = None if answers else EXCITATION
    flags = (*analysis.flags(), "step_response")
    return Diagnosis(verdict, (), (), motion, flags, None, error, error, held_out), analysis


def _is_step(force_n: Floats) -> bool:
    """True if four levels hold nearly all samples of the force, and it hardly ever changes."""
    most = np.sort(np.unique(force_n, return_counts=True)[1])[-_LEVELS:].sum()
    changes = np.count_nonzero(np.diff(force_n))
    return bool(most > _OF_THE_SAMPLES * len(force_n) and changes < _RARELY * len(force_n))


def _response(recording: Recording) -> StepResponse:
    """Fits mass, damping and stiffness to the position as the answer to the force, which holds from each
    stamp to the next. Leaves out a parameter whose interval reaches a factor of exp(1.5) or more.
    """
    period_s, x, f = _evenly(recording)
    frequencies = np.geomspace(0.5 / (period_s * len(x)), _FASTEST / period_s, _FREQUENCIES)
    ringing = np.abs(np.fft.rfft(np.diff(x), 8 * len(x)))
    frequencies = np.append(frequencies, np.fft.rfftfreq(8 * len(x), period_s)[1 + np.argmax(ringing[1:])])
    starts = [np.log([2.0 * np.pi * hz, zeta]) for hz, zeta in product(frequencies, _RATIOS)]
    fit = separable(lambda shape: _columns(shape, f, period_s), x, starts)
    w, zeta = fit.log_shape
    gain = float(fit.theta[0]) or 1e-300
    logs = np.array([-2.0 * w, np.log(2.0) + zeta - w, 0.0]) - np.log(abs(gain))
    slopes = np.array([[-2.0, 0.0, -1.0 / gain], [-1.0, 1.0, -1.0 / gain], [0.0, 0.0, -1.0 / gain]])
    variance = np.einsum("ij,jk,ik->i", slopes, fit.covariance[:3, :3], slopes)
    doubts = np.minimum(1.96 * np.sqrt(variance), _UNKNOWN)
    parameters = {
        name: Interval(*map(float, np.exp([log, log - doubt, log + doubt])))
        for name, log, doubt in zip(BASE, logs, doubts, strict=True)
        if doubt < _UNKNOWN
    }
    force_n, left_n = (float(np.std(values)) / abs(gain) for values in (x, fit.left))
    return StepResponse(parameters, float(np.sign(gain)), force_n, left_n)


def _evenly(recording: Recording) -> tuple[float, Floats, Floats]:
    """(period in s, position, force) resampled evenly to at most 20,000 samples over the whole recording: the
    position interpolated, the force the last one that was set.
    """
    assert recording.force_n is not None
    t = recording.time_s
    count = min(len(t), _MOST_SAMPLES)
    even_s = np.linspace(t[0], t[-1], count)
    last = np.searchsorted(t, even_s + 1e-9 * (t[-1] - t[0]), side="right") - 1
    x = np.interp(even_s, t, recording.position_m)
    return float(even_s[1] - even_s[0]), x, np.asarray(recording.force_n[last])


def _columns(log_shape: Floats, f: Floats, period_s: float) -> Floats:
    """Columns of a position, shape (n, 4): answer to the force at a stiffness of 1, offset, and two free
    decays. `log_shape`: logarithms of the natural frequency in rad/s and the damping ratio.
    """
    w, zeta = np.exp(log_shape)
    numerator, denominator, _ = cont2discrete(([w * w], [1.0, 2.0 * zeta * w, w * w]), period_s)
    answer = lfilter(numerator[0], denominator, f - f[0]) + f[0]
    pulse = np.zeros_like(f)
    pulse[0] = 1.0
    decay = lfilter([1.0], denominator, pulse)
    later = np.concatenate([[0.0], decay[:-1]])
    return np.column_stack([answer, np.ones_like(f), decay, later])


_HELD, _SHORTEST, _STILL = 0.7, 0.1, 0.03  # of the samples: all holds, each; of the range, from its level
_STROKE, _MORE_TURNS = 0.2, 2  # of the range; beside one to each hold: back, and what overshoots
_TIMES, _BINS = 12, 40
_LEAST_FADE, _EARLY, _AT_ONCE = 0.05, 0.1, 0.2  # of the rise; first part of the hold; of the fading in it
_FOLLOWS, _FAR_BELOW = 0.05, 5.0  # left of the held-out bins' variance; times more that a line leaves
_SECOND = 0.9  # of what one branch leaves, that two leave at most
_NAMES = ("stiffness_n_m", "time_constant_s"), ("second_stiffness_n_m", "second_time_constant_s")


@dataclass(frozen=True, slots=True, eq=False)
class Hold:
    """Stamps from the start, position and force of ramps and holds.

    `before`, `run`: sample before the largest ramp, and the hold behind it; `others`: number of other holds.
    """

    t: Floats
    x: Floats
    f: Floats
    before: int
    run: slice
    others: int

    @property
    def sense(self) -> float:
        """Sign of the stiffness along the ramp: over the hold the force falls, whatever its sign."""
        ends = [self.before, self.run.start]
        return float(np.sign(np.prod(np.diff([self.x[ends], self.f[ends]])))) or 1.0

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
        """True if the force of the hold fades by 5 % of its rise or more, 20 % of that in the first tenth of
        the hold, and a Prony series, but no line, foretells held-out bins.
        """
        since_s, f, bins = self.since_s, self.f[self.run], self.bins
        count = np.bincount(bins)
        used = count > 0
        until_s, mean = (np.bincount(bins, values)[used] / count[used] for values in (since_s, f))
        rise = float(mean[0] - self.f[self.before])
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
        """Errors in N at each sample of the hold, of two fits with these relaxation times (logarithms), each
        to the rest of the test and every second bin of the hold, at the other bins.
        """
        table, left, odd = self.branches(log_times), np.empty_like(self.f), np.full(len(self.f), -1)
        odd[self.run] = self.bins % 2
        for fold in (0, 1):
            theta = np.linalg.lstsq(table[odd != fold], self.f[odd != fold], rcond=None)[0]
            left[odd == fold] = self.f[odd == fold] - table[odd == fold] @ theta
        return left[self.run]


def find_hold(recording: Recording) -> Hold | None:
    """Ramps and holds of a recording, thinned to 20,000 samples, with the hold behind the largest ramp
    marked; None unless over 70 % of the samples are holds, with at most two strokes more than holds.
    """
    assert recording.force_n is not None
    every = slice(None, None, 1 + len(recording) // _MOST_SAMPLES)
    t, x, f = (c[every] for c in (recording.time_s, recording.position_m, recording.force_n))
    runs = _still(x)
    strokes = len(turning_points(x.tolist(), _STROKE * float(np.ptp(x))))
    if sum(run.stop - run.start for run in runs) <= _HELD * len(x) or strokes > len(runs) + _MORE_TURNS:
        return None
    # before the first ramp is the first sample; a recording that begins with its only hold comes back
    before = [run.stop - 1 for run in runs[:-1]]
    before.insert(0, 0 if runs[0].start or before else -1)
    last, run = max(zip(before, runs, strict=True), key=lambda pair: abs(x[pair[1].start] - x[pair[0]]))
    return Hold(t - t[0], x, f, last, run, len(runs) - 1)


def _still(x: Floats) -> list[slice]:
    """Stretches, in turn, of a tenth of the samples or more within 3 % of the range about a level."""
    left, runs, reach_m = np.ones(len(x), dtype=np.bool_), list[slice](), _STILL * float(np.ptp(x))
    while left.any():
        count, ends_m = np.histogram(x[left], np.arange(x.min(), x.max() + 1.5 * reach_m, reach_m))
        level_m = np.median(x[left & (np.abs(x - ends_m[np.argmax(count)] - 0.5 * reach_m) <= 0.5 * reach_m)])
        still = left & (np.abs(x - level_m) < reach_m)
        edges = np.flatnonzero(np.diff(still, prepend=False, append=False))
        start, stop = max(zip(edges[::2], edges[1::2], strict=True), key=lambda run: run[1] - run[0])
        if stop - start < _SHORTEST * len(x):
            break
        left[start:stop] = False
        runs.append(slice(int(start), int(stop)))
    return sorted(runs, key=lambda run: run.start)


def diagnosed_hold(recording: Recording) -> tuple[Diagnosis, Analysis] | None:
    """Diagnosis and analysis of ramps and holds: `cause_found`, relaxation of one or two branches, or for a
    single hold without relaxation `nothing_found`. None where the recording is something else, or several
    holds without relaxation.

    Raises:
        RecordingError: too few samples in a row.
    """
    hold = find_hold(recording)
    if hold is None:
        return None
    (spring, one, two), sense = hold.fitted(), hold.sense
    better = np.sum(two.left**2) < _SECOND * np.sum(one.left**2)
    fit = two if better and _known(two, sense) else one  # a ramp that bends makes a second one of any sign
    relaxes = _known(fit, sense) and hold.relaxes()
    if hold.others and not relaxes:
        return None
    fit = fit if relaxes else spring
    before, after = (hold.held_out(model.log_shape) for model in (spring, fit))
    held_out = gain_over(hold.bins, before, after)
    models = _model_error(spring, before, hold, sense), _model_error(fit, after, hold, sense)
    causes = (_relaxation(fit, sense, held_out),) if relaxes else ()
    analysis = fitted_elsewhere(recording, clean(recording), sense, *map(_coefficients, (spring, fit)))
    verdict: VerdictName = "cause_found" if relaxes else "nothing_found"
    motion, flags = None if relaxes else EXCITATION, (*analysis.flags(), "ramp_and_hold")
    return Diagnosis(verdict, causes, (), motion, flags, None, *models, held_out), analysis


def _known(fit: Separable, sense: float) -> bool:
    """True if each branch is stiffer than its doubt."""
    return bool(np.all(sense * fit.theta[2:] > fit.doubts()[len(fit.log_shape) + 2 :]))


def _coefficients(fit: Separable) -> tuple[Model, list[float]]:
    """Model of a fit, and the coefficients in turn: mass, damping, stiffness, bias, of each branch stiffness
    and 0 for what an earlier stroke left.
    """
    shape = tuple(map(float, np.exp(fit.log_shape)))
    name = "stress_relaxation:two" if len(shape) == 2 else StressRelaxation.name
    branches = [value for size in fit.theta[2:] for value in (size, 0.0)]
    return {"bias": (), **({name: shape} if shape else {})}, [0.0, 0.0, *fit.theta[:2], *branches]


def _relaxation(fit: Separable, sense: float, held_out: HeldOut) -> Cause:
    """Stress relaxation as a cause: stiffness and time constant of each branch, with 95 % intervals, and its
    held-out gain. `sense` -1 turns the stiffnesses' sign.
    """
    doubts, count = fit.doubts(), len(fit.log_shape)
    parameters = {}
    for i, (stiffness, time) in enumerate(_NAMES[:count]):
        parameters[stiffness] = Interval.about(sense * fit.theta[2 + i], doubts[count + 2 + i])
        ends = np.exp(fit.log_shape[i] + doubts[i] * np.array([0.0, -1.0, 1.0]))
        parameters[time] = Interval(*map(float, ends))
    words = "the force of the hold fades as a Prony series that foretells every second part of it"
    return Cause.fitted(StressRelaxation.name, parameters, 0.0, held_out, words)


def _model_error(fit: Separable, errors: Floats, hold: Hold, sense: float) -> ModelError:
    """Error of a fit by its held-out `errors` in N, with stiffness and bias and their 95 % intervals;
    parameters of branches are left out. `sense` -1 turns their sign.
    """
    stiffness, bias = (
        Interval.about(sense * fit.theta[i], fit.doubts()[len(fit.log_shape) + i]) for i in (0, 1)
    )
    rms_n = float(np.sqrt(np.mean(errors**2)))
    parameters = {"": {"stiffness_n_m": stiffness}, "bias": {"force_n": bias}}
    return ModelError.of(rms_n, float(np.std(hold.f)), parameters)


def _left_of_held_out(table: Floats, fading: Floats) -> float:
    """Share of the variance of every second bin that a non-negative fit to the other bins leaves."""
    columns = np.column_stack([np.ones(len(table)), -np.ones(len(table)), table])
    theta, _ = nnls(columns[::2], fading[::2])
    rest = fading[1::2]
    return float(np.mean((rest - columns[1::2] @ theta) ** 2) / max(np.var(rest), 1e-300))
