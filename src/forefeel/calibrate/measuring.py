"""Computations and refusals of a calibration. Pure: readings in, numbers out; no clock, no device."""

from collections.abc import Sequence
from math import hypot, inf, isfinite, sqrt
from typing import NamedTuple

from forefeel.common.errors import ConfigurationError, RunError

STANDARD_GRAVITY_M_S2 = 9.80665  # m/s^2, exact by definition (3rd CGPM, 1901)
LEAST_READINGS = 10  # of a level
_STEADY_SHARE = 0.005  # of the range, that the readings of a level may drift
_NOISE = 4.0  # rms, in units of the drift that is allowed: noise is averaged away
_SHOWN = 3.0  # a drift of that many of its standard deviations is one


class Level(NamedTuple):
    """Readings of one load, native units: their mean, their standard deviation around the line through them,
    how far that line rises from the first to the last, the standard deviation of that rise.
    """

    mean: float
    std: float
    drift: float
    drift_std: float
    readings: int


class Step(NamedTuple):
    """One step of the walk: the force that is applied, N, and what the cell gave."""

    force_n: float
    level: Level


class CalibrationFit(NamedTuple):
    """`F = gain_n (native - zero)`; rms of what it leaves, largest difference of one load met twice; N."""

    gain_n: float
    zero: float
    residual_n: float
    hysteresis_n: float


def level_of(times_s: Sequence[float], natives: Sequence[float]) -> Level:
    """Computes mean, noise and drift of readings at times in s, by the line of least squares through them.
    Noise is the std of the residuals; drift is the rise of the line over the whole time T, with the standard
    deviation std T / sqrt(sum (t - mean)^2). ValueError: fewer than three readings, or all at one time.
    """
    n = len(natives)
    if n < 3 or len(times_s) != n or max(times_s) <= min(times_s):
        raise ValueError(f"{n} readings: expected at least 3 over some time")
    mean, middle_s = sum(natives) / n, sum(times_s) / n
    spread = sum((t - middle_s) ** 2 for t in times_s)
    slope = sum((t - middle_s) * (x - mean) for t, x in zip(times_s, natives, strict=True)) / spread
    left = sum((x - mean - slope * (t - middle_s)) ** 2 for t, x in zip(times_s, natives, strict=True))
    std, span_s = sqrt(left / (n - 2)), max(times_s) - min(times_s)
    return Level(mean, std, slope * span_s, std * span_s / sqrt(spread), n)


def require_steady(level: Level, newton_per_native: float, range_n: float, what: str) -> None:
    """Refuses a level whose readings are too noisy, or drift more than their noise explains.

    Args:
        level: what was read.
        newton_per_native: what a native unit is worth, by the data sheet; its sign does not matter.
        range_n: the range of forces that is calibrated.
        what: the load in words, for the text.

    Raises:
        RunError: noise above 2 % of the range (rms), or drift above 0.5 % of it and three times its
            standard deviation.
    """
    scale_n, allowed_n = abs(newton_per_native), _STEADY_SHARE * range_n
    noise_n, noise_allowed_n = level.std * scale_n, _NOISE * allowed_n
    if not noise_n <= noise_allowed_n:
        raise RunError(
            f"{what}: the reading moves: noise {noise_n:.3g} N rms, allowed {noise_allowed_n:.3g} N; "
            "keep the cell free of touch, draught and vibration"
        )
    if abs(level.drift) * scale_n > allowed_n and abs(level.drift) > _SHOWN * level.drift_std:
        raise RunError(
            f"{what}: the reading moves: drift {level.drift * scale_n:+.3g} N while it was averaged, "
            f"allowed {allowed_n:.3g} N; let the load settle and the cell warm up"
        )


def forces_of(text: str, newton_per_unit: float, where: str) -> list[float]:
    """Parses a list such as `0,0.05,0.1` to forces in N, in its order, zero left out: the cell is tared
    without a load. `where`: the option, for the text of an error.

    Raises:
        ConfigurationError: not a list of numbers, one twice, none besides 0, or above 1e6 N.
    """
    words = [word.strip() for word in text.split(",")]
    try:
        values = [float(word) for word in words]
    except ValueError:
        raise ConfigurationError(
            f"{where} {text}: expected numbers with commas, such as 0,0.05,0.1"
        ) from None
    forces = [value * newton_per_unit for value in values if value != 0.0]
    if not all(isfinite(force) and abs(force) <= 1e6 for force in forces):
        raise ConfigurationError(f"{where} {text}: expected finite loads of at most 1e6 N")
    if len(set(forces)) != len(forces):
        raise ConfigurationError(
            f"{where} {text}: a load stands twice; expected each once, they come back down"
        )
    if not forces:
        raise ConfigurationError(f"{where} {text}: one point, no load; expected at least one load besides 0")
    return forces


def walk_of(forces: Sequence[float]) -> list[float]:
    """The loads in N in the order in which they are applied: unloaded, up, down, unloaded again."""
    up = [0.0, *sorted(force for force in forces if force > 0.0)]
    down = [0.0, *sorted((force for force in forces if force < 0.0), reverse=True)]
    walk = [*up, *reversed(up[:-1])] if len(up) > 1 else [0.0]
    return [*walk, *down[1:], *reversed(down[:-1])] if len(down) > 1 else walk


def range_of(forces: Sequence[float]) -> tuple[float, float]:
    return min(0.0, *forces), max(0.0, *forces)


def fit(steps: Sequence[Step]) -> CalibrationFit:
    """Fits the line of least squares through the steps: native = zero + F / gain_n, for the weights are exact
    and the readings are not; adds rms residual and hysteresis in N.

    Raises:
        RunError: fewer than two different loads, or every load reads the same.
    """
    forces = [step.force_n for step in steps]
    if len(set(forces)) < 2:
        raise RunError(f"{len(set(forces))} load: expected at least two different ones, 0 N among them")
    n = len(steps)
    mean_n, mean = sum(forces) / n, sum(step.level.mean for step in steps) / n
    spread = sum((force - mean_n) ** 2 for force in forces)
    slope = sum((step.force_n - mean_n) * (step.level.mean - mean) for step in steps) / spread
    if not slope:
        raise RunError("every load reads the same; check the weights and the cell")
    gain_n, zero = 1.0 / slope, mean - slope * mean_n
    left = [step.force_n - gain_n * (step.level.mean - zero) for step in steps]
    return CalibrationFit(gain_n, zero, hypot(*left) / sqrt(n), abs(gain_n) * _largest_difference(steps))


def require_line(fitted: CalibrationFit, range_n: float, residual_share: float) -> None:
    """Raises RunError when the rms residual of the fit exceeds `residual_share` of the range."""
    allowed_n = residual_share * range_n
    if not fitted.residual_n <= allowed_n:
        raise RunError(
            f"residual {fitted.residual_n:.3g} N rms, allowed {allowed_n:.3g} N ({residual_share:.1%} of "
            f"{range_n:.3g} N), hysteresis {fitted.hysteresis_n:.3g} N: the readings are no line of the "
            "loads; check the weights and their order"
        )


def _largest_difference(steps: Sequence[Step]) -> float:
    """Largest difference in native units of one load met twice."""
    ranges: dict[float, tuple[float, float]] = {}
    for force_n, level in steps:
        low, high = ranges.get(force_n, (inf, -inf))
        ranges[force_n] = min(low, level.mean), max(high, level.mean)
    return max(high - low for low, high in ranges.values())


def travel_of(
    reference: float, ends: tuple[float, float], native_per_m: float, sign: int
) -> tuple[float, float]:
    """The ends of the travel from the reference in m, to the nanometre; reference and ends in native units,
    `sign` as in the settings.
    """
    low_m, high_m = sorted(round(sign * (end - reference) / native_per_m, 9) for end in ends)
    return low_m, high_m


def require_travel(measured_m: tuple[float, float], expected_m: tuple[float, float]) -> None:
    """Raises RunError unless the measured travel covers the expected one (low, high) in m."""
    if measured_m[0] > expected_m[0] or measured_m[1] < expected_m[1]:
        low, high = (1e3 * end_m for end_m in measured_m)
        raise RunError(
            f"travel {low:.3f} to {high:.3f} mm found, settings say stage.travel_m = {list(expected_m)}; "
            "correct it, the scale or the sign, or take away what is in the way"
        )
