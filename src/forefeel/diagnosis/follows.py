"""Variables that the residual follows, by held-out regressions without physics.

Each variable gets the same: triangles over its range beside the model's own columns, ridge regression, scored
on held-out blocks. Where one gains clearly, something is there that no named cause explains, and its variable
says where to look for it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from forefeel.common.causes.catalogue import cause_class
from forefeel.common.causes.motion import Lag, MotionGrid
from forefeel.common.causes.periodic import Pulsation
from forefeel.common.error_size import Floats
from forefeel.diagnosis.regression import ModelFit, RecordingRegression, alignment
from forefeel.diagnosis.uncertainty import columns, gain, held_out
from forefeel.diagnosis.verdict import Follows, HeldOut

_RIDGES = 1e-4, 1e-2
_LAGS_S = 0.03, 0.1, 0.3, 1.0
_LEAST_SHARE = 0.15  # of the residual's variance: a variable that explains less is not told
_MOST_TOLD = 3
_AS_GOOD = 1.15  # times what the best variable leaves: a simpler one that leaves no more is told first
_HALF = 0.5  # of what any other leaves, that time or a further column has to leave: they imitate what is slow
_LEAST_CYCLES = 3.0  # of a rhythm
_OF_TIME = "time", "rate varies"  # variables that noise with a memory follows, too
_SINGLE = "direction", "position", "speed", "acceleration", "size of the force"
_STEP_S, _MOST_KNOTS = 0.7, 60  # s between the knots of a function of time, and their number
_SLOW_STEP_S, _MOST_SLOW_KNOTS = 2.5, 24  # the same of a rhythm's size
_LOW_SPEEDS = 0.01, 0.03, 0.1, 0.3  # of the 90 % quantile of the speed, where friction bends

Columns = Callable[[], Floats]


@dataclass(frozen=True, eq=False)
class Leftover:
    """Residual of a fit, regressed on every variable."""

    regression: RecordingRegression
    fit: ModelFit

    @cached_property
    def _variables(self) -> dict[str, Columns]:
        """Functions by variable that make its columns, shape (coarse samples, columns); those of the motion
        filtered and late as the cell shows them.
        """
        return {**self._motion_columns(), **self._time_columns()}

    def _motion_columns(self) -> dict[str, Columns]:
        """Functions, by variable, that make the columns of the motion, of each further column and its speed,
        and of the size of the predicted force.
        """
        m = self.regression.motion(self.fit.model)
        x, v, a, way, since = m.x, m.v, m.a, m.direction(), _since_reversal(m)
        usual = float(np.quantile(np.abs(v), 0.9))
        low = usual * np.array([*(-s for s in _LOW_SPEEDS), 0.0, *_LOW_SPEEDS])
        speeds = np.unique(np.concatenate([_knots(v, 12), low]))
        past = (v, np.abs(v), v * np.abs(v))
        lagged = [(w, np.exp(-m.dt / lag_s)) for lag_s in _LAGS_S for w in past]
        tables: dict[str, Callable[[], list[Floats]]] = {
            "direction": lambda: [way],
            "position": lambda: _bumps(x, _knots(x, 24)),
            "speed": lambda: _bumps(v, speeds),
            "acceleration": lambda: _bumps(a, _knots(a, 12)),
            "way since the last reversal": lambda: [b * way for b in _bumps(since, _knots(since, 10))],
            "past motion": lambda: [m.through(Lag().step, w, decay) for w, decay in lagged],
            "position, in and out apart": lambda: [
                b * (s * way > 0.0) for b in _bumps(x, _knots(x, 24)) for s in (1.0, -1.0)
            ],
            "position times speed": lambda: _products(x, v),
            "speed times acceleration": lambda: _products(v, a),
        }
        for name, c in m.further.items():
            for variable, u in ((name, c), (f"speed of {name}", np.gradient(c, m.t))):
                tables[variable] = partial(_bumps, u, _knots(u, 12))
        force = self.regression.predicted(self.fit)
        made: dict[str, Columns] = {name: partial(self._as_measured, table) for name, table in tables.items()}
        return {**made, "size of the force": lambda: np.column_stack(_bumps(force, _knots(force, 12)))}

    def _time_columns(self) -> dict[str, Columns]:
        """Functions that make the columns of time, and of one rhythm (`_line_hz`), which may last, act while
        the motion does, grow with depth, or vary in rate.
        """
        regression, t = self.regression, self.regression.signals.t
        line_hz, duration_s = self._line_hz(), regression.extent.duration_s
        m = regression.motion(self.fit.model)
        speed, depth = (np.interp(t, m.t, values) for values in (np.abs(m.v), m.x))
        moves = np.tanh(speed / max(float(np.median(speed)), 1e-12))
        rhythm = f"rhythm of {line_hz:.2g} Hz"

        def course(step_s: float, most: int) -> Floats:
            count = int(np.clip(duration_s / step_s, 8, most))
            return np.column_stack(_bumps(t, np.linspace(t[0], t[-1], count)))

        slowly = course(_SLOW_STEP_S, _MOST_SLOW_KNOTS)

        def waves(harmonics: int) -> Floats:
            turns = 2.0 * np.pi * line_hz * t
            return np.column_stack([w(n * turns) for n in range(1, harmonics + 1) for w in (np.sin, np.cos)])

        return {
            "time": lambda: course(_STEP_S, _MOST_KNOTS),
            rhythm: lambda: waves(3),
            f"{rhythm} while it moves": lambda: moves[:, None] * waves(2),
            f"{rhythm} that grows with depth": lambda: np.hstack([waves(2), depth[:, None] * waves(2)]),
            f"{rhythm}, rate varies": lambda: np.hstack([slowly * wave[:, None] for wave in waves(2).T]),
        }

    def _line_hz(self) -> float:
        """Frequency in Hz of the fit's first pulsation, the mean of a rate that varies; without one, of the
        strongest line of the residual that has three cycles or more.
        """
        for name, shape in self.fit.model.items():
            if issubclass(cause_class(name), Pulsation):
                return float(np.mean(shape))
        signals = self.regression.signals
        left = np.where(signals.rows, self.regression.residual(self.fit), 0.0)
        left -= np.mean(left[signals.rows]) * signals.rows
        power = np.abs(np.fft.rfft(left * np.hanning(len(left)), 8 * len(left)))
        frequency = np.fft.rfftfreq(8 * len(left), 1.0 / signals.coarse_rate_hz)
        power[frequency < _LEAST_CYCLES / self.regression.extent.duration_s] = 0.0
        return float(frequency[int(np.argmax(power))])

    def _as_measured(self, table: Callable[[], list[Floats]]) -> Floats:
        """Columns of the fine grid, late and filtered as the cell shows them, on the coarse grid."""
        signals = self.regression.signals
        factor = alignment(signals.omega, self.fit.model)
        spectra = signals.spectrum(np.array(table()))
        return signals.column(spectra if factor is None else spectra * factor).T

    def _gain_of(self, extra: Floats) -> HeldOut:
        """Held-out gain of the fit's columns with `extra` ones (coarse grid, not whitened) over the fit's
        columns alone, with the better of two ridges on the extra ones.
        """
        both = (self._errors_beside(self._columns, extra, ridge) for ridge in _RIDGES)
        gains = (gain(self.regression, self._errors_alone, errors) for errors in both)
        return max(gains, key=lambda trial: trial.gain)

    def gain_beside(self, plain: ModelFit) -> float:
        """Lower end of the held-out gain of the fit over `plain`, both with the columns of the single
        variable that explains most of the residual; infinite where none explains half of it.
        """
        most = max(_SINGLE, key=lambda name: self._gains[name][1].gain)
        if _share(self._gains[most][1]) < _HALF:
            return np.inf
        return self._gain_low_beside(self._variables[most](), columns(self.regression, plain))

    def gain_beside_motion(self, plain: ModelFit) -> float:
        """Lower end of the held-out gain of the fit over `plain`, both with the columns of one variable of
        the motion; the least over all these variables but the size of the force, which has what is fitted in
        it.
        """
        of_plain = columns(self.regression, plain)
        tables = (make() for name, make in self._motion_columns().items() if name != _SINGLE[-1])
        return min(self._gain_low_beside(extra, of_plain) for extra in tables)

    def _gain_low_beside(self, extra: Floats, of_plain: tuple[Floats, Floats]) -> float:
        """Lower end of the held-out gain of the fit's columns over plainer ones, `extra` beside both."""
        both = of_plain, self._columns
        before, after = (self._errors_beside(of_fit, extra, _RIDGES[-1]) for of_fit in both)
        return gain(self.regression, before, after).gain_low

    @cached_property
    def _columns(self) -> tuple[Floats, Floats]:
        """(whitened, plain) columns of the fit."""
        return columns(self.regression, self.fit)

    @cached_property
    def _errors_alone(self) -> Floats:
        """Held-out errors of the fit's columns."""
        return held_out(self.regression, *self._columns)

    def _errors_beside(self, of_fit: tuple[Floats, Floats], extra: Floats, ridge: float) -> Floats:
        """Held-out errors in N of a fit's columns, `of_fit` (whitened, plain), with `extra` ones (plain,
        coarse grid) beside them, `ridge` on these.
        """
        regression, pieces = self.regression, self.regression.signals.piecewise(fine=False)
        white, plain = of_fit
        extra_white = regression.noise.whiten(extra, pieces)[regression.rows] / regression.noise.innovation_n
        weights = np.repeat([1e-10, ridge], [white.shape[1], extra.shape[1]])
        both = np.hstack([white, extra_white]), np.hstack([plain, extra[regression.rows]])
        return held_out(regression, *both, ridge=weights)

    @cached_property
    def _gains(self) -> dict[str, tuple[int, HeldOut]]:
        """Number of columns and held-out gain of each variable."""
        tables = ((variable, make()) for variable, make in self._variables.items())
        return {variable: (table.shape[1], self._gain_of(table)) for variable, table in tables}

    def largest_share(self, gain_low: float = 0.0) -> float:
        """Share of the residual's variance that the best variable explains, of those whose gain has a lower
        end above `gain_low`; 0 without one. Functions of time do not count: coloured noise is one.
        """
        gains = (held for name, (_, held) in self._gains.items() if not name.endswith(_OF_TIME))
        return max((_share(held) for held in gains if held.gain_low > gain_low), default=0.0)

    def share_of_one(self, with_time: bool) -> float:
        """Largest share of the residual's variance that a function of one single variable explains, 0 or
        more; `with_time`: of time, too. Pairs and memories, which explain anything where strokes repeat, do
        not count.
        """
        single = (*_SINGLE, "time") if with_time else _SINGLE
        return max(_share(self._gains[name][1]) for name in single)

    def follows(self) -> tuple[Follows, ...]:
        """Up to three variables that clearly explain over 15 % of the residual's variance: first the simplest
        of those that leave about the least, then by share. Time and further columns count only if they leave
        less than half of what all others do. Empty without any.
        """
        place = self._place_m()
        clear = [
            (count, Follows(name, _share(held), *place))
            for name, (count, held) in self._gains.items()
            if _share(held) > _LEAST_SHARE and held.gain_low > 0.0
        ]
        slow = {"time", *self.regression.extent.names}
        others = max((f.share for _, f in clear if f.variable not in slow), default=0.0)
        needed = 1.0 - _HALF * (1.0 - others)
        clear = [(count, f) for count, f in clear if f.variable not in slow or f.share > needed]
        if not clear:
            return ()
        left = 1.0 - max(f.share for _, f in clear)
        first = min((pair for pair in clear if 1.0 - pair[1].share <= _AS_GOOD * left), key=lambda p: p[0])[1]
        rest = sorted((f for _, f in clear if f is not first), key=lambda f: -f.share)
        return (first, *rest[: _MOST_TOLD - 1])

    def _place_m(self) -> tuple[float, float]:
        """Positions between which four fifths of the residual's power stand, a tenth to either side."""
        signals, rows = self.regression.signals, self.regression.rows
        x = signals.column(signals.linear_spectrum(0))[rows]
        order = np.argsort(x)
        power = np.cumsum(self.regression.residual(self.fit)[rows][order] ** 2)
        low, high = x[order][np.searchsorted(power, np.array([0.1, 0.9]) * power[-1])].tolist()
        return low, high


def _share(held: HeldOut) -> float:
    return 1.0 - (1.0 - max(held.gain, 0.0)) ** 2


def _products(a: Floats, b: Floats) -> list[Floats]:
    return [p * q for p in _bumps(a, _knots(a, 6)) for q in _bumps(b, _knots(b, 6))]


def _knots(values: Floats, count: int) -> Floats:
    """Knots from the 1 % to the 99 % quantile, halfway between even places and quantiles."""
    low, high = np.quantile(values, (0.01, 0.99))
    even = np.linspace(low, high, count)
    return 0.5 * (even + np.quantile(values, np.linspace(0.01, 0.99, count)))


def _bumps(values: Floats, knots: Floats) -> list[Floats]:
    """Triangles that sum to one."""
    return [np.interp(values, knots, row) for row in np.eye(len(knots))]


def _since_reversal(motion: MotionGrid) -> Floats:
    """Distance from the position where the direction last changed, or the piece began, in m at each fine
    sample; speeds within the band keep the direction.
    """
    away = np.empty_like(motion.x)
    for piece in motion.pieces:
        x = motion.x[piece]
        s = np.sign(np.where(np.abs(motion.v[piece]) > motion.speed_band, motion.v[piece], 0.0))
        held = s[np.maximum.accumulate(np.where(s != 0.0, np.arange(len(s)), 0))]
        turned = np.concatenate([[True], np.diff(held) != 0.0])
        origin = np.maximum.accumulate(np.where(turned, np.arange(len(s)), 0))
        away[piece] = np.abs(x - x[origin])
    return away
