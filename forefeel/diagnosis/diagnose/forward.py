"""Forward simulation: the position that the found model gives for the measured force.

`m x'' + b x' + k x + effects = f` is solved for x (forward_kernel.py). Equation error weighs the force; a
position that is simulated over minutes asks for more, so the found structure's parameters are refined by
output error (Ljung, System Identification, 2nd ed., 10.2; initial states are parameters, too). Between its
samples the force is straight, held, or band-limited (Pintelon and Schoukens, System Identification, 2nd ed.,
13.2): what fits the recording best is used.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, cast, get_args

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.interpolate import Akima1DInterpolator
from scipy.optimize import least_squares

from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose.analysis import Analysis
from forefeel.diagnosis.diagnose.forward_model import ForwardModel
from forefeel.diagnosis.diagnose.regression import ModelFit

Between = Literal["band_limited", "straight", "held"]
"""What the force does between two of its samples."""

INITIAL = 50
"""Samples at the start of each stretch that are not scored: the convention of nonlinearbenchmark.org."""

STEPS_PER_SAMPLE = 4
_LEAST = 4 * INITIAL
_SLOPE = 9
_PROBE, _MOST = 4_000, 30_000
_BELIEVABLE = 20.0
_EDGE = 400
_RAN_AWAY = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """One gapless stretch, evenly sampled: start and period in s, position in m.

    `steps`: the force that resists in N at both ends of every step, shape (steps, 2).
    """

    start_s: float
    period_s: float
    position_m: Floats
    steps: Floats

    def cut(self, count: int) -> "Drive":
        """Its first `count` samples."""
        steps = self.steps[: (count - 1) * STEPS_PER_SAMPLE]
        return replace(self, position_m=self.position_m[:count], steps=steps)

    def state(self) -> Floats:
        """Position and speed at the start, the speed by a straight line through the first samples."""
        x = self.position_m[:_SLOPE]
        return np.array([x[0], np.polyfit(np.arange(len(x)) * self.period_s, x, 1)[0]])


def drives(
    recording: Recording, force_n: Floats, sense: float, between: Between, origin_s: float | None = None
) -> list[Drive]:
    """The stretches of a recording of at least 200 samples, time from `origin_s` or else its first stamp.

    Args:
        recording: position and stamps.
        force_n: cleaned, same stamps.
        sense: +1 when a positive force resists insertion, -1 when it is the reaction.
        between: what the force does between its samples.
    """
    found = []
    for piece in recording.segments(max(0.1, 3.5 / recording.rate_hz)):
        if piece.stop - piece.start >= _LEAST:
            time_s = recording.time_s[piece] - (recording.time_s[0] if origin_s is None else origin_s)
            period_s, (x, f) = even(time_s, recording.position_m[piece], force_n[piece])
            found.append(Drive(float(time_s[0]), period_s, x, _steps(sense * f, between)))
    return found


def even(time_s: Floats, *columns: Floats) -> tuple[float, tuple[Floats, ...]]:
    """The period in s, and the columns evenly sampled; stamps that are even up to their rounding stay."""
    period_s = float(time_s[-1] - time_s[0]) / (len(time_s) - 1)
    grid = time_s[0] + period_s * np.arange(len(time_s))
    if np.max(np.abs(grid - time_s)) < 0.05 * period_s:
        return period_s, columns
    period_s = float(np.median(np.diff(time_s)))
    grid = np.arange(time_s[0], time_s[-1], period_s)
    return period_s, tuple(Akima1DInterpolator(time_s, column)(grid) for column in columns)


def simulate(model: ForwardModel, drive: Drive, state: Floats | None = None) -> Floats:
    """The position at every sample in m, inf from where it ran away.

    `state`: position and speed at the start; by default as measured.
    """
    begin = drive.state() if state is None else state
    most = _BELIEVABLE * float(np.max(np.abs(drive.position_m)))
    step_s = drive.period_s / STEPS_PER_SAMPLE
    return model.run(drive.steps, drive.start_s, step_s, STEPS_PER_SAMPLE, begin, most)


def rmse_m(model: ForwardModel, over: Sequence[Drive]) -> float | None:
    """rms of simulated less measured position from the 51st sample of each stretch on; None if unstable."""
    errors = [(simulate(model, drive) - drive.position_m)[INITIAL:] for drive in over]
    rms = float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
    return rms if np.isfinite(rms) else None


def refined(model: ForwardModel, over: Sequence[Drive], most: int = _MOST) -> ForwardModel:
    """The model with the parameters of least output error over the longest stretch, up to `most` samples.

    An offset of the force takes part even where no bias was named: a position that is simulated for a minute
    shows one that the noise of the force hides (the published models of the Silverbox have one, too).
    """
    drive, model = longest(over).cut(most), model.with_offset()
    usual, force = float(np.std(drive.position_m)), float(np.std(drive.steps))
    speed = float(np.std(np.diff(drive.position_m))) / drive.period_s
    size = np.where(model.theta == 0.0, force, np.abs(model.theta))
    scale = np.concatenate([size, [usual, speed]])

    def errors(q: Floats) -> Floats:
        values = q * scale
        off = simulate(model.with_theta(values[:-2]), drive, values[-2:]) - drive.position_m
        return np.clip(off / usual, -_RAN_AWAY, _RAN_AWAY)

    start = np.concatenate([model.theta, drive.state()]) / scale
    solved = least_squares(errors, start, x_scale="jac", max_nfev=25, ftol=1e-3, xtol=1e-4)
    return model.with_theta((solved.x * scale)[:-2])


def longest(over: Sequence[Drive]) -> Drive:
    """The stretch with most samples."""
    return max(over, key=lambda drive: len(drive.position_m))


def between_samples(model: ForwardModel, recording: Recording, force_n: Floats, sense: float) -> Between:
    """What the force does between its samples: that with the least output error on a first part."""

    def left(between: Between) -> float:
        part = [longest(drives(recording, force_n, sense, between)).cut(_PROBE)]
        found = rmse_m(refined(model, part), part)
        return np.inf if found is None else found

    return min(cast(tuple[Between, ...], get_args(Between)), key=left)


def forward_rmse(analysis: Analysis, driven: bool) -> dict[str, float | None]:
    """`before_m` of mass, damper and spring, `after_m` of the extended model, on the recording itself.

    Each is refined by output error first. None where a simulation from the force makes no sense: the motion
    is not driven by the force, the mass is not positive or not identified, the model runs away, or an effect
    can not be turned round (see `ForwardModel.of`).
    """
    none: dict[str, float | None] = {"before_m": None, "after_m": None}
    if not driven:
        return none
    regression = analysis.regression
    measured = analysis.recording, analysis.cleaned.force_n, regression.sense
    models = {"before_m": _model(analysis, regression.fit({})), "after_m": _model(analysis, analysis.fit)}
    known = [model for model in models.values() if model is not None]
    if not known or not drives(*measured, "straight"):
        return none
    between = between_samples(known[-1], *measured)
    over = drives(*measured, between, regression.signals.origin_s)
    return {key: None if m is None else rmse_m(refined(m, over), over) for key, m in models.items()}


def _model(analysis: Analysis, fit: ModelFit) -> ForwardModel | None:
    clipped = bool(analysis.cleaned.clipped.any())
    return None if clipped else ForwardModel.of(analysis.regression, fit)


def _steps(force: Floats, between: Between) -> Floats:
    n = STEPS_PER_SAMPLE
    if between == "held":
        return np.repeat(force[:-1], n)[:, None] * np.ones(2)
    if between == "straight":
        force = np.interp(np.arange((len(force) - 1) * n + 1) / n, np.arange(len(force)), force)
    else:
        force = _finer(force, n)
    return np.column_stack([force[:-1], force[1:]])


def _finer(values: Floats, times: int) -> Floats:
    """Band-limited interpolation; prolonged by reflection in the end points, so that the ends stay smooth."""
    edge = min(_EDGE, len(values) - 1)
    first = 2.0 * values[0] - values[edge:0:-1]
    last = 2.0 * values[-1] - values[-2 : -edge - 2 : -1]
    whole = np.concatenate([first, values, last])
    length = next_fast_len(len(whole), real=True)
    way = np.linspace(0.0, 1.0, length - len(whole) + 2)[1:-1]
    whole = np.concatenate([whole, whole[-1] + (whole[0] - whole[-1]) * way])
    spectrum = rfft(whole)
    finer = irfft(spectrum, length * times) * times
    return np.asarray(finer[edge * times : (edge + len(values) - 1) * times + 1])
