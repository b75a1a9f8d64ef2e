"""Periodic forces: pulsation, hum of the mains, a map over the position, a weight over the angle."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import atan2, cos, hypot, pi, sin
from typing import ClassVar

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.candidate import (
    Candidate,
    Entry,
    Fitted,
    Form,
    Periodic,
    PositionWave,
    Shape,
    Values,
    entry,
    log_grid,
)
from forefeel.common.causes.motion import Kinematics, Motion, MotionGrid, Value
from forefeel.common.causes.numerics import Array


def harmonic_parameters(frequency_hz: float, lower_hz: float, upper_hz: float) -> tuple[Parameter, ...]:
    """Returns the seven parameters of a `PeriodicForce`: amplitude, frequency within these bounds and phase,
    then ratio and phase of the second and the third harmonic.
    """
    return (
        Parameter("amplitude_n", "N", 0.0, 0.0, 1e3, explains=0.15),
        Parameter("frequency_hz", "Hz", frequency_hz, lower_hz, upper_hz, linear=False),
        Parameter("phase_rad", "rad", 0.0, -2.0 * pi, 2.0 * pi, linear=False),
        *(
            parameter
            for nth in ("second", "third")
            for parameter in (
                Parameter(f"{nth}_harmonic_ratio", "", 0.0, -100.0, 100.0, linear=False),
                Parameter(f"{nth}_harmonic_phase_rad", "rad", 0.0, -2.0 * pi, 2.0 * pi, linear=False),
            )
        ),
    )


class PeriodicForce(ForceEffect):
    """Base of forces with the equation of `Pulsation`; t counts from the caller's own zero."""

    clocked = True

    def _configure(self) -> None:
        values = self.values
        self._omega, self._phase = 2.0 * pi * values["frequency_hz"], values["phase_rad"]
        self._ratio2, self._ratio3 = values["second_harmonic_ratio"], values["third_harmonic_ratio"]
        self._phase2 = values["second_harmonic_phase_rad"]
        self._phase3 = values["third_harmonic_phase_rad"]

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        """Returns the wave of amplitude 1 at m.t: (sin p + r2 sin(2p + q2) + r3 sin(3p + q3),).

        p = 2 pi frequency_hz t + phase_rad; r, q: ratio and phase of a harmonic.
        """
        p = self._angle_rad(m)
        wave = m.sin(p)
        if self._ratio2:
            wave = wave + self._ratio2 * m.sin(2.0 * p + self._phase2)
        if self._ratio3:
            wave = wave + self._ratio3 * m.sin(3.0 * p + self._phase3)
        return (wave,)

    def _angle_rad(self, m: Kinematics) -> Value:
        """Argument p of the sines, see `regressors`."""
        return self._omega * m.t + self._phase

    def span(self, motion: Motion) -> Array:
        """Sine of each harmonic at phase 0, then cosine of each, shape (n, 6)."""
        s, c = np.sin(self._omega * motion.t), np.cos(self._omega * motion.t)
        twice, square = 2.0 * s * c, 2.0 * c * c - 1.0
        sines, cosines = (s, twice, s * (2.0 * square + 1.0)), (c, square, c * (2.0 * square - 1.0))
        return np.stack((*sines, *cosines)).T

    def from_span(self, coefficients: Sequence[float]) -> dict[str, float]:
        """Returns all parameters by name from the six coefficients of `span`: of three sines, then cosines.

        Amplitude, phases and ratios follow from these, others stay; ratios are 0 if the fundamental is.
        """
        sines, cosines = np.reshape(coefficients, (2, 3)).tolist()
        amplitude_n, phase = hypot(sines[0], cosines[0]), atan2(cosines[0], sines[0])
        values = {**self.values, "amplitude_n": amplitude_n, "phase_rad": phase}
        for order, nth in ((2, "second"), (3, "third")):
            sine, cosine = sines[order - 1], cosines[order - 1]
            ratio = hypot(sine, cosine) / amplitude_n if amplitude_n > 0.0 else 0.0
            turned = atan2(cosine, sine) - order * phase
            values[f"{nth}_harmonic_ratio"] = ratio
            values[f"{nth}_harmonic_phase_rad"] = atan2(sin(turned), cos(turned))
        return values

    @classmethod
    def shape_names(cls) -> tuple[str, ...]:
        """The frequency alone: phases and ratios are linear in the span."""
        return ("frequency_hz",)


def _strongest(fitted: Fitted) -> Values:
    sizes = np.hypot(*np.reshape(fitted.coefficients, (2, 3)))
    return {"frequency_hz": fitted.shape[0], "amplitude_n": float(np.max(sizes))}


def _wave(frequency_hz: float, c: Array, turns: float) -> Values:
    """Parameters of a pulsation with these six coefficients of a span, its phases `turns` later."""
    wave = c[:3] + 1j * c[3:]  # sin + i cos: amplitude times exp(i phase) of a sine
    wave = wave * np.exp(2j * np.pi * turns * np.arange(1, 4))
    return Pulsation(frequency_hz=frequency_hz).from_span([*wave.real.tolist(), *wave.imag.tolist()])


def _steady(fitted: Fitted) -> list[Entry]:
    """A pulsation whose phases count from stamp 0."""
    (hz,) = fitted.shape
    return [entry(Pulsation, _wave(hz, fitted.coefficients, -hz * fitted.start_s))]


class Pulsation(PeriodicForce):
    """`f = A (sin p + r2 sin(2p + q2) + r3 sin(3p + q3))`, p = 2 pi frequency_hz t + phase_rad.

    A = amplitude_n, r2 = second_harmonic_ratio, q2 = second_harmonic_phase_rad, r3 and q3 likewise.
    t counts from the caller's own zero, so a phase from one recording holds for that recording only.
    """

    name = "pulsation"
    site = "wall"
    parameters = harmonic_parameters(1.2, 0.005, 50.0)
    picture = "period"
    kin = "rhythm"
    reference = "Fourier series of the arterial pulse, McDonald's Blood Flow in Arteries, 6th ed."
    fingerprint = "a line in the spectrum and its harmonics that stay while the operator holds still"
    words = "a periodic force of its own, such as heart beat or breath"
    equation: ClassVar[tuple[str, ...]] = ("{amplitude_n} sin(2 pi {frequency_hz} t) and harmonics",)
    candidates: ClassVar[Sequence[Candidate]] = (
        Periodic(shapes=("frequency_hz",), signs=(0,) * 6, naming=_strongest, making=_steady),
    )


_CYCLES = 2.0  # from one rate of a course to the next: no heart or breath changes its rate much faster
PULSATION_HZ = 0.12, 4.0  # of breath and heart
VARIES, _MOST_VARIES = 0.2, 0.25
"""Standard deviation of a rate over its mean: of one that nothing is known of, and at most."""


def step_s(rate_hz: float) -> float:
    """Time in s from one value of a course of that mean rate to the next, a power of 2: some two cycles."""
    return float(2.0 ** np.rint(np.log2(_CYCLES / rate_hz)))


def turns(t: Array, rates_hz: Shape) -> Array:
    """Cycles of a rhythm until each time t in s, counted from the time of its middle rate. Its rates are
    those at 0, `step_s`, 2 `step_s`, ... s, linear in between and constant beyond.
    """
    rates, each_s = np.array(rates_hz), step_s(float(np.mean(rates_hz)))
    done = np.cumsum([0.0, *(0.5 * each_s * (rates[1:] + rates[:-1]))])
    i = np.clip(np.floor(t / each_s).astype(np.int64), 0, len(rates) - 1)
    since_s, steepness = t - each_s * i, np.append(np.diff(rates) / each_s, 0.0)
    bent = np.where(since_s > 0.0, 0.5 * steepness[i] * since_s, 0.0)
    return np.asarray(done[i] + (rates[i] + bent) * since_s - done[len(rates) // 2])


_TURNING = Pulsation(frequency_hz=1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Rhythm(Form):
    """Waves of a rhythm, three harmonics, times each of `factors`, the last of which has its one of `sizes`.

    Its shape is the course of its rate in Hz, see `turns`: one value is a steady rate, not of a `living` one.
    """

    factors: Callable[[MotionGrid], list[Array]]
    living: bool = False

    def columns(self, motion: MotionGrid, shape: Shape) -> list[Array]:
        waves = _TURNING.span(replace(motion, t=turns(motion.t, shape))).T
        return [factor * wave for factor in self.factors(motion) for wave in waves]

    def slopes(self, motion: MotionGrid, shape: Shape, coefficients: Array) -> Array:
        """Derivatives of its force by each value of the shape, shape (values, n)."""
        now, sizes = (
            turns(motion.t, shape),
            np.reshape(coefficients, (-1, 2, 3)) * 2.0 * np.pi * np.arange(1, 4),
        )
        sines, cosines = np.hsplit(_TURNING.span(replace(motion, t=now)), 2)
        by_turn = sum(
            factor * (cosines @ sine - sines @ cosine)
            for factor, (sine, cosine) in zip(self.factors(motion), sizes, strict=True)
        )
        step = 1e-4 * shape[0]
        moved = [turns(motion.t, tuple(row)) for row in np.array(shape) + step * np.eye(len(shape))]
        return np.asarray(by_turn * (np.array(moved) - now) / step)

    def named(self, fitted: Fitted) -> Values:
        """Parameters by name: mean frequency, size of the largest harmonic, variation of the rate (only of a
        course of several), zero of the depth (only with two factors).
        """
        *level, wave = np.reshape(fitted.coefficients, (-1, 6))
        values = {"frequency_hz": float(np.mean(fitted.shape))}
        values[self.needed[0]] = float(np.max(np.hypot(wave[:3], wave[3:])))
        if len(fitted.shape) > 1:
            values["rate_variation"] = float(np.sqrt(2.0) * np.std(fitted.shape) / np.mean(fitted.shape))
        for constant in level:
            values["zero_m"] = -float(constant @ wave) / max(float(wave @ wave), 1e-300)
        return values

    def entries(self, fitted: Fitted) -> list[Entry]:
        """Returns one entry of a model.yaml: a `varying_pulsation` with the fitted wave, whose rate swings
        about the mean as the strongest Fourier line of the fitted course does.
        """
        shape, start_s, count = fitted.shape, fitted.start_s, len(fitted.shape)
        t = step_s(float(np.mean(shape))) * np.arange(count, dtype=np.float64)
        hz, offset = np.polyfit(t, turns(t, shape), 1) if count > 1 else (shape[0], 0.0)
        wave = _wave(hz, np.reshape(fitted.coefficients, (-1, 6))[-1], offset - hz * start_s)
        values = self.named(fitted) | wave | {"amplitude_n": 0.0, self.needed[0]: wave["amplitude_n"]}
        lines = np.fft.rfft(turns(t, shape) - offset - hz * t)
        strongest = int(np.argmax(np.abs(lines)))
        swing_hz, p = strongest / max(count * t[-1] / max(count - 1, 1), 1e-9), np.angle(lines[strongest])
        values |= {
            "rate_variation": 4.0 * pi * swing_hz * np.abs(lines[strongest]) / count / hz,
            "variation_hz": swing_hz,
            "variation_phase_rad": float(p + 0.5 * pi - 2.0 * pi * swing_hz * start_s) % (2.0 * pi),
        }
        return [entry(VaryingPulsation, values)]


def _lives(_: MotionGrid, rates: Shape) -> bool:
    mean_hz = float(np.mean(rates))
    return float(np.std(rates)) < _MOST_VARIES * mean_hz and mean_hz < PULSATION_HZ[1]


def _rhythm(form: str, size: str, *factors: Callable[[MotionGrid], Array]) -> Rhythm:
    """Form of a rhythm times each of the factors, the last of which has the parameter `size`. It is `living`
    with an empty `form`, else `costly`.
    """
    return Rhythm(
        form=form, factors=lambda m: [factor(m) for factor in factors], living=not form, sizes=(size,),
        signs=(0,) * 6 * len(factors), logarithmic=False, grid=lambda _: [(1.2,)], costly=bool(form),
        happens=_lives, least_score=30.0, least_ratio=1.15,
        price=0.2,  # a steady pulsation that leaves 10 % more does as well
    )  # fmt: skip


def _always(m: MotionGrid) -> Array:
    return np.ones_like(m.t)


class VaryingPulsation(Pulsation):
    """`f = (A + B (x - x0) + C s + D v) W(p)`: a pulsation that lives, W and p those of `Pulsation` but that

    p = 2 pi (f t + f r / (2 pi g) sin(2 pi g t + h)) + phase_rad; r = rate_variation, g = variation_hz, h =
    variation_phase_rad: the rate swings by the share r, as that of a heart does with the breath. s is the
    direction, x0 = zero_m.
    """

    name = "varying_pulsation"
    parameters = (
        *harmonic_parameters(1.2, 0.05, 50.0),
        Parameter("amplitude_per_length_n_m", "N/m", 0.0, 0.0, 1e6, explains=0.15),
        Parameter("friction_n", "N", 0.0, 0.0, 1e3, explains=0.15),
        Parameter("damping_n_s_m", "N s/m", 0.0, 0.0, 1e6, explains=0.15),
        Parameter("zero_m", "m", 0.0, -1e6, 1e6, linear=False),
        Parameter("rate_variation", "", 0.05, 0.0, 0.9, linear=False),
        Parameter("variation_hz", "Hz", 0.25, 1e-4, 50.0, linear=False),
        Parameter("variation_phase_rad", "rad", 0.0, -2.0 * pi, 2.0 * pi, linear=False),
    )
    picture = "time"
    reference = "respiratory sinus arrhythmia, Hirsch and Bishop, Am. J. Physiol. 241, 1981"
    fingerprint = "a wide line in the spectrum and its harmonics, or lines whose size goes with the motion"
    words = "a heart beat or breath whose rate or size varies"
    equation = (
        "{amplitude_n} sin(p) and harmonics, p' = 2 pi {frequency_hz} within {rate_variation}",
        "{amplitude_per_length_n_m} (x - {zero_m}) sin(p) and harmonics, p' = 2 pi {frequency_hz}",
        "{friction_n} sgn(x') sin(p) and harmonics, p' = 2 pi {frequency_hz}",
        "{damping_n_s_m} x' sin(p) and harmonics, p' = 2 pi {frequency_hz}",
    )
    candidates = (
        _rhythm("", "amplitude_n", _always),
        _rhythm("depth", "amplitude_per_length_n_m", _always, lambda m: m.x),
        _rhythm("friction", "friction_n", lambda m: m.direction()),
        _rhythm("speed", "damping_n_s_m", lambda m: m.v),
    )

    def _angle_rad(self, m: Kinematics) -> Value:
        values, swing = self.values, 2.0 * pi * self.values["variation_hz"]
        swung = m.sin(swing * m.t + values["variation_phase_rad"])
        return super()._angle_rad(m) + self._omega * values["rate_variation"] / swing * swung

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        (wave,) = super().regressors(m)
        return wave, wave * (m.x - self.values["zero_m"]), wave * m.direction(), wave * m.v

    span, from_span = ForceEffect.span, ForceEffect.from_span

    @classmethod
    def shape_names(cls) -> tuple[str, ...]:
        return super(PeriodicForce, cls).shape_names()


class MainsHum(PeriodicForce):
    """Force of the equation of `pulsation`, in the sensor: also at no load."""

    name = "mains_hum"
    site = "sensor"
    parameters = harmonic_parameters(50.0, 45.0, 65.0)
    reference = "Ott, Electromagnetic Compatibility Engineering, 2009; mains of 50 or 60 Hz"
    fingerprint = "a narrow line at 50 or 60 Hz and its harmonics, the same at rest and at no load"
    words = "hum of the mains"
    remedy = "check shield and earth of the load cell's cable"


class PositionMap(ForceEffect):
    """`f = sum over j = 1, 2 of A_j sin(j p) + B_j cos(j p)`, p = 2 pi x / period_m.

    Periodic where the stroke holds several periods; of a period longer than the stroke a smooth map, which
    no diagnosis searches: it would replace a spring, a wall or a friction that is not modelled.
    """

    name = "position_map"
    site = "shaft"
    parameters = (
        *(
            Parameter(name, "N", 0.0, -1e4, 1e4)
            for name in ("sine_n", "cosine_n", "second_sine_n", "second_cosine_n")
        ),
        Parameter("period_m", "m", 0.01, 1e-9, 1e6, linear=False),
    )
    picture = "position"
    reference = "Fourier series; gravity of a joint: Armstrong, Khatib and Burdick, ICRA 1986"
    fingerprint = "a curve over position, the same in both directions, at any speed and at rest"
    words = "a force that belongs to the position, such as cogging or a screw's pitch"
    equation = (
        "{sine_n} sin(p) + {cosine_n} cos(p) + {second_sine_n} sin(2 p) + {second_cosine_n} cos(2 p), "
        "p = 2 pi x/{period_m}",
    )
    candidates = (
        PositionWave(
            shapes=("period_m",), costly=True, picture="position",
            grid=lambda extent: log_grid(extent.range_m / 20.0, extent.range_m / 3.0, 4),
            least_score=30.0,  # the best of hundreds of periods gains up to half of that in pure noise
        ),
    )  # fmt: skip

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        """sin p, cos p, sin 2p, cos 2p."""
        p = (2.0 * pi / self.values["period_m"]) * m.x
        return m.sin(p), m.cos(p), m.sin(2.0 * p), m.cos(2.0 * p)


_LEAST_ARC_RAD = pi / 2.0
"""Over less a sine bends by some 10 %: with a spring and a constant it then is any curve, as of a spring that
stiffens.
"""


class GravityLoad(ForceEffect):
    """`f = sine_n sin(x) + cosine_n cos(x)`, x an angle in rad, f then in N m: `m g l sin(x - hanging)`.

    Over a small range it is a spring and a constant; of a weight that stands upright, a negative spring.
    """

    name = "gravity_load"
    site = "shaft"
    parameters = (Parameter("sine_n", "N", 0.0, -1e4, 1e4), Parameter("cosine_n", "N", 0.0, -1e4, 1e4))
    picture = "position"
    rotary = True
    reference = "Spong, Hutchinson and Vidyasagar, Robot Modeling and Control, 2006, section 7.3"
    fingerprint = "a sine of the angle with one period a turn, the same both ways, at any speed and at rest"
    words = "the weight of a link or of an eccentric holder"
    remedy = "balance the link or the holder, or feed its weight forward by the angle"
    equation = ("{sine_n} sin(x) + {cosine_n} cos(x)",)
    candidates = (Form(grid=lambda extent: [()] if extent.range_m > _LEAST_ARC_RAD else []),)

    @classmethod
    def described(cls, values: Mapping[str, float], text: Callable[[str, float], str]) -> str:
        sine_n, cosine_n = values["sine_n"], values["cosine_n"]
        return (
            f": {text('largest_n', hypot(sine_n, cosine_n))} at its farthest, it hangs at "
            f"{atan2(-cosine_n, sine_n):z.2f} rad and stands upright at {atan2(cosine_n, -sine_n):z.2f} rad"
        )

    def angle(self, m: Kinematics) -> Value:
        """The angle in rad that the weight turns with."""
        return m.x

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        angle = self.angle(m)
        return m.sin(angle), m.cos(angle)
