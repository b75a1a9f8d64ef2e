"""Weighs an analysis: what is named, and with how much trust."""

from collections.abc import Callable
from functools import cached_property

import numpy as np

from forefeel.diagnosis.diagnose.analysis import Analysis
from forefeel.diagnosis.diagnose.as_recorded import AsRecorded
from forefeel.diagnosis.diagnose.band import acceleration_noise_m_s2
from forefeel.diagnosis.diagnose.blocks import RmsGain, gain, gain_over, held_out_errors, numbers_at
from forefeel.diagnosis.diagnose.candidates import base_name
from forefeel.diagnosis.diagnose.faults import Fault
from forefeel.diagnosis.diagnose.flexible import flexible_gain, modulation_gain
from forefeel.diagnosis.diagnose.identifiability import (
    GENERAL_MOTION,
    RIVALS_AT_CONSTANT_SPEED,
    motion_kind,
    rivals_of_a_line,
    separating_motion,
)
from forefeel.diagnosis.diagnose.parameters import intervals, told
from forefeel.diagnosis.diagnose.regression import ModelFit
from forefeel.diagnosis.diagnose.structure import noise_cap_n, predictable_share
from forefeel.diagnosis.diagnose.third_party import fingerprint
from forefeel.diagnosis.diagnose.verdict import Cause, Diagnosis, Evidence, HeldOut, Interval, ModelError

_LEAST_GAIN_OF_FLOOR = 0.01
_RIVAL = 6.0
_NEAR = 0.3  # of what the cause explains: no rival begins farther off on the grid
_FORETOLD = 0.3
_STRUCTURE = 0.135
_FLEXIBLE = 0.1
_BEYOND_CAP = 2.0
_OF_FORCE = 0.02

_NONE_AT_ZERO = {"time_delay": "delay_s", "sensor_lag": "time_constant_s", "backlash": "width_m"}
"""At zero of this parameter there is no such cause: with zero in its interval it is not named."""


Everywhere = Callable[[ModelFit], ModelFit]
"""A model of the analysis, fitted to all of the recording that the analysis is a part of."""


class Judge:
    """Weighs one analysis; of a part of a recording with `everywhere`, on which rivals must do as well."""

    def __init__(self, analysis: Analysis, everywhere: Everywhere = lambda fit: fit) -> None:
        self.analysis, self.everywhere = analysis, everywhere
        self.regression, self.search, self.fit = analysis.regression, analysis.search, analysis.fit
        self.faults = analysis.faults
        self.base = self.regression.fit({})
        self.before = held_out_errors(self.regression, self.base)
        self.after = held_out_errors(self.regression, self.fit)
        self.held_out = self._gain()
        self.parameters = intervals(self.regression, self.fit, analysis.narrower)
        self.residual_n = float(np.sqrt(np.mean(self.after**2)))
        self.floor_n = analysis.noise_floor_n()

    def _gain(self) -> RmsGain:
        """In the compared band; on the force as recorded when the sensor has faults."""
        if not self.faults:
            return gain(self.regression, self.before, self.after)
        names = {fault.name for fault in self.faults}
        return self._as_recorded.gain(self.base, self.fit, names)

    @cached_property
    def _as_recorded(self) -> AsRecorded:
        return AsRecorded(self.regression, self.analysis.recording, self.analysis.cleaned)

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
        """Whether much of what a spring, a damper, a mass and a bias leave is left by the causes, too, and is
        no noise.
        """
        if any(fault.name == "sensor_quantisation" for fault in self.faults):
            return False
        pulsing = modulation_gain(self.regression, self.fit)
        if pulsing is not None and pulsing.gain > 2.0 * _FLEXIBLE and pulsing.low > _FLEXIBLE:
            return True
        plain = self.regression.residual(self.regression.fit({"bias": ()}))[self.regression.rows]
        left = float(np.mean(self.after**2)) / float(np.mean(plain**2))
        return self._structured_share() * left > _STRUCTURE

    def _structured_share(self) -> float:
        """Share of what is left that is no noise: by its memory, by a flexible model, by its size."""
        foretold = predictable_share(self.regression, self.fit)
        flexible = flexible_gain(self.regression, self.fit)
        shares = [foretold if foretold > _FORETOLD else 0.0]
        if flexible.low > _FLEXIBLE and flexible.gain > 2.0 * _FLEXIBLE:
            shares.append(1.0 - (1.0 - flexible.gain) ** 2)
        cap = noise_cap_n(self.analysis.recording, self.analysis.cleaned.force_n)
        signals = self.regression.signals
        if cap is not None and self.residual_n > _OF_FORCE * float(np.std(signals.force[signals.rows])):
            speed_up = acceleration_noise_m_s2(signals.even_m, signals.even_hz, signals.cutoff_hz)
            most = _BEYOND_CAP * float(np.hypot(cap, abs(self.parameters[""]["mass_kg"].value) * speed_up))
            shares.append(1.0 - (most / self.residual_n) ** 2)
        return max(shares)

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

    def _as_good(self, rest: ModelFit, other: str) -> bool:
        worst = self.fit.score + _RIVAL + _NEAR * abs(rest.score - self.fit.score)
        trial = self.search.best_with(rest, other, worst)
        if trial is None or trial.score >= self.fit.score + _RIVAL:
            return False
        return self.everywhere(trial).score < self.everywhere(self.fit).score + _RIVAL

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
        plain = base_name(name)
        doubted = _NONE_AT_ZERO.get(plain)
        if doubted is not None and self.parameters[plain][doubted].low <= 0.0:
            return None
        likelihood = without.score - self.fit.score
        probability = 1.0 / (1.0 + float(np.exp(-0.5 * min(likelihood, 100.0))))
        explained = float(np.sqrt(max(own.before_n**2 - own.after_n**2, 0.0)))
        evidence = _evidence(plain, likelihood, own)
        return Cause(plain, probability, told(self.parameters[plain]), evidence, gain_n, explained)

    def _fault_cause(self, fault: Fault) -> Cause:
        parameters = {key: Interval(*map(float, values)) for key, values in fault.parameters.items()}
        names = {other.name for other in self.faults}
        numbers = numbers_at(self.regression, self._as_recorded.t[self._as_recorded.rows])
        without = self._as_recorded.errors(self.fit, names - {fault.name})
        own = gain_over(numbers, without, self._as_recorded.errors(self.fit, names))
        words = (
            f"{fault.evidence}; knowing it lessens the error on held-out blocks by {100 * own.gain:.0f} % "
            f"({100 * own.low:.0f} to {100 * own.high:.0f} %)"
        )
        evidence = Evidence(fingerprint(fault.name), 0.0, own.gain, own.low, own.high, words)
        return Cause(fault.name, 1.0, parameters, evidence, own.before_n - own.after_n, float(fault.rms_n))

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
            ModelError(self.held_out.before_n, base),
            ModelError(self.held_out.after_n, {**linear, **extended}),
            {"before_m": None, "after_m": None},
            held,
            (),
            tuple(sorted(names)),
        )


def _evidence(name: str, likelihood: float, own: RmsGain) -> Evidence:
    words = (
        f"without it the penalised -2 log likelihood is {likelihood:.0f} worse; it lessens the error on "
        f"held-out blocks by {100 * own.gain:.0f} % ({100 * own.low:.0f} to {100 * own.high:.0f} %)"
    )
    return Evidence(fingerprint(name), likelihood, own.gain, own.low, own.high, words)
