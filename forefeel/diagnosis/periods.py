"""Periods: of lines in a residual, and of the motion itself, whose harmonics look like lines."""

from functools import cached_property

import numpy as np
from scipy.fft import rfft, rfftfreq
from scipy.optimize import minimize_scalar

from forefeel.common.causes.candidate import Shape, base_name
from forefeel.common.causes.motion import Motion
from forefeel.common.causes.periodic import PositionMap, Pulsation
from forefeel.common.causes.unmodelled_resonance import UnmodelledResonance
from forefeel.common.error_size import Floats
from forefeel.diagnosis.regression import ModelFit, RecordingRegression

PULSATION_HZ = 0.12, 4.0
_LEAST_CYCLES = 5.0  # of a pulsation: fewer are not told from a force that wanders
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
    def __init__(self, regression: RecordingRegression) -> None:
        self.regression = regression
        self.lowest_hz = max(PULSATION_HZ[0], _LEAST_CYCLES / regression.extent.duration_s)

    def lines(self, fit: ModelFit, count: int = 4) -> list[Shape]:
        """Frequencies in Hz of the strongest lines of the residual where pulses can be, and their halves."""
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
            columns = _orthogonal(known, PositionMap(period_m=range_m / waves).columns(motion))
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
        """True if the motion has frequencies within a mode's width; one that repeats has harmonics only."""
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

    def echo(self, fit: ModelFit) -> bool:
        """True if most of the pulsation's power is at harmonics of a motion that repeats."""
        period_s, (frequency_hz,) = self._motion_period_s, fit.model[Pulsation.name]
        if period_s is None:
            return False
        periods = self.regression.extent.duration_s / period_s
        power = np.sum(fit.of(Pulsation.name).reshape(2, -1) ** 2, axis=0)
        cycles = frequency_hz * np.arange(1, len(power) + 1) * period_s
        # of few periods only what lies closer than a line is wide counts, or all would be harmonics
        width = (1.5 if periods >= _MANY else 0.5) / periods
        near = (np.abs(cycles - np.round(cycles)) < width) & (cycles < _HIGHEST_ORDER + 0.5)
        return bool(power[near].sum() > 0.5 * power.sum())


def _orthogonal(known: Floats, columns: Floats) -> Floats:
    return np.asarray(columns - known @ (known.T @ columns))
