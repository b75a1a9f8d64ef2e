"""Search of causes: forward, backward and exchange steps by penalised likelihood, shapes refined jointly.

Periods come from lines in a residual, and from the motion itself, whose harmonics look like lines. Shapes are
refined by bounded scalar searches, and by simplexes where several trade.
"""

from collections.abc import Iterable
from functools import cached_property

import numpy as np
from scipy.fft import ifft, rfft, rfftfreq
from scipy.optimize import minimize, minimize_scalar

from forefeel.common.causes.candidate import (
    Candidate,
    Model,
    Periodic,
    PositionWave,
    Shape,
    base_name,
    within,
)
from forefeel.common.causes.catalogue import CANDIDATES, kin
from forefeel.common.causes.friction import CoulombFriction, PreslidingHysteresis
from forefeel.common.causes.motion import Motion
from forefeel.common.causes.periodic import PULSATION_HZ, VARIES, PositionMap, Rhythm, step_s
from forefeel.common.causes.unmodelled_resonance import UnmodelledResonance
from forefeel.common.causes.wall import Stiffening, StressRelaxation
from forefeel.common.error_size import Floats
from forefeel.diagnosis.regression import ModelFit, RecordingRegression
from forefeel.diagnosis.verdict import Family

_LEAST_CYCLES = 5.0  # of a pulsation: fewer are not told from a force that wanders
_WIDE, _BAND = 1.1, 0.35  # ratio to which a line that varies is wide; share within which its phase is taken
_SOME_CYCLES, _MANY_CYCLES = 7.0, 12.0
_STEPS, _SINGULAR = 4, 1e-9  # of Gauss-Newton; added to its information, which then has an inverse
_HIGHEST_ORDER = 10  # harmonic of the motion up to which a line is taken for its echo
_ALIKE = 0.9
LEAST_WAVES = 2.5
"""Over the range of positions, of a force that belongs to the position; chosen: fewer are like any curve, of
which a spring that stiffens, a wall that begins and friction make many.
"""
_MOST_WAVES, _WAVE_STEP = 40.0, 0.2  # over the range: most of the same, and their step
_APART = 0.8  # waves over the range: what is nearer is the same line
_MOST_SAMPLES = 3000  # of a residual that is searched for such waves
_MANY = 9.0  # periods until harmonics stand apart
_SEEN_FROM_BELOW = 2.5
_LEAST_LINES = 3.0  # harmonics of a motion that repeats, in the width of a mode: fewer show no peak


class Periods:
    """Finds periods in residuals, and tells which modes and pulsations the motion can show."""

    def __init__(self, regression: RecordingRegression) -> None:
        self.regression = regression
        self.lowest_hz = max(PULSATION_HZ[0], _LEAST_CYCLES / regression.extent.duration_s)

    def lines(self, fit: ModelFit, count: int = 4) -> list[Shape]:
        """Frequencies in Hz, as shapes of one value, of up to `count` strongest lines of the whitened
        residual from `lowest_hz` to 4 Hz, then their halves, as far as these are not below `lowest_hz`.
        """
        regression = self.regression
        rate = regression.signals.coarse_rate_hz
        residual = np.zeros(len(regression.rows))
        residual[regression.rows] = regression.target - regression.design(fit.model) @ fit.coefficients
        length = 4 * len(residual)
        power = np.abs(rfft(residual, length)) ** 2
        frequency = rfftfreq(length, 1.0 / rate)
        low = self.lowest_hz
        inside = (frequency >= low) & (frequency <= PULSATION_HZ[1])
        peaks: list[Shape] = []
        power = np.where(inside, power, 0.0)
        for _ in range(count):
            top = int(np.argmax(power))
            if power[top] <= 0.0:
                break
            peaks.append((float(frequency[top]),))
            power[np.abs(frequency - frequency[top]) < 1.5 / regression.extent.duration_s] = 0.0
        return peaks + [(f / 2.0,) for (f,) in peaks if f / 2.0 >= low]

    def courses(self, fit: ModelFit, rhythm: Rhythm, count: int = 2) -> list[Shape]:
        """Shapes to try for a rhythm, from the `count` strongest lines of the residual times the rhythm's
        last factor. Each line gives its frequency alone, except for a `living` rhythm, and its rates along
        time, by the phase within 35 % of the line, if it has over 12 cycles (7 of a `living` one).
        """
        signals, motion = self.regression.signals, self.regression.motion(fit.model)
        *level, factor = rhythm.factors(motion)
        factor = np.interp(signals.t, motion.t, factor - (np.min(factor) if level else 0.0))
        left = np.where(signals.rows, self.regression.residual(fit) * factor, 0.0)
        left -= np.mean(left[signals.rows]) * signals.rows
        length = 4 * len(left)
        spectrum, frequency = rfft(left, length), rfftfreq(length, 1.0 / signals.coarse_rate_hz)
        total = np.concatenate([[0.0], np.cumsum(np.abs(spectrum) ** 2)])
        low, high = (np.searchsorted(frequency, frequency * wide) for wide in (1.0 / _WIDE, _WIDE))
        power = (total[high] - total[low]) / np.maximum(high - low, 1)
        power[(frequency < self.lowest_hz) | (frequency > PULSATION_HZ[1])] = 0.0
        shapes: list[Shape] = []
        while count and np.any(power):
            count -= 1
            line_hz = float(frequency[int(np.argmax(power))])
            away = frequency / line_hz - 1.0
            power[np.abs(away) < _BAND] = 0.0
            if not rhythm.living:
                sharp = np.where(np.abs(away) < _WIDE - 1.0, np.abs(spectrum), 0.0)
                shapes.append((float(frequency[int(np.argmax(sharp))]),))
            band = np.zeros(length, dtype=np.complex128)
            inside = np.cos(0.5 * np.pi * np.clip(away / _BAND, -1.0, 1.0)) ** 2
            band[: len(spectrum)] = inside * spectrum
            t, turned = signals.t[signals.rows], np.unwrap(np.angle(ifft(band)[: len(left)]))[signals.rows]
            each_s = step_s(float(np.ptp(turned) / np.ptp(t)) / (2.0 * np.pi))
            at = each_s * np.arange(-0.5, t[-1] / each_s + 0.5)
            turned = np.interp(at, t, turned - 2.0 * np.pi * line_hz * t) / (2.0 * np.pi) + line_hz * at
            rates = np.clip(np.diff(turned) / each_s, (1.0 - _BAND) * line_hz, (1.0 + _BAND) * line_hz)
            if len(rates) > 1 and line_hz * np.ptp(t) > (_SOME_CYCLES if rhythm.living else _MANY_CYCLES):
                shapes.append(tuple(rates.tolist()))
        return shapes

    def over_position(self, fit: ModelFit, count: int = 4) -> list[Shape]:
        """The periods in m of the waves over the position, with a second harmonic, that explain most of what
        the model's other columns leave; the shortest first.
        """
        regression = self.regression
        rows = np.flatnonzero(regression.signals.rows)
        rows = rows[:: 1 + len(rows) // _MOST_SAMPLES]
        blocks = [regression.block(fit.model, name, shape) for name, shape in [("", ()), *fit.model.items()]]
        known, _ = np.linalg.qr(np.column_stack([np.ones(len(rows)), *(block[rows] for block in blocks)]))
        residual = _orthogonal(known, regression.residual(fit)[rows])
        x = regression.signals.column(regression.signals.spectrum(regression.motion(fit.model).x))[rows]
        motion = Motion(x, x, x, x, x)

        def power(waves: float) -> float:
            """Power of the residual that so many waves over the range explain."""
            period = within(PositionMap, {"period_m": range_m / waves})
            columns = _orthogonal(known, PositionMap(**period).columns(motion))
            moment = columns.T @ residual
            return float(moment @ np.linalg.lstsq(columns.T @ columns, moment, rcond=1e-9)[0])

        range_m = regression.extent.range_m
        tried = np.arange(LEAST_WAVES + _WAVE_STEP, _MOST_WAVES, _WAVE_STEP)
        powers, tops = np.array([power(waves) for waves in tried]), []
        for _ in range(count):
            tops.append(float(tried[int(np.argmax(powers))]))
            powers[np.abs(tried - tops[-1]) < _APART] = 0.0
        near = [(waves - _WAVE_STEP, waves + _WAVE_STEP) for waves in sorted(tops, reverse=True)]
        best = [minimize_scalar(lambda w: -power(w), bounds=ends, method="bounded").x for ends in near]
        return [(range_m / float(waves),) for waves in best]

    def resolved(self, name: str, shape: Shape) -> bool:
        """True if the motion can show a mode of that shape (Hz, damping ratio): not too far above the
        motion's own frequencies, and wider than three harmonics where the motion repeats. True for what is no
        mode.
        """
        if base_name(name) != UnmodelledResonance.name:
            return True
        period_s = self._motion_period_s
        reach_hz = self.regression.signals.motion_reach_hz
        if shape[0] > (0.9 if name.endswith(":free") else _SEEN_FROM_BELOW) * reach_hz:
            return False
        return period_s is None or 2.0 * shape[0] * shape[1] * period_s > _LEAST_LINES

    @cached_property
    def _motion_period_s(self) -> float | None:
        """Period in s of the speed, which a creeping middle does not change; None when it does not repeat."""
        signals = self.regression.signals
        piece = max(signals.piecewise(), key=lambda p: p.stop - p.start)
        v = signals.fine_v[piece][signals.recorded[piece]]
        rate = 1.0 / float(signals.fine_t[piece][1] - signals.fine_t[piece][0])
        power = np.abs(np.fft.rfft(v - np.mean(v), 2 * len(v))) ** 2
        likeness = np.fft.irfft(power)[: len(v) // 2] / (1.0 - np.arange(len(v) // 2) / len(v))
        falling = np.flatnonzero(likeness < 0.5 * likeness[0])
        if not len(falling):
            return None
        again = falling[0] + np.flatnonzero(likeness[falling[0] :] > _ALIKE * likeness[0])
        if not len(again):
            return None
        first = likeness[again[0] : again[0] + max(2, int(again[0]) // 4)]  # the whole of the first peak
        return float(again[0] + int(np.argmax(first))) / rate

    def echo(self, fit: ModelFit, name: str) -> bool:
        """True if most of the power of a pulsation of the fit is at harmonics, up to the tenth, of a motion
        that repeats; of one whose rate varies, most of the time. False where the motion does not repeat.
        """
        period_s, rates = self._motion_period_s, np.array(fit.model[name])
        if period_s is None:
            return False
        periods = self.regression.extent.duration_s / period_s
        power = np.sum(fit.of(name).reshape(-1, 2, 3)[-1] ** 2, axis=0)
        cycles = period_s * np.outer(rates, np.arange(1, len(power) + 1))
        # of few periods only what lies closer than a line is wide counts, or all would be harmonics
        width = (1.5 if periods >= _MANY else 0.5) / periods
        near = (np.abs(cycles - np.round(cycles)) < width) & (cycles < _HIGHEST_ORDER + 0.5)
        return bool(np.mean(near @ power) > 0.5 * power.sum())


def _orthogonal(known: Floats, columns: Floats) -> Floats:
    return np.asarray(columns - known @ (known.T @ columns))


_BEYOND = 1.2  # of the logarithm of a shape: how far beyond its grid it is searched
_BEYOND_LINEAR = 0.15  # of the grid's range: the same where the scale is linear


class Refiner:
    """Fits models to one regression and refines their shapes; `evaluations` counts the least squares."""

    def __init__(self, regression: RecordingRegression) -> None:
        self.regression, self.periods = regression, Periods(regression)
        self.evaluations = 0

    def fit(self, model: Model) -> ModelFit:
        self.evaluations += 1
        return self.regression.fit(model)

    def refined(self, fit: ModelFit, only: str | None = None, sweeps: int = 2, most: int = 70) -> ModelFit:
        """Returns the fit with shapes refined, cause by cause, in up to `sweeps` rounds while that helps: one
        shape by a bounded search between its neighbours on the grid, several of one cause jointly by a
        simplex of at most `most` trials, a rhythm's course by Gauss-Newton steps. `only`: the one cause
        that is refined.
        """
        names = [n for n, shape in fit.model.items() if shape and (only is None or n == only)]
        for sweep in range(sweeps if len(names) > 1 or any(len(fit.model[n]) > 1 for n in names) else 1):
            before = fit.score
            for name in names:
                if isinstance(CANDIDATES[name], Rhythm) and len(fit.model[name]) > 1:
                    fit = self._refine_course(fit, name)
                elif len(fit.model[name]) > 1:
                    fit = self._refine_jointly(fit, name, most)
                else:
                    fit = self._refine_alone(fit, name, sweep == 0)
            if before - fit.score < 0.5:
                break
        return fit

    def _refine_jointly(self, fit: ModelFit, name: str, most: int) -> ModelFit:
        """Refines shapes of one cause that trade against each other by a simplex, on their logarithms where
        the candidate says so; else in their ranges on the grid. Returns the best feasible fit (or the one
        given); an infeasible one if its mode shows no peak and it scores better by 1.
        """
        best = lowest = fit
        logarithmic = CANDIDATES[name].logarithmic
        grid = np.array(CANDIDATES[name].grid(self.regression.extent))
        zero, scale = (np.zeros(1), np.ones(1)) if logarithmic else (grid.min(axis=0), np.ptp(grid, axis=0))
        scale = np.where(scale > 0.0, scale, 1.0)  # of a shape that has one value on the grid
        grid = np.log(grid) if logarithmic else (grid - zero) / scale
        beyond = _BEYOND if logarithmic else _BEYOND_LINEAR
        low, high = grid.min(axis=0) - beyond, grid.max(axis=0) + beyond
        if not logarithmic:  # what is positive everywhere on the grid stays so
            low = np.where(zero > 0.0, np.maximum(low, -zero / scale), low)
        shape = np.array(fit.model[name])
        start = np.log(shape) if logarithmic else (shape - zero) / scale
        steps = [0.5 / max(1, len(np.unique(column)) - 1) for column in grid.T]

        def cost(z: Floats) -> float:
            """Score of a point; 1000 worse out of bounds, where the motion does not resolve it, or infeasible
            but for a mode without a peak. Remembers the best feasible fit, and the lowest of those and such
            modes.
            """
            nonlocal best, lowest
            values = np.exp(z) if logarithmic else zero + scale * z
            shape = tuple(float(value) for value in values)
            if (z < low).any() or (z > high).any() or not self.periods.resolved(name, shape):
                return fit.score + 1e3
            trial = self.fit({**fit.model, name: shape})
            if trial.score < best.score and trial.feasible:
                best = trial
            if trial.score < lowest.score and (trial.feasible or self.regression.no_peak(trial.model)):
                lowest = trial
            return trial.score + (0.0 if trial.feasible or self.regression.no_peak(trial.model) else 1e3)

        minimize(
            cost,
            start,
            method="Nelder-Mead",
            options={
                "maxfev": most,
                "xatol": 1e-3,
                "fatol": 0.1,
                "initial_simplex": None if logarithmic else np.vstack([start, start + np.diag(steps)]),
            },
        )
        return best if best.score < lowest.score + 1.0 else lowest

    def _refine_alone(self, fit: ModelFit, name: str, wide: bool) -> ModelFit:
        """Refines the one shape of a cause by a bounded search; returns the best feasible fit or `fit`."""
        low, high, logarithmic = self._bracket(CANDIDATES[name], fit.model[name][0], wide)
        best = fit

        def cost(z: float) -> float:
            """Score; remembers the best feasible fit."""
            nonlocal best
            value = float(np.exp(z)) if logarithmic else float(z)
            trial = self.fit({**fit.model, name: (value,)})
            if trial.feasible and trial.score < best.score:
                best = trial
            return trial.score

        minimize_scalar(
            cost, bounds=(low, high), method="bounded", options={"maxiter": 12, "xatol": 1e-3 * (high - low)}
        )
        return best

    def _refine_course(self, fit: ModelFit, name: str) -> ModelFit:
        """Refines the course of a rhythm's rate by Gauss-Newton steps on coefficients and course, damped by
        what is known of rates; returns the best feasible fit, or the one given.
        """
        for _ in range(_STEPS):
            design, shape = self.regression.design(fit.model), np.array(fit.model[name])
            left = self.regression.target - design @ fit.coefficients
            both = np.hstack([design, self.regression.slopes_of_course(fit, name)])
            known = np.repeat([0.0, (VARIES * np.mean(shape)) ** -2.0], [design.shape[1], len(shape)])
            scale = np.sqrt(np.sum(both**2, axis=0) + known + 1e-300)
            gram = (both / scale).T @ (both / scale) + np.diag(known / scale**2 + _SINGULAR)
            step = (np.linalg.solve(gram, (both / scale).T @ left) / scale)[-len(shape) :]
            trials = [np.maximum(shape + part * step, 0.3 * shape) for part in (1.0, 0.3)]
            fits = [self.fit({**fit.model, name: tuple(rates.tolist())}) for rates in trials]
            best = min(
                (trial for trial in fits if trial.feasible), key=lambda trial: trial.score, default=fit
            )
            if best.score > fit.score - 0.5:
                return min(fit, best, key=lambda trial: trial.score)
            fit = best
        return fit

    def _bracket(self, candidate: Candidate, value: float, wide: bool) -> tuple[float, float, bool]:
        """(low, high, True if logarithms): bounds of the search of a cause's one shape about `value`. `wide`:
        as far as its neighbours on the grid, or as a line or wave is resolved; else a fifth of that or less.
        """
        if isinstance(candidate, Periodic | Rhythm):
            reach = (0.6 if wide else 0.1) / self.regression.extent.duration_s
            low_hz = max(value - min(reach, 0.3 * value), self.periods.lowest_hz)
            return min(low_hz, value), value + reach, False
        if isinstance(candidate, PositionWave):
            reach = (0.5 if wide else 0.1) / self.regression.extent.range_m
            longest_m = self.regression.extent.range_m / LEAST_WAVES
            return 1.0 / (1.0 / value + reach), 1.0 / max(1.0 / value - reach, 1.0 / longest_m), False
        grid = sorted({point[0] for point in candidate.grid(self.regression.extent)})
        if candidate.logarithmic:
            ratio = float(np.log(grid[-1] / grid[0])) / (len(grid) - 1) * (1.0 if wide else 0.15)
            low, high = float(np.log(grid[0])), float(np.log(grid[-1])) + 0.2
            at = min(max(float(np.log(value)), low), high)
            return max(at - ratio, low - 0.2), min(at + ratio, high), True
        step = (grid[-1] - grid[0]) / (len(grid) - 1) * (1.0 if wide else 0.15)
        at = min(max(value, grid[0]), grid[-1])
        return max(at - step, grid[0]), min(at + step, grid[-1]), False


ADD = 12.0
"""How much the penalised -2 log likelihood must fall for a change of the model."""

ASYMMETRIC = "coulomb_friction:asymmetric"
MOST_CAUSES = 3
"""Beside a bias: more names than that are what one cause without a name looks like."""
MOST_EVALUATIONS = 15_000
"""Least squares after which the search takes no further step."""
_STARTS, _MOST_STEPS = 3, 18
_MISSED = 0.5  # of what the search leaves of the force's variance: plain regressions that leave less saw more
_FAMILIES: dict[Family, frozenset[str]] = {
    "friction": frozenset({CoulombFriction.name, PreslidingHysteresis.name}),
    "relaxation": frozenset({StressRelaxation.name}),
    "stiffening": frozenset({Stiffening.name}),
}
_ROUGH = 30
_NEAR, _NEARER = 0.3, 0.1
"""An exchange is refined when it is so near on the grid, and all shapes with it when the new one's alone are;
in what the cause explains.
"""
_SAME = 3.0
"""Scores of one and the same model that was refined on two ways."""
_CLEARLY = 0.01
"""Of the residual's power: less is within how columns are sampled and noise is coloured."""
_SUBHARMONIC = 15.0
"""How much better a weaker line or half of a frequency must be: both can hold the strongest as harmonic."""
_MORE_THAN_NOISE = 1.2  # times the rms of the noise, which is known to about that
_MUCH = 2.0  # ratio of rms from which a form has to explain much
_PRACTICAL = 1.1
"""By how much the residual's rms must fall with several causes at once: less is within what is left
unexplained."""


class Search(Refiner):
    """Searches models of one regression; fits are remembered.

    Args:
        regression: the recording.
        names: the candidates that may be used; by default all that are known now.
        noise_n: rms of the noise in the band; 0 where it is not known.
    """

    def __init__(
        self, regression: RecordingRegression, names: Iterable[str] | None = None, noise_n: float = 0.0
    ) -> None:
        super().__init__(regression)
        self.noise_n = noise_n
        self.names = [name for name in (CANDIDATES if names is None else names) if name in CANDIDATES]

    def run(self, start: Model, passed: dict[frozenset[str], float] | None = None) -> ModelFit:
        """Goes from `start`, refined, to the model that no step betters: each the first that helps of drop,
        exchange and add, while steps and evaluations last. Returns its fit, friction made symmetric if that
        fits.

        `passed`: names and scores of the models that runs went on from, added to here; a run that meets one
        ends there.
        """
        passed = {} if passed is None else passed
        best = self._sound(self.refined(self.fit(start)))
        for _ in range(_MOST_STEPS):
            names = frozenset(best.model)
            if self.evaluations > MOST_EVALUATIONS or passed.get(names, np.inf) < best.score + _SAME:
                break
            passed[names] = best.score
            step = self._backward(best) or self._exchange(best) or self._forward(best)
            if step is None:
                break
            best = step
        return self._symmetric(best)

    def _sound(self, fit: ModelFit) -> ModelFit:
        """Drops causes until the fit is feasible, the least needed first of those that make it so."""
        while not fit.feasible and fit.model:
            fit = min(
                (self.without(fit, name) for name in fit.model), key=lambda t: (not t.feasible, t.score)
            )
        return fit

    def _symmetric(self, fit: ModelFit) -> ModelFit:
        """Replaces friction that differs by direction by friction and a bias, if that fits about as well;
        then drops a cause that is not worth its place. Else returns the fit as it is.
        """
        others = base_name(ASYMMETRIC), "bias"
        if ASYMMETRIC not in fit.model or "bias" in fit.model or not set(others) <= set(self.names):
            return fit
        rest = {name: shape for name, shape in fit.model.items() if name != ASYMMETRIC}
        offset = self.fit({**rest, **dict.fromkeys(others, ())})
        if not offset.feasible or offset.score > fit.score + max(ADD, _CLEARLY * fit.n):
            return fit
        return self._backward(offset) or offset

    def run_from_several(self, enough_n: float | None) -> ModelFit:
        """Best of several runs: from nothing, alone where that finds nothing; and from other first causes
        with one more added, three of these, or one where less than `enough_n` in N is left. Where `look`
        explains clearly more, those of its family come first.

        Steps one at a time can walk past a pair of causes whose mixture looks like a third.
        """
        passed: dict[frozenset[str], float] = {}
        best = self.run({}, passed)
        if not best.model:
            return best
        starts = 1 if enough_n is not None and self.plain_rms(best) < enough_n else _STARTS
        look = self.regression.look
        force_n = float(np.std(self.regression.signals.force[self.regression.rows]))
        missed = 1.0 - look.explained < _MISSED * (self.plain_rms(best) / force_n) ** 2
        family = _FAMILIES[look.family] if missed and look.family else frozenset[str]()
        empty = self.fit({})
        scanned = self._scans(empty, self._worth_trying(best))
        ranked = sorted(scanned, key=lambda s: not family & set(map(base_name, s.model)))
        tried = {base_name(name) for name in best.model}
        alone = len(tried)
        for start in ranked:
            (name,) = start.model
            if base_name(name) in tried or len(tried) >= starts + alone:
                continue
            tried.add(base_name(name))
            # without one more cause the first exchange would end where the other began
            grown = self._forward(self.refined(start))
            other = best if grown is None else self.run(grown.model, passed)
            if other.score < best.score - ADD:
                best = other
        return best

    def best_with(self, fit: ModelFit, name: str, near: float = np.inf) -> ModelFit | None:
        """Fit with one more cause, refined; None when none is feasible or its grid score is above `near`."""
        refined = [self.refined(coarse, only=name) for coarse in self._scans(fit, [name], near=near)]
        return refined[0] if refined and refined[0].feasible else None

    def _scans(
        self, fit: ModelFit, names: Iterable[str], most: int | None = None, near: float = np.inf
    ) -> list[ModelFit]:
        """Fits with one more cause, each at its best shape of `_shapes`, not refined, the best first: `most`
        of those with a score up to `near`, without causes that explain too little. Branch and bound: only
        shapes are fitted that can be among them.
        """
        scans: list[ModelFit] = []
        shapes = {name: self._shapes(fit, name) for name in names}
        bounds = self.regression.lowest_scores(fit.model, shapes)
        for name in sorted(shapes, key=lambda name: float(np.min(bounds[name], initial=np.inf))):
            scan = self._scan(fit, name, shapes[name], bounds[name], near)
            if scan is not None and not self._explains_too_little(scan, fit):
                scans = sorted([*scans, scan], key=lambda scan: scan.score)[:most]
            if len(scans) == most:
                near = min(near, scans[-1].score)
        return scans

    def _scan(
        self, fit: ModelFit, name: str, shapes: list[Shape], bounds: Floats, near: float
    ) -> ModelFit | None:
        """Best feasible fit with one more cause at one of these shapes, of a score below `near`, or None;
        without pulsations that echo the motion. Of what repeats a later shape has to be clearly better.
        """
        best: ModelFit | None = None
        periodic = isinstance(CANDIDATES[name], Periodic | Rhythm)
        repeats = periodic or isinstance(CANDIDATES[name], PositionWave)
        # of what repeats the strongest line comes first, and a weaker one has to be clearly better
        for i in range(len(shapes)) if repeats else np.argsort(bounds, kind="stable"):
            limit = near if best is None else best.score - (_SUBHARMONIC if repeats else 0.0)
            if bounds[i] > limit:
                continue
            trial = self.fit({**fit.model, name: shapes[i]})
            better = trial.score < limit and trial.feasible
            if better and not (periodic and self.periods.echo(trial, name)):
                best = trial
        return best

    def _shapes(self, fit: ModelFit, name: str) -> list[Shape]:
        """Shapes to try for a cause: of what repeats the lines or waves of the residual, else those of its
        grid, of a mode only those that the motion resolves.
        """
        if isinstance(CANDIDATES[name], Periodic):
            return self.periods.lines(fit)
        if isinstance(CANDIDATES[name], PositionWave):
            return self.periods.over_position(fit)
        if isinstance(candidate := CANDIDATES[name], Rhythm):
            return self.periods.courses(fit, candidate)
        if base_name(name) == UnmodelledResonance.name:
            return [
                s for s in CANDIDATES[name].grid(self.regression.extent) if self.periods.resolved(name, s)
            ]
        return CANDIDATES[name].grid(self.regression.extent)

    def _forward(self, fit: ModelFit) -> ModelFit | None:
        """Best refined fit with one more cause; None if none is worth it. Costly causes (many shapes) only
        beside at most a bias, and if more than noise is left.
        """
        best = self._best_of(fit, [name for name in self.names if not CANDIDATES[name].costly])
        if self._leaves_more_than_noise(best or fit):
            costly = self._best_of(fit, [name for name in self._worth_trying(fit) if CANDIDATES[name].costly])
            trials = (trial for trial in (best, costly) if trial)
            best = min(trials, key=lambda trial: trial.score, default=None)
        return best

    def _best_of(self, fit: ModelFit, names: Iterable[str]) -> ModelFit | None:
        """Best of the fits with one of these causes more, the four best on their grids refined; None when
        none is feasible or the best is not worth it. Passes over causes kin to one in the model.
        """
        refined = [
            self.refined(trial, only=next(iter(set(trial.model) - set(fit.model))), most=_ROUGH)
            for trial in self._scans(fit, [name for name in names if self.open_to(fit, name)], most=4)
        ]
        refined = [trial for trial in refined if trial.feasible]
        if not refined:
            return None
        best = self.refined(min(refined, key=lambda trial: trial.score))
        return best if best.feasible and self.worth(best, fit) else None

    def _worth_trying(self, fit: ModelFit, rest: ModelFit | None = None) -> list[str]:
        """Names to try; costly ones if `fit` leaves more than noise and `rest` (or `fit`) has no cause."""
        alone = not set((rest or fit).model) - {"bias"}
        much = alone and self._leaves_more_than_noise(fit)
        return [name for name in self.names if much or not CANDIDATES[name].costly]

    def _leaves_more_than_noise(self, fit: ModelFit) -> bool:
        return self.plain_rms(fit) > _MORE_THAN_NOISE * self.noise_n

    def open_to(self, fit: ModelFit, name: str) -> bool:
        """True if neither a form of that name nor another description of the same contact is in the model,
        nor three causes; a bias is open beside these, too.
        """
        full = name != "bias" and len(set(fit.model) - {"bias"}) >= MOST_CAUSES
        return not full and kin(name) not in map(kin, fit.model)

    def worth(self, more: ModelFit, less: ModelFit) -> bool:
        """True if the larger model's score is better, and the residual's rms, whitened or plain, smaller by
        enough: by as much as the one cause more asks for, or defaults for several.
        """
        names = set(more.model) - set(less.model)
        new = CANDIDATES[names.pop()] if len(names) == 1 else None
        if less.score - more.score < (ADD if new is None else new.least_score):
            return False
        ratio = _PRACTICAL if new is None else new.least_ratio
        return less.rss > more.rss * ratio**2 or self.plain_rms(less) > self.plain_rms(more) * ratio

    def _explains_too_little(self, more: ModelFit, less: ModelFit) -> bool:
        """True if the one cause more has to explain much and does not: it would hide one that is worth it."""
        (name,) = set(more.model) - set(less.model)
        return CANDIDATES[name].least_ratio >= _MUCH and not self.worth(more, less)

    def plain_rms(self, fit: ModelFit) -> float:
        """rms of the residual in N, not whitened."""
        return float(np.sqrt(np.mean(self.regression.residual(fit)[self.regression.rows] ** 2)))

    def _backward(self, fit: ModelFit) -> ModelFit | None:
        """Best feasible fit without one of the causes that are not worth their place; None without such."""
        smaller = [self.without(fit, name) for name in fit.model]
        smaller = [trial for trial in smaller if trial.feasible and not self.worth(fit, trial)]
        return min(smaller, key=lambda trial: trial.score) if smaller else None

    def without(self, fit: ModelFit, name: str) -> ModelFit:
        rest = {n: shape for n, shape in fit.model.items() if n != name}
        return self.refined(self.fit(rest), sweeps=1)

    def _exchange(self, fit: ModelFit) -> ModelFit | None:
        """Best refined fit in which one cause gave way to another; None where none is feasible and scores
        better by 2 (while the noise is taken for white by 1 % of the rows, if that is more).
        """
        if not fit.model:
            return None
        # while the noise is taken for white, which overstates it, the residual's power must fall by 1 %, too
        least = 2.0 if self.regression.coloured else max(2.0, _CLEARLY * fit.n)
        best: ModelFit | None = None
        for name in fit.model:
            rest = self.fit({n: shape for n, shape in fit.model.items() if n != name})
            others = [
                other
                for other in self._worth_trying(fit, rest)
                if other not in fit.model and self.open_to(rest, other)
            ]
            reach = abs(rest.score - fit.score)
            for trial in self._scans(rest, others, most=2, near=fit.score + _NEAR * reach):
                (new,) = set(trial.model) - set(rest.model)
                rough = self.refined(trial, only=new, most=_ROUGH)
                better = self.refined(rough) if rough.score < fit.score + _NEARER * reach else rough
                # what a rhythm leaves is learned as noise, beside which its harmonic may look the better one
                if isinstance(CANDIDATES[new], Rhythm) and self.plain_rms(better) > self.plain_rms(fit):
                    continue
                sound = better.feasible and not self._explains_too_little(better, rest)
                if sound and better.score < (best or fit).score - least:
                    best = better
        return best
