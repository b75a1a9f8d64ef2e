"""The diagnosis of one recording: what is named, and with how much trust."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from common.effects.model import ContactModel
from common.errors import RecordingError
from common.recording.recording import Recording
from diagnosis.diagnose.analysis import Analysis, analyse
from diagnosis.diagnose.band import acceleration_noise_m_s2
from diagnosis.diagnose.blocks import Gain, gain, held_out_errors
from diagnosis.diagnose.candidates import base_name
from diagnosis.diagnose.driven import with_driving
from diagnosis.diagnose.faults import Fault
from diagnosis.diagnose.flexible import flexible_gain
from diagnosis.diagnose.identifiability import (
    GENERAL_MOTION,
    RIVALS_AT_CONSTANT_SPEED,
    motion_kind,
    rivals_of_a_line,
    separating_motion,
)
from diagnosis.diagnose.long import analyse_long, diagnose_long, is_long
from diagnosis.diagnose.parameters import intervals
from diagnosis.diagnose.regression import Fit
from diagnosis.diagnose.structure import foretold_share, noise_cap_n
from diagnosis.diagnose.third_party import fingerprint, take_in
from diagnosis.diagnose.verdict import Cause, Diagnosis, Evidence, HeldOut, Interval, Stage

LEAST_S = 3.0
_LEAST_GAIN_OF_FLOOR = 0.01
_RIVAL = 6.0
_FORETOLD = 0.3
_STRUCTURE = 0.12
_FLEXIBLE = 0.1
_BEYOND_CAP = 2.0
_OF_FORCE = 0.02

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosed:
    """The verdict, and the analysis that it rests on (None: the motion told nothing)."""

    diagnosis: Diagnosis
    analysis: Analysis


def diagnose(
    recording: Recording, progress: Progress = lambda stage: None, given: ContactModel | None = None
) -> Diagnosed:
    """What the mass-damper-spring simulation of a recording gets wrong.

    Args:
        recording: position and force.
        progress: is told the stage before it starts.
        given: the simulation to compare with, in place of a fitted mass, damper and spring.

    Raises:
        RecordingError: no force, too short, no motion, a force that never changes, too few samples in a row.
    """
    check(recording)
    take_in()
    try:
        whole = analyse_long(recording, progress) if is_long(recording) else None
        analysis = analyse(recording, progress) if whole is None else whole.analysis
    except ValueError as error:
        raise RecordingError(f"{recording.source}: {error}") from error
    progress("trust")
    if whole is None:
        found = _Judge(analysis).diagnosis()
    else:
        found, analysis = diagnose_long(whole, lambda part: _Judge(part).diagnosis())
    found = with_driving(found, analysis)
    return Diagnosed(found if given is None else _beside(found, analysis, given), analysis)


def _beside(found: Diagnosis, analysis: Analysis, given: ContactModel) -> Diagnosis:
    """With the given simulation as the baseline."""
    regression = analysis.regression
    motion = regression.motion({})
    forces = [
        given.runtime().forces_n(
            motion.t[p] + regression.signals.origin_s, motion.x[p], motion.v[p], motion.a[p]
        )
        for p in motion.pieces
    ]
    said = regression.signals.column(regression.signals.spectrum(np.concatenate(forces)))
    error = (regression.signals.force - said)[regression.signals.rows]
    parameters = {f"{e.effect}.{key}": value for e in given.effects for key, value in e.parameters}
    return replace(found, baseline=Stage(float(np.sqrt(np.mean(error**2))), parameters))


def check(recording: Recording) -> None:
    """Refuses what no diagnosis can be made of.

    Raises:
        RecordingError: see `diagnose`.
    """
    place = recording.source
    if recording.force_n is None:
        raise RecordingError(f"{place}: no force, expected a column with the measured force")
    if recording.duration_s < LEAST_S:
        raise RecordingError(f"{place}: {recording.duration_s:.3g} s long, expected at least {LEAST_S:g} s")
    if float(np.ptp(recording.position_m)) == 0.0:
        raise RecordingError(f"{place}: the position never changes, expected motion")
    if float(np.ptp(recording.force_n)) == 0.0:
        raise RecordingError(f"{place}: the force never changes, expected a measured force")


class _Judge:
    """Weighs one analysis."""

    def __init__(self, analysis: Analysis) -> None:
        self.analysis = analysis
        self.regression, self.search, self.fit = analysis.regression, analysis.search, analysis.fit
        self.faults = analysis.faults
        self.base = self.regression.fit({})
        self.before = held_out_errors(self.regression, self.base)
        self.after = held_out_errors(self.regression, self.fit)
        self.held_out = gain(self.regression, self.before, self.after)
        self.parameters = intervals(self.regression, self.fit)
        self.residual_n = float(np.sqrt(np.mean(self.after**2)))
        self.floor_n = analysis.noise_floor_n()

    def diagnosis(self) -> Diagnosis:
        """The verdict by the rules of the design: named only when three pieces of evidence agree."""
        kind = motion_kind(self.regression.signals)
        names = {base_name(name) for name in self.fit.model} | {fault.name for fault in self.faults}
        if kind == "constant_speed":
            return self._without_cause("not_separable", (RIVALS_AT_CONSTANT_SPEED,), GENERAL_MOTION, names)
        physical = {base_name(name) for name in self.fit.model}
        if kind == "single_frequency" and physical:
            rivals = rivals_of_a_line(physical)
            return self._without_cause("not_separable", (rivals,), separating_motion(set(rivals)), names)
        if self._structure_left():
            return self._without_cause("unexplained", (), GENERAL_MOTION, names)
        groups = self._rival_groups()
        if groups:
            together = {name for group in groups for name in group}
            return self._without_cause("not_separable", groups, separating_motion(together), names)
        causes = self._causes()
        if causes:
            return self._result("cause_found", causes, (), None, names)
        return self._without_cause("nothing_missing", (), None, set())

    def _structure_left(self) -> bool:
        """Whether what is left is no noise, and large beside what a spring, a damper, a mass and a bias
        leave."""
        foretold = foretold_share(self.regression, self.fit)
        flexible = flexible_gain(self.regression, self.fit)
        self.foretold, self.flexible = foretold, flexible
        if any(fault.name == "sensor_quantisation" for fault in self.faults):
            return False
        structured = foretold > _FORETOLD or (flexible.low > _FLEXIBLE and flexible.gain > 2.0 * _FLEXIBLE)
        cap = noise_cap_n(self.analysis.recording, self.analysis.cleaned.force_n)
        force = self.regression.signals.force[self.regression.rows]
        encoder_n = abs(self.parameters[""]["mass_kg"].value) * acceleration_noise_m_s2(
            self.regression.signals.even_m, self.regression.signals.even_hz, self.regression.signals.cutoff_hz
        )
        if cap is not None and self.residual_n > max(
            _BEYOND_CAP * float(np.hypot(cap, encoder_n)), _OF_FORCE * float(np.std(force))
        ):
            structured = True
        plain = self.regression.residual(self.regression.fit({"bias": ()}))[self.regression.rows]
        missing = float(np.mean(plain**2))
        return structured and float(np.mean(self.after**2)) > _STRUCTURE * missing

    def _rival_groups(self) -> tuple[tuple[str, ...], ...]:
        """For each cause the names that would do as well in its place."""
        groups: list[tuple[str, ...]] = []
        for name in self.fit.model:
            rest = self.search.without(self.fit, name)
            equals = {
                base_name(other)
                for other in self.search.names
                if base_name(other) not in {base_name(taken) for taken in self.fit.model}
                and self._as_good(rest, other)
            }
            if equals:
                groups.append((base_name(name), *sorted(equals)))
        return tuple(groups)

    def _as_good(self, rest: Fit, other: str) -> bool:
        trial = self.search.best_with(rest, other)
        return trial is not None and trial.score < self.fit.score + _RIVAL

    def _causes(self) -> tuple[Cause, ...]:
        causes = [self._fault_cause(fault) for fault in self.faults]
        for name in self.fit.model:
            cause = self._cause(name)
            if cause is not None:
                causes.append(cause)
        return tuple(sorted(causes, key=lambda cause: -cause.explained_n))

    def _cause(self, name: str) -> Cause | None:
        without = self.search.without(self.fit, name)
        errors = held_out_errors(self.regression, without)
        own = gain(self.regression, errors, self.after)
        gain_n = own.before_n - own.after_n
        if own.low <= 0.0 or gain_n < _LEAST_GAIN_OF_FLOOR * self.floor_n:
            return None
        likelihood = without.score - self.fit.score
        probability = 1.0 / (1.0 + float(np.exp(-0.5 * min(likelihood, 100.0))))
        explained = float(np.sqrt(max(own.before_n**2 - own.after_n**2, 0.0)))
        plain = base_name(name)
        evidence = _evidence(plain, likelihood, own)
        return Cause(plain, probability, self.parameters[plain], evidence, gain_n, explained)

    def _fault_cause(self, fault: Fault) -> Cause:
        parameters = {key: Interval(*map(float, values)) for key, values in fault.parameters.items()}
        evidence = Evidence(fault.evidence, 0.0, 0.0, 0.0, 0.0, fault.evidence)
        return Cause(fault.name, 1.0, parameters, evidence, float(fault.rms_n), float(fault.rms_n))

    def _without_cause(
        self, verdict: str, rivals: tuple[tuple[str, ...], ...], motion: str | None, names: set[str]
    ) -> Diagnosis:
        return self._result(verdict, (), rivals, motion, names)

    def _result(
        self,
        verdict: str,
        causes: tuple[Cause, ...],
        rivals: tuple[tuple[str, ...], ...],
        motion: str | None,
        names: set[str],
    ) -> Diagnosis:
        held = HeldOut(
            self.held_out.before_n,
            self.held_out.after_n,
            self.held_out.gain,
            self.held_out.low,
            self.held_out.high,
        )
        linear = {key: interval.value for key, interval in self.parameters[""].items()}
        extended = {
            f"{name}.{key}": interval.value
            for name, values in self.parameters.items()
            if name
            for key, interval in values.items()
        }
        base = dict(zip(linear, map(float, self.base.coefficients), strict=True))
        return Diagnosis(
            verdict,  # type: ignore[arg-type]
            causes,
            rivals,
            motion,
            self.analysis.flags(),
            self.floor_n,
            Stage(self.held_out.before_n, base),
            Stage(self.held_out.after_n, {**linear, **extended}),
            {"before_m": None, "after_m": None},
            held,
            (),
            tuple(sorted(names)),
        )


def _evidence(name: str, likelihood: float, own: Gain) -> Evidence:
    words = (
        f"without it the penalised -2 log likelihood is {likelihood:.0f} worse and the error on held-out "
        f"blocks {100 * own.gain:.0f} % larger ({100 * own.low:.0f} to {100 * own.high:.0f} %)"
    )
    return Evidence(fingerprint(name), likelihood, own.gain, own.low, own.high, words)
