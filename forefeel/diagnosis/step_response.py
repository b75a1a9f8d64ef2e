"""A step response: the force has a few levels, and the motion answers it.

Of such a force nothing is learned as a function of the motion: it is constant while the motion rings. The
motion is simulated from the force instead (output error; Ljung, System Identification, 2nd ed., 1999, section
4.2):

    x = x_0 + y / k + free decay,   y'' + 2 zeta w y' + w^2 y = w^2 f,   m = k / w^2,   b = 2 zeta w m

For w and zeta the rest is linear.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.signal import cont2discrete, lfilter

from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.analysis import Analysis, fitted_elsewhere
from forefeel.diagnosis.identifiability import GENERAL_MOTION
from forefeel.diagnosis.regression import BASE
from forefeel.diagnosis.sensor_faults import Cleaned
from forefeel.diagnosis.separable import separable
from forefeel.diagnosis.verdict import Diagnosis, HeldOut, Interval, ModelError, VerdictName

_LEVELS, _OF_THE_SAMPLES = 4, 0.95
_RARELY = 0.02  # of the samples, at most, between which the force changes
_MOST_SAMPLES = 20_000
_FASTEST = 0.25  # of the sampling rate
_FREQUENCIES, _RATIOS = 24, (0.03, 0.1, 0.3, 0.7, 1.5, 4.0)
_UNKNOWN = 1.5  # of a logarithm, half of its interval: more is not told by the recording
_ANSWERS = 0.95  # of the position's variance, for the answer to be that of mass, damper and spring
FLAG = "step_response"


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
    """Diagnosis of a stepped force by the mass on a spring that it moves; names no cause. None without steps.

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
    error = ModelError.of(response.left_n, response.force_n, {"": parameters})
    held_out = HeldOut(response.left_n, response.left_n, 0.0, 0.0, 0.0)
    answers = 1.0 - (response.left_n / response.force_n) ** 2 > _ANSWERS
    verdict: VerdictName = "nothing_missing" if answers else "unexplained"
    motion = None if answers else GENERAL_MOTION
    flags = (*analysis.flags(), FLAG)
    return Diagnosis(verdict, (), (), motion, flags, None, error, error, held_out), analysis


def _is_step(force_n: Floats) -> bool:
    """True if four levels hold nearly all samples of the force, and it hardly ever changes."""
    most = np.sort(np.unique(force_n, return_counts=True)[1])[-_LEVELS:].sum()
    changes = np.count_nonzero(np.diff(force_n))
    return bool(most > _OF_THE_SAMPLES * len(force_n) and changes < _RARELY * len(force_n))


def _response(recording: Recording) -> StepResponse:
    """The linear system that answers the force best; the force holds from each stamp to the next."""
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
    """Period in s, position and force; the force is the last one that was set."""
    assert recording.force_n is not None
    t = recording.time_s
    count = min(len(t), _MOST_SAMPLES)
    even_s = np.linspace(t[0], t[-1], count)
    last = np.searchsorted(t, even_s + 1e-9 * (t[-1] - t[0]), side="right") - 1
    x = np.interp(even_s, t, recording.position_m)
    return float(even_s[1] - even_s[0]), x, np.asarray(recording.force_n[last])


def _columns(log_shape: Floats, f: Floats, period_s: float) -> Floats:
    """Answer to the force, offset, and two free decays, shape (n, 4)."""
    w, zeta = np.exp(log_shape)
    numerator, denominator, _ = cont2discrete(([w * w], [1.0, 2.0 * zeta * w, w * w]), period_s)
    answer = lfilter(numerator[0], denominator, f - f[0]) + f[0]
    pulse = np.zeros_like(f)
    pulse[0] = 1.0
    decay = lfilter([1.0], denominator, pulse)
    later = np.concatenate([[0.0], decay[:-1]])
    return np.column_stack([answer, np.ones_like(f), decay, later])
