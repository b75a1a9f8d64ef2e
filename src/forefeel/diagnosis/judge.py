"""Weighs an analysis: what is named, and with how much trust."""

from collections.abc import Container, Iterable, Iterator
from dataclasses import replace
from functools import cached_property

import numpy as np

from forefeel.common.causes.candidate import base_name
from forefeel.common.causes.catalogue import CANDIDATES, cause_class, no_rivals
from forefeel.common.causes.periodic import PositionMap, Pulsation, Rhythm
from forefeel.common.causes.registry import effect_class
from forefeel.common.causes.sensor import SensorLag, SensorQuantisation
from forefeel.common.causes.unmodelled_resonance import MOST_DAMPED
from forefeel.common.error_size import Floats
from forefeel.diagnosis.analysis import Analysis
from forefeel.diagnosis.follows import Leftover
from forefeel.diagnosis.identifiability import (
    EXCITATION,
    MOTION_AFTER_CONSTANT_SPEED,
    NOISE_TELLING_MOTION,
    RIVALS_AT_CONSTANT_SPEED,
    RIVALS_AT_ONE_SPEED,
    MotionKind,
    following_motion,
    motion_kind,
    turns,
)
from forefeel.diagnosis.regression import BASE, ModelFit
from forefeel.diagnosis.residual import excess_share, predictable_share
from forefeel.diagnosis.uncertainty import gain, held_out_errors, intervals, significant
from forefeel.diagnosis.verdict import (
    MOST_TIMES_THE_NOISE,
    NAMING,
    SLOW,
    Cause,
    Diagnosis,
    Follows,
    HeldOut,
    Interval,
    ModelError,
    NextMotion,
    VerdictName,
)

_RIVAL = 6.0
_NEAR = 0.3  # of what the cause explains: no rival begins farther off on the grid
_AS_GOOD = 0.03  # lower end of the held-out gain over a rival, or over none, up to which that does as well
_MOST_RIVALS = 3
# share of the strokes' force that mass, damper and spring explain, and by how much more than of all of it
_STROKES_EXPLAINED, _MORE_THAN_WHOLE = 0.8, 0.04
_SLOWEST_CELL_S = 0.1  # a quarter of the time in which an HX711 settles at 10 samples a second (data sheet)
_STRUCTURE = 0.135
_FLEXIBLE = 0.15  # lower end of the held-out gain of a function of one variable that shows structure
# share of the residual that its past foretells, and of the force that is left, where the noise is unknown
_FORETOLD_UNKNOWN, _OF_FORCE_UNKNOWN = 0.5, 0.03
_OF_FORCE = 0.02
# of the variance that m, b, k and a bias leave, which the causes leave, too: then it has to be noise
_MUCH_LEFT = 0.2
_KNOWN_SLOPE = 1.0  # of noise: a steeper one is bounded from above only
_STROKES = 4  # reversals on each side of a change,
_NEARLY_ALL = 0.9  # or the lower end of its held-out gain
_REPEATED, _AGAIN = (PositionMap.name, "sensor_drift:creep", "sensor_drift:wave"), 2
"""What any course over one way in and out is, so that it needs two reversals in each half of a recording."""
# lower end of the held-out gain that a cause needs beside structure that has no name, or a second friction
_CLEAR_GAIN = 0.1
_ROUNDED = 2.0
"""Times what the steps of the encoder make on average: at a constant speed they are lines. Of 37 guidewires
what is there explained 38 times as much and more; a slip that is not there, 1.3 times.
"""
_BESIDE_MOTION = 0.2  # the same of a rhythm beside any function of the motion
_AS_MUCH = 1.15  # times what the best function of one variable leaves, that causes may leave beside structure
_REMEMBERED = 0.2  # share that the past foretells of what is no noise; first-order noise of 5 Hz leaves 0.08
# share of the force's variance that the motion explains, above which nobody doubts that it drives the force
_DRIVEN = 0.6
_MUCH_LESS = 0.25  # of what the motion leaves unexplained: what the own past then leaves
_AHEAD_S = 0.2  # s by which the force's own past has to foretell it: longer than any contact rings
_KNOWN = 0.3  # least share that it has to foretell, to say that something else drives the force

Less = tuple[VerdictName, NextMotion | None, tuple[tuple[str, ...], ...]]
"""A verdict without a cause, the motion to record next, and groups of rivals."""


def judged(analysis: Analysis) -> tuple[Diagnosis, Analysis]:
    """Drops doubted causes one at a time, searching on without each, until none is doubted; then, without a
    search, those that are `unclear`. Returns the diagnosis and the analysis of the remaining causes; of the
    simulation alone where the force is `slow`. A doubted bias is dropped without a search, too.
    """
    while True:
        judge = Judge(analysis)
        doubted = judge.doubted()
        if doubted == "bias":  # the simulation has one, too: it stays open to what is searched for later
            analysis = replace(analysis, fit=judge.without[doubted][0])
        elif doubted is not None:
            analysis = analysis.without(doubted)
        elif judge.slow:
            analysis = analysis.baseline()
            return Judge(analysis).diagnosis(), analysis
        elif (unclear := judge.unclear()) is not None:
            analysis = replace(analysis, fit=judge.without[unclear][0])
        else:
            return judge.diagnosis(), analysis


class Judge:
    """Weighs one analysis."""

    def __init__(self, analysis: Analysis) -> None:
        self.analysis = analysis
        self.regression, self.search, self.fit = analysis.regression, analysis.search, analysis.fit
        self.faults = analysis.faults
        self.base = analysis.base
        self.before = held_out_errors(self.regression, self.base)
        self.after = held_out_errors(self.regression, self.fit)
        self.held_out = gain(self.regression, self.before, self.after)
        self.parameters = intervals(self.regression, self.fit, analysis.narrower)
        self.residual_n = float(np.sqrt(np.mean(self.after**2)))
        self.floor_n = analysis.noise_floor_n()
        self.force_n = float(np.std(self.regression.signals.force[self.regression.signals.rows]))

    def diagnosis(self) -> Diagnosis:
        """Diagnosis: a verdict of `_without_cause` if there is one. Where the fit has a cause (or a bias), or
        the sensor a fault, `cause_found`, or `partly_explained` beside structure; else `nothing_missing`, or
        `nothing_found` where the noise floor is unknown.
        """
        names = {base_name(name) for name in self.fit.model} | {fault.name for fault in self.faults}
        less = self._without_cause()
        if less is not None:
            return self._diagnosis(*less, suspected=names)
        if self.fit.model or self.faults:
            if self._causes_of_model and self._structure_left:
                return self._diagnosis("partly_explained", following_motion(self._follows), suspected=names)
            return self._diagnosis("cause_found", suspected=names)
        if self.floor_n is None:
            return self._diagnosis("nothing_found", NOISE_TELLING_MOTION)
        return self._diagnosis("nothing_missing")

    @property
    def _causes_of_model(self) -> list[str]:
        """Causes of the fit; a bias is none."""
        return [name for name in self.fit.model if name != "bias"]

    @cached_property
    def _kind(self) -> MotionKind:
        return motion_kind(self.regression.signals)

    @cached_property
    def _largest(self) -> str | None:
        """The cause without which most is left; the bias is none."""
        return max(self._causes_of_model, key=lambda name: self.without[name][1].rmse_before_n, default=None)

    def _without_cause(self) -> Less | None:
        """Verdict that names no cause, with the motion to record next and the rivals; None where causes may
        be named. In turn: `not_separable` at constant speed; `unexplained` if `slow`;
        `not_driven_by_this_axis`; `unexplained` if structure is left beside which the causes do not stand;
        `not_separable` with rivals.
        """
        if self._kind == "constant_speed":
            return "not_separable", MOTION_AFTER_CONSTANT_SPEED, (RIVALS_AT_CONSTANT_SPEED,)
        if self.slow:
            return "unexplained", None, ()
        if self._not_driven():
            return "not_driven_by_this_axis", None, ()
        if self._structure_left and not self._causes_stand():
            return "unexplained", following_motion(self._follows), ()
        groups = self._groups
        if groups:
            return "not_separable", EXCITATION, groups
        return None

    @cached_property
    def _groups(self) -> tuple[tuple[str, ...], ...]:
        """Groups of causes that can not be told apart, empty without any. At a single frequency: the largest
        cause and its rivals; at one speed, if one of a fixed group was fitted: that group; else those of
        `_rival_groups`.
        """
        if self._kind == "single_frequency":
            return self._rivals_of_a_line()
        named = {base_name(name) for name in self.fit.model}
        if self._kind == "one_speed" and named & set(RIVALS_AT_ONE_SPEED):
            return (RIVALS_AT_ONE_SPEED,)
        return self._rival_groups()

    def _causes_stand(self) -> bool:
        """True if the causes stand beside structure that has no name: they gain clearly, have no rivals, and
        leave hardly more than the best function of a single variable would in their place: what that explains
        far better is something else.
        """
        if not self._causes_of_model or self.held_out.gain_low < _CLEAR_GAIN or self._groups:
            return False
        left, before = (1.0 - self.held_out.gain) ** 2, Leftover(self.regression, self.base)
        timed = any(cause_class(name).clocked for name in self.fit.model)
        return left < _AS_MUCH * (1.0 - before.share_of_one(timed))

    @cached_property
    def slow(self) -> bool:
        """True if a force slower than the strokes may pass for a cause: mass, damper and spring explain 80 %
        of the force in the band of the strokes, clearly more than of the whole, most of what they leave is
        slower, and the largest cause, if any, `bends` or pulses faster than `slow_hz`.
        """
        look = self.regression.look
        slower = 1.0 - look.spring_in_band < 0.5 * (1.0 - look.spring)  # most of what is left
        if not slower or look.spring_in_band < max(_STROKES_EXPLAINED, look.spring + _MORE_THAN_WHOLE):
            return False
        name = self._largest
        if name is None or cause_class(name).bends:
            return True
        beats = issubclass(cause_class(name), Pulsation)
        return beats and float(np.mean(self.fit.model[name])) > look.slow_hz

    def _not_driven(self) -> bool:
        """True if the force's own past, 0.2 s old or more, predicts over 30 % of its variance and leaves
        under a quarter of what the model leaves. False where the motion explains over 60 %, or a cause
        follows a further column.
        """
        if any(map(self.regression.column_of, self.fit.model)):
            return False
        explained = 1.0 - (self.residual_n / self.force_n) ** 2
        if max(explained, self.regression.look.explained) > _DRIVEN:
            return False
        foretold = predictable_share(self.regression, self.regression.signals.force, _AHEAD_S)
        return foretold > _KNOWN and 1.0 - foretold < _MUCH_LESS * (1.0 - explained)

    @cached_property
    def _structure_left(self) -> bool:
        """True if the model leaves more than three times the noise floor and than 2 % of the force, or
        structure (`_structured_share`) of over 13.5 % of the variance that the simulation leaves. Where the
        noise is not known also if the residual's own past predicts it, and it is over 3 % of the force or,
        with causes, over 20 % of that variance. Always False with a quantised sensor, and where no more is
        left than the encoder's steps make.
        """
        if any(fault.name == SensorQuantisation.name for fault in self.faults):
            return False
        if self.residual_n < _ROUNDED * self._rounding_n:
            return False
        plain = self.regression.residual(self.base)[self.regression.rows]
        left = float(np.mean(self.after**2)) / float(np.mean(plain**2))
        much = self._causes_of_model and left > _MUCH_LEFT
        # where the noise is unknown, what may be noise forgets itself
        if much and not (self._noise_is_known or self._predicted_share < _REMEMBERED):
            return True
        noise_n = max(MOST_TIMES_THE_NOISE * (self.floor_n or np.inf), _OF_FORCE * self.force_n)
        if self.residual_n > noise_n or self._structured_share() * left > _STRUCTURE:
            return True
        matters = not self._noise_is_known and self.residual_n > _OF_FORCE_UNKNOWN * self.force_n
        return matters and self._predicted_share > _FORETOLD_UNKNOWN

    @cached_property
    def _baseline(self) -> dict[str, dict[str, Interval]]:
        return intervals(self.regression, self.base)

    @cached_property
    def _rounding_n(self) -> float:
        """rms in N of what the steps of the encoder make of the simulation. A mass, damper or spring that may
        be 0 makes none: at a single frequency tons of mass cancel with a spring.
        """
        known = (self._baseline[""][size] for size in BASE)
        return self.regression.rounding_n(*(p.value if p.low > 0.0 or p.high < 0.0 else 0.0 for p in known))

    @property
    def _noise_is_known(self) -> bool:
        floor = self.analysis.floor
        return floor is not None and floor.slope <= _KNOWN_SLOPE

    @cached_property
    def _left_over(self) -> Leftover:
        return Leftover(self.regression, self.fit)

    @cached_property
    def _follows(self) -> tuple[Follows, ...]:
        """Variables that the residual follows where it is structure; else none."""
        return self._left_over.follows() if self._structure_left else ()

    @cached_property
    def _residual(self) -> Floats:
        return self.regression.residual(self.fit)

    @cached_property
    def _predicted_share(self) -> float:
        """Share of what is left that its own past predicts."""
        return predictable_share(self.regression, self._residual)

    def _structured_share(self) -> float:
        """Share of the residual's variance that is no noise: the larger of what a function of one variable
        explains, and what exceeds a known floor; 0 if none is clear.
        """
        floor, of_one_variable = self.analysis.floor, self._left_over.largest_share(_FLEXIBLE)
        if floor is None or self.residual_n <= _OF_FORCE * self.force_n:
            return of_one_variable
        return max(of_one_variable, excess_share(self.regression, self._residual, floor))

    def _rival_groups(self) -> tuple[tuple[str, ...], ...]:
        """Groups (cause, up to two rivals), one for each cause of the fit that has rivals: causes outside the
        model, of another part of the bench, that score less than 6 worse in its place, and beside which it
        gains less than half as much.
        """
        taken = {base_name(name) for name in self.fit.model}
        groups = []
        for name in self._causes_of_model or self.fit.model:  # what a bias may be instead hides no cause
            shape, half = self.fit.model[name], 0.5 * (self.without[name][0].score - self.fit.score)
            rivals = [
                (trial.score, base_name(other))
                for other, trial in self._replacements(name, taken | no_rivals(name))
                if trial.score < self.fit.score + _RIVAL
                and not (name == "bias" and CANDIDATES[other].costly)  # it may hold a constant itself
                and trial.score - self.search.fit({**trial.model, name: shape}).score < half
            ]
            groups += _group(name, rivals)
        return tuple(groups)

    def _rivals_of_a_line(self) -> tuple[tuple[str, ...], ...]:
        """Group of the largest cause and up to two causes that predict held-out blocks as well in its place,
        alone in a tuple; empty without a cause or a rival. For motion at a single frequency.
        """
        largest = self._largest
        if largest is None:
            return ()
        rivals = []
        for other, trial in self._replacements(largest, no_rivals(largest) | {"bias"}):
            against = gain(self.regression, held_out_errors(self.regression, trial), self.after)
            if against.gain_low <= _AS_GOOD:
                rivals.append((against.rmse_before_n, base_name(other)))
        return tuple(_group(largest, rivals))

    def _replacements(self, name: str, closed: Container[str]) -> Iterator[tuple[str, ModelFit]]:
        """Yields name and refined fit of each form that is feasible, and on its grid near the fit's score, in
        place of cause `name`. Leaves out causes in `closed`, those kin to another cause of the model, and
        costly ones that are not worth adding.
        """
        rest, _ = self.without[name]
        worst = self.fit.score + _RIVAL + _NEAR * abs(rest.score - self.fit.score)
        for other in self.search.names:
            if base_name(other) not in closed and self.search.open_to(rest, other):
                trial = self.search.best_with(rest, other, worst)
                # one of many shapes that would not be named beside the rest is no rival there
                if trial is not None and (not CANDIDATES[other].costly or self.search.worth(trial, rest)):
                    yield other, trial

    def doubted(self) -> str | None:
        """Name of the cause to drop: of those that are impossible, else of the weak ones, the one whose loss
        costs least. None where there are none, or at constant speed.
        """
        if self._kind == "constant_speed":
            return None
        weak = [name for name in self.fit.model if self._is_impossible(name)]
        weak = weak or [name for name in self.fit.model if self._is_weak(name)]
        return min(weak, key=lambda name: self.without[name][0].score, default=None)

    def unclear(self) -> str | None:
        """Name of the cause that gains least, alone or beside the single variable that most of what is left
        follows, if that gain may be below 10 % and structure is left. Else None; also for the only cause.
        """
        if len(self._causes_of_model) < 2 or not self._structure_left:
            return None
        gains = {
            name: min(held.gain_low, self._left_over.gain_beside(fit))
            for name, (fit, held) in self.without.items()
            if name != "bias"
        }
        least = min(gains, key=lambda name: gains[name])
        return least if gains[least] < _CLEAR_GAIN else None

    def _is_impossible(self, name: str) -> bool:
        """True if a parameter is out of its cause's bounds; if the cause needs a spring (it relaxes or lags)
        and the stiffness may be 0; or for a sensor lag over 0.1 s if a contact that relaxes gives the same
        force along every motion.
        """
        mass, damping, stiffness = (self.parameters[""][size] for size in BASE)
        if cause_class(name).needs_spring and stiffness.low <= 0.0:
            return True  # a damper that comes late, as dry friction is where the motion turns
        values = self.parameters[base_name(name)]
        if name == SensorLag.name:
            # (m s^2 + b s + k) / (1 + tau s) is the spring k, a damper m / tau, and a Maxwell branch of
            # (b - m / tau) / tau - k: where that is positive, it is no proof of a slow cell
            tau_s = values["time_constant_s"].value
            relaxing_n_m = (damping.value - mass.value / tau_s) / tau_s - stiffness.value
            if tau_s > _SLOWEST_CELL_S and relaxing_n_m > 0.0:
                return True
        bounded = [p for p in effect_class(base_name(name)).parameters if p.name in values]
        return any(not p.lower <= values[p.name].value <= p.upper for p in bounded)

    def _is_weak(self, name: str) -> bool:
        """True if the cause gains too little on held-out blocks (lower end up to 3 %, of a second friction 10
        %, or no more than the encoder's steps make); if its intervals tell nothing (all sizes may be 0, a
        ratio 1, a mode no peak); or if the motion does not bear it out: a change of stiffness at rest with
        few reversals before or after that gains below 90 %, a position map or drift without two reversals
        in each half, a rhythm that gains under 20 % beside a function of the motion.
        """
        _, held_out = self.without[name]
        rubs = [other for other in self.fit.model if cause_class(other).rubs]
        least = _CLEAR_GAIN if name in rubs and len(rubs) > 1 else _AS_GOOD
        rounded_n = np.hypot(held_out.rmse_after_n, _ROUNDED * self._rounding_n)
        if held_out.gain_low <= least or held_out.rmse_before_n < rounded_n:
            return True
        seldom = name == "stiffness_change:rest" and not self._moved_around(self.fit.model[name][0], _STROKES)
        t = self.regression.signals.t
        once = name in _REPEATED and not self._moved_around(0.5 * float(t[0] + t[-1]), _AGAIN)
        imitates = isinstance(CANDIDATES[name], Rhythm) and self._imitates_the_motion(name)
        if once or imitates or (seldom and held_out.gain_low < _NEARLY_ALL):
            return True
        parameters = self.parameters[base_name(name)]
        ratio = parameters.get("ratio")  # of two stiffnesses
        if ratio is not None and ratio.low <= 1.0 <= ratio.high:
            return True
        damping = parameters.get("damping_ratio")
        if damping is not None and damping.high > MOST_DAMPED:
            return True
        sizes = [parameters[size] for size in CANDIDATES[name].needed]
        # a bias that gains may be open because a wall's place stands for it
        sure = not sizes or (name == "bias" and held_out.gain_low > _CLEAR_GAIN)
        return not sure and all(size.low <= 0.0 <= size.high for size in sizes)

    def _imitates_the_motion(self, name: str) -> bool:
        """True if a rhythm, whose phase is taken from the force, gains little beside a function of motion:
        strokes that vary have a phase, too.
        """
        rest = {other: shape for other, shape in self.fit.model.items() if other != name}
        return self._left_over.gain_beside_motion(self.search.fit(rest)) < _BESIDE_MOTION

    def _moved_around(self, instant_s: float, least: int) -> bool:
        """True if both before and after an instant the position reverses `least` times or more."""
        signals = self.regression.signals
        inside = signals.recorded
        after = signals.fine_t[inside] > instant_s
        return all(turns(signals.fine_x[inside][part]) >= least for part in (after, ~after))

    @cached_property
    def without(self) -> dict[str, tuple[ModelFit, HeldOut]]:
        """Refined fit without each cause, by the cause's name, and the cause's gain on held-out blocks over
        that fit with a bias, as the baseline has one; computed once.
        """
        fits = {}
        for name in self.fit.model:
            without = beside_a_bias = self.search.without(self.fit, name)
            if "bias" not in self.fit.model:
                beside_a_bias = self.search.without(self.search.fit({**self.fit.model, "bias": ()}), name)
            errors = held_out_errors(self.regression, beside_a_bias)
            fits[name] = without, gain(self.regression, errors, self.after)
        return fits

    def _detectable(self) -> dict[str, float]:
        """Smallest size that the search would have found of each cause outside the model, by
        `cause.parameter`; only of causes with one coefficient and no shape.
        """
        known, _ = np.linalg.qr(self.regression.design(self.fit.model))
        variance, sizes = self.fit.rss / self.fit.n, {}
        for name in self.search.names:
            candidate = CANDIDATES[name]
            there = name not in self.fit.model and candidate.grid(self.regression.extent)
            if not there or candidate.shapes or len(candidate.coefficients) != 1:
                continue
            column = self.regression.design({name: ()})[:, len(BASE) :]
            power = float(np.sum((column - known @ (known.T @ column)) ** 2))
            least = max(
                candidate.least_score + np.log(self.fit.n), (candidate.least_ratio**2 - 1.0) * self.fit.n
            )
            sizes[f"{name}.{candidate.coefficients[0]}"] = float(
                np.sqrt(variance * least / max(power, 1e-300))
            )
        return sizes

    def _causes(self) -> tuple[Cause, ...]:
        causes = [*self.faults, *map(self._cause, self.fit.model)]
        # the baseline has a bias, too: it is told last
        return tuple(sorted(causes, key=lambda cause: (cause.name == "bias", -cause.explained_n)))

    def _cause(self, name: str) -> Cause:
        """Result entry of a cause by its form: significant parameters, held-out gain, evidence."""
        without, held_out = self.without[name]
        plain, likelihood = base_name(name), without.score - self.fit.score
        words = (
            f"without it the penalised -2 log likelihood is {likelihood:.0f} worse; it lessens the error on "
            f"held-out blocks by {100 * held_out.gain:.0f} % "
            f"({100 * held_out.gain_low:.0f} to {100 * held_out.gain_high:.0f} %)"
        )
        sizes, column = significant(self.parameters[plain]), self.regression.column_of(name)
        return Cause.fitted(plain, sizes, likelihood, held_out, words, column)

    def _diagnosis(
        self,
        verdict: VerdictName,
        motion: NextMotion | None = None,
        rivals: tuple[tuple[str, ...], ...] = (),
        suspected: Iterable[str] = (),
    ) -> Diagnosis:
        """Diagnosis of that verdict with all its numbers; with causes only where the verdict names any, with
        the flag `slow_force` if `slow`. `motion`: to record next; `suspected`: named by the search,
        whatever the verdict.
        """
        held = self.held_out
        return Diagnosis(
            verdict,
            self._causes() if verdict in NAMING else (),
            rivals,
            motion,
            (*self.analysis.flags(), *([SLOW] if self.slow else [])),
            self.floor_n,
            ModelError.of(held.rmse_before_n, self.force_n, self._baseline),
            ModelError.of(held.rmse_after_n, self.force_n, self.parameters),
            held,
            follows=self._follows,
            detectable=self._detectable() if verdict in ("nothing_missing", "nothing_found") else {},
            suspected=tuple(sorted(suspected)),
        )


def _group(name: str, rivals: Iterable[tuple[float, str]]) -> list[tuple[str, ...]]:
    """A cause and the best of its rivals, which are (how bad, name); nothing without any."""
    names = dict.fromkeys(rival for _, rival in sorted(rivals))
    return [(base_name(name), *list(names)[: _MOST_RIVALS - 1])] if names else []
