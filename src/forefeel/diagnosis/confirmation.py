"""The model of one recording held against another of the same bench, which no fit has seen.

Mass, damping, stiffness, causes and shapes stay; free on the other recording are the zero of the cell and
what a cause holds for its own run only (slope, phases, instant). What the model leaves there is compared with

    e^2 = noise^2 + structure^2 (force there / force here)^2

noise: of the other recording; structure: what the model left here beside its noise, which grows with the
force. By |J d|^2, the error of the parameters along the other motion, less was told here.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from forefeel.common.causes.candidate import base_name
from forefeel.common.causes.wall import StiffnessChange
from forefeel.common.error_size import Floats, rms
from forefeel.common.errors import RecordingError
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.analysis import Analysis, changing_force, in_band_n
from forefeel.diagnosis.diagnose import Diagnosed, check
from forefeel.diagnosis.expected_gain import less_own, noise_share, parameter_errors, powers
from forefeel.diagnosis.long_recording import is_long, liveliest, stretch_s
from forefeel.diagnosis.noise import noise_floor
from forefeel.diagnosis.regression import ModelFit, RecordingRegression
from forefeel.diagnosis.residual import predictable_share
from forefeel.diagnosis.signals import Signals
from forefeel.diagnosis.uncertainty import WIDER, gain
from forefeel.diagnosis.verdict import Diagnosis, HeldOut

ConfirmationName = Literal["confirmed", "not_confirmed", "not_told"]
_MOST, _MUCH_LESS = 1.6, 0.6
"""Times `expected_n` that a model which holds leaves at most and at least: docs/explanation/naming.md."""
_WIDEST = 0.495  # band of the sampling rate, at most
_DOUBT, _INSTANTS = 0.95, 32  # quantile of |J d|; tried for a change of stiffness
_FORETOLD, _OF_NOISE = 0.3, 2.0  # share that its own past foretells, and times the noise: structure


@dataclass(frozen=True, slots=True)
class Confirmation:
    """Rms errors in N that the model of a diagnosis leaves on another recording, and the verdict on it.

    Attributes:
        recording: name of the other recording.
        left_n: rms that the model leaves there; `expected_n`: by what it left here; `ratio`: of the two.
        doubt_n: rms there that the intervals of its parameters allow beside; `noise_n`: at most, there.
        gain: of the causes there, over the simulation with the same freedoms; None without any.
        cautions: where confirmed, `easier` (less is left than expected), `structure` (more than noise is).
    """

    recording: str
    verdict: ConfirmationName
    left_n: float
    expected_n: float
    ratio: float
    doubt_n: float
    noise_n: float | None
    gain: HeldOut | None
    cautions: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Replay:
    """Stamps in s, and forces in N in the band of the comparison, of the other recording; `of`: the diagnosis
    whose model it is.
    """

    of: Diagnosis
    confirmation: Confirmation
    t: Floats
    force_n: Floats
    simulated_n: Floats
    extended_n: Floats


def confirm(diagnosed: Diagnosed, recording: Recording) -> Replay:
    """Replays the model of a diagnosis (where it names no cause, the simulation) on another recording, of a
    long one on its liveliest stretch, and compares the rms it leaves with the expected one.

    The verdict is `confirmed` up to 1.6 times that; beyond it `not_told` where the uncertainty of the
    parameters explains the excess, else `not_confirmed`. It is always `not_told` where something is missing
    of which the diagnosis names no cause.

    Raises:
        RecordingError: the recording can not be diagnosed, see `check` and `changing_force`, lacks a column
            that the model follows, or has a lower rate than the band of the diagnosis needs.
    """
    check(recording)
    diagnosis, analysis, name = diagnosed.diagnosis, diagnosed.analysis, recording.name
    analysis = analysis if diagnosis.causes else analysis.baseline()
    if is_long(recording):
        recording = recording.cut(liveliest(recording, stretch_s(recording)))
    _require_columns(recording, analysis)
    here, cutoff_hz = analysis.regression, analysis.regression.signals.cutoff_hz
    cleaned = changing_force(recording, diagnosis.causes)
    if recording.rate_hz < (least_hz := cutoff_hz / _WIDEST):
        place = f"{recording.source}: {recording.rate_hz:.4g} Hz"
        raise RecordingError(f"{place}, expected at least {least_hz:.4g} Hz for the band of the diagnosis")
    void = cleaned.clipped | cleaned.spikes
    there = here.like(Signals(recording, cleaned.force_n, cutoff_hz, void))
    rows, force_n = there.rows, there.signals.force[there.rows]
    base, fit = analysis.base, _with_change_moved(there, analysis.fit)
    before_n, after_n = less_own(there, fit, np.stack([there.residual(base), there.residual(fit)], 1)).T
    errors = parameter_errors(here, analysis.fit, np.random.default_rng(0))
    doubt_n = WIDER * float(np.sqrt(np.quantile(powers(there, base, fit, errors)[0], _DOUBT)))
    floor, left_n = noise_floor(recording, cleaned.force_n, cleaned.clipped), rms(after_n)
    noise_n = None if floor is None else min(in_band_n(floor, there.signals), left_n)
    here_n, share = diagnosis.held_out.rmse_after_n, noise_share(diagnosis, analysis)
    beside_n = noise_n if noise_n and diagnosis.noise_floor_n is not None else np.sqrt(share) * here_n
    larger = float(np.std(force_n) / np.std(here.signals.force[here.rows]))
    expected_n = float(np.hypot(beside_n, np.sqrt(1.0 - share) * larger * here_n))
    verdict: ConfirmationName = "confirmed"
    if not diagnosis.has_a_model:
        verdict = "not_told"
    elif left_n > _MOST * expected_n:
        verdict = "not_told" if left_n < np.hypot(_MOST * expected_n, doubt_n) else "not_confirmed"
    left = np.zeros(len(rows))
    left[rows] = after_n
    remembers = floor is not None and floor.slope == 0.0 and predictable_share(there, left) > _FORETOLD
    structured = remembers or (noise_n is not None and left_n > _OF_NOISE * noise_n)
    cautions = {"easier": left_n < _MUCH_LESS * expected_n, "structure": structured}
    confirmation = Confirmation(
        name, verdict, left_n, expected_n, left_n / max(expected_n, 1e-300), doubt_n, noise_n,
        gain(there, before_n, after_n) if set(fit.model) - {"bias"} else None,
        tuple(caution for caution, true in cautions.items() if true and verdict == "confirmed"),
    )  # fmt: skip
    t = there.signals.t[rows]
    return Replay(diagnosis, confirmation, t, force_n, force_n - before_n, force_n - after_n)


def _require_columns(recording: Recording, analysis: Analysis) -> None:
    """Raises RecordingError where the model follows a column that the recording lacks."""
    names = map(analysis.regression.column_of, analysis.fit.model)
    for name in set(names) - {"", *(column.name for column in recording.further)}:
        raise RecordingError(
            f"{recording.source}: no column {name!r}, expected the one that the model follows"
        )


def _with_change_moved(there: RecordingRegression, fit: ModelFit) -> ModelFit:
    """Copy of the fit with its change of stiffness moved to the instant that leaves the smallest rms error
    in `there`, -inf for one before its start; coefficients stay. The fit itself if it has no such change.
    """
    for name in [name for name in fit.model if base_name(name) == StiffnessChange.name]:
        low, high = there.signals.t[[0, -1]].tolist()
        for _ in range(3):  # from a 32nd of the recording to a 4000th
            instants = [-np.inf, *np.linspace(low, high, _INSTANTS).tolist()]
            fits = [replace(fit, model={**fit.model, name: (at,)}) for at in instants]
            fit = min(fits, key=lambda at: rms(less_own(there, at, there.residual(at)[:, None])))
            (at,), step = fit.model[name], (high - low) / _INSTANTS
            low, high = max(at, low) - step, max(at, low) + step
    return fit
