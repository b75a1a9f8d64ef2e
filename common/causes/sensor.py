"""Load cell and its chain: bias, drift, lag, delay, rounding, range, outliers."""

from math import atan2, floor, hypot, pi

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter, SensorEffect
from forefeel.common.causes.candidate import (
    Alignment,
    Entry,
    Fitted,
    ReadingColumns,
    Shape,
    entry,
    log_grid,
)
from forefeel.common.causes.motion import Delay, Kinematics, Motion, SettledLag, Value
from forefeel.common.causes.numerics import Array
from forefeel.common.causes.periodic import Pulsation


class Bias(ForceEffect):
    """`f = force_n`, also at no load."""

    name = "bias"
    site = "sensor"
    parameters = (Parameter("force_n", "N", 0.0, -1e4, 1e4, explains=100.0),)
    sized_anew = True
    reference = "additive offset of the measurement"
    fingerprint = "a constant level that does not depend on motion or time"
    words = "a constant offset of the load cell"
    remedy = "tare the load cell at no load"
    equation = ("{force_n}",)
    candidates = (
        ReadingColumns(coefficients=("force_n",), signs=(0,), least_score=4.0, least_ratio=1.0),
    )  # fmt: skip

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        return (1.0,)


_SETTLES, _PERIODS = (0.05, 0.1, 0.2, 0.4), (0.3, 0.45, 0.7, 1.1)  # of a recording, that are tried


def _from_start(fitted: Fitted) -> list[Entry]:
    """Entries of a model.yaml: the drift since the start; in the form with a wave, that and a bias, too."""
    drift = {"rate_n_s": fitted.coefficients[0], "from_s": fitted.start_s}
    if not fitted.shape:
        return [entry(SensorDrift, drift)]
    entries, (settling_s, *waves) = [], fitted.shape
    for period_s in waves:
        _, sine, cosine, zero_n = fitted.coefficients
        phase = (atan2(cosine, sine) - 2.0 * pi * fitted.start_s / period_s) % (2.0 * pi)
        wave = {"amplitude_n": hypot(sine, cosine), "frequency_hz": 1.0 / period_s, "phase_rad": phase}
        entries += [{**entry(Pulsation, wave), "site": "sensor"}, entry(Bias, {"force_n": zero_n})]
    return [entry(SensorDrift, {**drift, "settling_s": settling_s}), *entries]


def _beside_a_wave(t: Array, shape: Shape) -> Array:
    drift, turn = SensorDrift(settling_s=shape[0]).columns(Motion(t, t, t, t, t)), 2.0 * pi * t / shape[1]
    return np.column_stack([drift, np.sin(turn), np.cos(turn), np.ones_like(t)])


class SensorDrift(ForceEffect):
    """`f = rate_n_s tau (1 - exp(-t / tau))`, tau = settling_s, also at no load; with 0 a ramp `rate_n_s t`.

    t counts from `from_s` of the caller's own clock.
    """

    name = "sensor_drift"
    site = "sensor"
    parameters = (
        Parameter("rate_n_s", "N/s", 0.0, -1e3, 1e3, explains=100.0),
        Parameter("settling_s", "s", 0.0, 0.0, 1e12, linear=False),
        Parameter("from_s", "s", 0.0, -1e12, 1e12, linear=False),
    )
    sized_anew = True
    clocked = True
    reference = "linear zero drift of the measurement; exponential, as a body that warms up: Newton's cooling"
    fingerprint = "a ramp in time that goes on at rest and at no load, straight or settling"
    words = "a drift of the load cell"
    remedy = "let the load cell warm up, and tare it at no load before each run"
    equation = ("{rate_n_s} {settling_s} (1 - exp(-t/{settling_s}))", "{rate_n_s} t")
    candidates = (
        ReadingColumns(coefficients=("rate_n_s",), signs=(0,), making=_from_start),
        ReadingColumns(
            form="creep", coefficients=("rate_n_s",), shapes=("settling_s",), signs=(0,), making=_from_start,
            grid=lambda e: log_grid(0.1 * e.duration_s, 0.7 * e.duration_s, 5),
        ),
        ReadingColumns(
            form="wave", coefficients=("rate_n_s",), shapes=("settling_s", "period_s"), signs=(0, 0, 0, 0),
            over_time=_beside_a_wave, making=_from_start, least_score=40.0, least_ratio=2.5, costly=True,
            grid=lambda e: [(a * e.duration_s, b * e.duration_s) for a in _SETTLES for b in _PERIODS],
            plainer="creep",
        ),
    )  # fmt: skip

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        t, tau = m.t - self.values["from_s"], self.values["settling_s"]
        return (-tau * m.expm1(-m.positive(t) / tau) if tau else t,)


class SensorLag(SensorEffect):
    """`tau dy/dt = f - y`, tau = time_constant_s, exact for a force constant over dt.

    Starts settled at the first force.
    """

    name = "sensor_lag"
    linear = True
    parameters = (Parameter("time_constant_s", "s", 0.005, 1e-6, 1e3, linear=False),)
    picture = "phase"
    bends = True
    needs_spring = True
    reference = "first-order low-pass filter, zero-order-hold discretisation"
    fingerprint = "the force follows the motion late, and smaller the higher the frequency"
    words = "a load cell that follows slowly"
    remedy = "raise the corner of the filter in the load cell's amplifier"
    equation = ("f read through a lag of {time_constant_s} s",)
    candidates = (
        Alignment(
            shapes=("time_constant_s",), sizes=("time_constant_s",), picture="phase",
            factor=lambda omega, shape: np.asarray(1.0 / (1.0 + 1j * omega * shape[0])),
            grid=lambda extent: log_grid(0.1 / extent.cutoff_hz, 0.5, 10),
        ),
    )  # fmt: skip

    lag = SettledLag()

    def reading(self, m: Kinematics, force_n: Value) -> Value:
        return m.through(self.lag, force_n, m.exp(-m.dt / self.values["time_constant_s"]))


class TimeDelay(SensorEffect):
    """`y(t) = f(t - delay_s)`, linear between the steps; at first it repeats the first force."""

    name = "time_delay"
    linear = True
    parameters = (Parameter("delay_s", "s", 0.0, 0.0, 10.0, linear=False),)
    picture = "phase"
    bends = True
    reference = "pure transport delay"
    fingerprint = "the force follows the motion late by one time at every frequency, and is as large"
    words = "a force that is stamped late against the motion"
    remedy = "compare where position and force are stamped: both belong to one clock, at the reading"
    equation = ("f read {delay_s} s late",)
    candidates = (
        Alignment(
            shapes=("delay_s",), sizes=("delay_s",), picture="phase",
            factor=lambda omega, shape: np.exp(-1j * omega * shape[0]),
            grid=lambda extent: log_grid(0.1 / extent.cutoff_hz, 0.3, 12),
        ),
    )  # fmt: skip

    delay = Delay()

    def reading(self, m: Kinematics, force_n: Value) -> Value:
        return m.through(self.delay, force_n, m.t, self.values["delay_s"])


class SensorQuantisation(SensorEffect):
    """Rounds to the nearest multiple of step_n, halves to even."""

    name = "sensor_quantisation"
    parameters = (Parameter("step_n", "N", 1e-6, 1e-12, 1e3, linear=False),)
    of_its_run = True
    reference = "uniform mid-tread quantiser, Widrow and Kollar, Quantization Noise, 2008"
    fingerprint = "a comb of levels at equal distances in the histogram of the readings"
    words = "coarse steps of the load cell"
    remedy = "use more of the range of the converter, or a load cell of a smaller range"

    def reading(self, m: Kinematics, force_n: Value) -> Value:
        return m.rint(force_n / self.values["step_n"]) * self.values["step_n"]


class SensorSaturation(SensorEffect):
    """Clips to -lower_n and upper_n; `limit_n` sets both."""

    name = "sensor_saturation"
    parameters = (
        Parameter("upper_n", "N", 1e4, 1e-9, 1e6, linear=False),
        Parameter("lower_n", "N", 1e4, 0.0, 1e6, linear=False),
    )
    shorthands = {"limit_n": ("upper_n", "lower_n")}  # noqa: RUF012 - a ClassVar of the base
    reference = "end of the measuring range"
    fingerprint = "flat tops: many readings at exactly the largest magnitude"
    words = "the end of the load cell's range"
    remedy = "use a load cell of a larger range, or limit the force"

    def reading(self, m: Kinematics, force_n: Value) -> Value:
        return m.clip(force_n, -self.values["lower_n"], self.values["upper_n"])


_SLOTS = 10
"""Slots per mean interval; each holds a spike with the probability of one in so many."""

_LONGEST_S = 0.1  # s, longest spike: the upper bound of `duration_s`; a longer step of time counts as this
_MASK_64 = 0xFFFFFFFFFFFFFFFF  # 2^64 - 1: keeps integers within 64 bits, as SplitMix64 computes


class SensorSpikes(SensorEffect):
    """Spikes at irregular instants, `rate_hz` of them per second on average, each up or down.

    One lasts `duration_s`, or one step where that is longer (0.1 s at most), and adds 0.5 to 1.5 times
    `amplitude_n`. Instants and sizes are a hash of `seed` and time: equal seeds and times give equal spikes,
    at any rate of steps.
    """

    name = "sensor_spikes"
    parameters = (
        Parameter("rate_hz", "Hz", 0.0, 0.0, 1e3, linear=False),
        Parameter("amplitude_n", "N", 0.0, 0.0, 1e4, linear=False),
        Parameter("duration_s", "s", 0.001, 1e-6, 0.1, linear=False),
        Parameter("seed", "", 0.0, 0.0, 2.0**31, linear=False),
    )
    of_its_run = True
    reference = "Bernoulli process of additive outliers; hash: Steele, Lea and Flood, SplitMix, OOPSLA 2014"
    fingerprint = "single readings far off their neighbours, at instants that motion does not explain"
    words = "isolated outliers of the load cell"
    remedy = "check plug, shield and bus of the load cell"

    def _configure(self) -> None:
        self._amplitude_n, self._duration_s = self.values["amplitude_n"], self.values["duration_s"]
        self._slots_hz = self.values["rate_hz"] * _SLOTS
        self._seed = int(self.values["seed"]) * 0xD1342543DE82EF95
        self._slot = 0
        self._spike = self._in_slot(0)

    def reading(self, m: Kinematics, force_n: Value) -> Value:
        return force_n + m.elementwise(self._spike_n, m.t, m.dt)

    def _spike_n(self, t: float, dt: float) -> float:
        """Returns the size in N, with its sign, of the latest spike that still acts at t; 0 without. A spike
        acts for `duration_s`, or for dt where that is longer, 0.1 s at most.
        """
        if self._slots_hz == 0.0:
            return 0.0
        since = t - min(max(dt, self._duration_s), _LONGEST_S)
        first = floor(since * self._slots_hz)
        for slot in range(floor(t * self._slots_hz), first - 1, -1):
            if slot != self._slot:
                self._slot, self._spike = slot, self._in_slot(slot)
            if self._spike is not None and since < self._spike[0] <= t:
                return self._spike[1]
        return 0.0

    def _in_slot(self, slot: int) -> tuple[float, float] | None:
        """(instant in s, size in N) of the spike in a slot; None if it has none."""
        if self._slots_hz == 0.0 or _uniform(slot * 4 + self._seed) * _SLOTS >= 1.0:
            return None
        place, size = _uniform(slot * 4 + 1 + self._seed), _uniform(slot * 4 + 2 + self._seed)
        share = 2.0 * size - 1.0
        return (slot + place) / self._slots_hz, self._amplitude_n * (share + (0.5 if share >= 0.0 else -0.5))


def _uniform(number: int) -> float:
    """SplitMix64 of an integer, in [0, 1)."""
    z = (number * 0x9E3779B97F4A7C15) & _MASK_64
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & _MASK_64
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & _MASK_64
    return float((z ^ (z >> 31)) >> 11) * 2.0**-53
