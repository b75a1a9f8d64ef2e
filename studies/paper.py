"""The paper reproduced with its own algorithm, six things that its simulation gets wrong, and what was
published since.

"Study on Contact Force Prediction for the Vascular Interventional Surgical Robot based on Parameter
Identification": figures 4 and 5 are its simulation x = sin t, figures 7 to 10 are made on a simulated bench.

    python -m studies.paper --out out/paper     # a PNG of each figure, the tables on stdout

At time t the forces stamped <= t - delay have arrived, without a delay those before t. The prediction for t
is phi(t)' theta with what those have taught: every prediction is a priori.
"""

import argparse
import os
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf, log, nan, pi, sqrt
from pathlib import Path
from sys import float_info
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.prediction import scored
from benchmarks.prediction_published import OfflineNetworks
from forefeel.common.errors import ForefeelError, RecordingError, RunError
from forefeel.common.estimation.identifiability import analyse
from forefeel.common.estimation.predictor import Predictor
from forefeel.common.estimation.state_filter import StateFilter
from forefeel.common.events.text import quantity
from forefeel.common.recording.loading import load_recording
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.recording.recording import Recording
from forefeel.common.topics import FORCE, HAPTICS
from forefeel.diagnosis.evaluation.arrivals import DelayedLink, arrivals
from forefeel.diagnosis.evaluation.evaluate import prepare
from forefeel.diagnosis.evaluation.methods import PAPER_LAMBDA, PaperRls, replay
from forefeel.diagnosis.evaluation.rls import PRIOR_VARIANCE, RecursiveLeastSquares
from forefeel.loopback.plan import AXIS, LoopbackOptions, make_plan, resisting_sign
from forefeel.loopback.virtual import VirtualLoopback
from forefeel.report.score import first_answers

Array = NDArray[np.float64]
Rls = PaperRls | RecursiveLeastSquares
Row = tuple[str, ...]

DELAY_S = 0.3
DELTA = 1e-6  # P(0) = I / delta (8), "very small": the paper gives no number
MEMORY_S = 2.0  # of the product's estimator
THETA: Array = np.array([0.01, 0.1, 1.0])
"""m, b, k of the paper's simulation, in kg, N s/m, N/m."""
PERIOD_S = 2.0 * pi  # of x = sin t
BOUNDS_N = {"catheter": ("7, 8", 0.015), "guidewire": ("9, 10", 0.013)}
"""Figures of each instrument, and the bound of the error that the paper states for it."""
METHODS = "hold", "paper", "newest", "tared", "product"
PUBLISHED_SINCE = {"kv_ewrls": "Kelvin-Voigt", "hc_ewrls": "Hunt-Crossley", "model_free": "model-free"}
_SCORED_FROM_S = 3.0  # and the delay: everything starts cold


# --- the simulated contact, and learning across a delay ---


def sines(
    rate_hz: float, duration_s: float, parts: Sequence[tuple[float, float]] = ((1.0, 1.0),)
) -> tuple[Array, Array]:
    """x = sum of A sin(w t): stamps in s, shape (n,), and phi = [x'', x', x] of (1), shape (n, 3)."""
    t = np.arange(round(duration_s * rate_hz)) / rate_hz
    rows = np.zeros((len(t), 3))
    for amplitude_m, w in parts:
        sine, cosine = amplitude_m * np.sin(w * t), amplitude_m * np.cos(w * t)
        rows += np.column_stack([-w * w * sine, w * cosine, sine])
    return t, rows


def amplitude_n(theta: Array, w: float) -> float:
    """Amplitude of m x'' + b x' + k x for x = sin(w t): |k - m w^2 + j b w|."""
    return float(abs(complex(theta[2] - theta[0] * w * w, theta[1] * w)))


def rms(values: Array) -> float:
    """Root mean square; infinite where a value is not finite, NaN without a value."""
    largest = float(np.max(np.abs(values), initial=0.0))
    if not np.isfinite(largest):
        return inf
    return largest * sqrt(np.mean((values / (largest or 1.0)) ** 2)) if len(values) else nan


def noise_n(size: int, deviation_n: float, seed: int | None) -> Array:
    """White noise of the force; none without a seed."""
    return np.zeros(size) if seed is None else deviation_n * np.random.default_rng(seed).normal(size=size)


def paper_rls(size: int = 3, lam: float = PAPER_LAMBDA) -> PaperRls:
    """Equations (8) to (12); P is made symmetric after each update, which the paper does not: it helps."""
    return PaperRls(size, lam, delta=DELTA, symmetrise=True)


def product_rls(rows: Array) -> RecursiveLeastSquares:
    """The product's least squares for [m, b, k, ...], none of m, b, k below 0."""
    scales = np.sqrt(np.mean(rows**2, axis=0)).tolist()
    bounds = [(0.0, inf)] * 3 + [(-inf, inf)] * (len(scales) - 3)
    return RecursiveLeastSquares(scales, MEMORY_S, bounds)


def updated(rls: Rls, phi: Array, y: float, dt: float) -> Array:
    if isinstance(rls, PaperRls):
        rls.update(phi, y)
        return rls.theta
    rls.update(phi.tolist(), y, dt)
    return np.array(rls.parameters)


def newest(time_s: Array, delay_s: float) -> NDArray[np.int64]:
    """For each stamp the index of the newest force that has arrived, -1 for none; shape (n,)."""
    if delay_s <= 0.0:
        return np.arange(len(time_s), dtype=np.int64) - 1
    return np.searchsorted(time_s, time_s - delay_s + 1e-6, side="right").astype(np.int64) - 1


def held(time_s: Array, force_n: Array, delay_s: float) -> Array:
    """The newest force that has arrived, NaN before the first: the baseline; shape (n,)."""
    index = newest(time_s, delay_s)
    return np.where(index >= 0, force_n[np.maximum(index, 0)], nan)


def learn(
    time_s: Array,
    rows: Array,
    force_n: Array,
    delay_s: float,
    rls: Rls | None = None,
    newest_motion: bool = False,
) -> tuple[Array, Array]:
    """(predicted force, shape (n,); last theta): NaN before the first force arrived and after an overflow.

    Args:
        rls: the algorithm; the paper's by default.
        newest_motion: pairs a late force with the newest motion, not with that of its own stamp.
    """
    rls = rls or paper_rls(rows.shape[1])
    predicted_n, theta, taught = np.full(len(time_s), nan), np.zeros(rows.shape[1]), 0
    steps = np.minimum(np.diff(time_s, prepend=time_s[0]), 0.1).tolist()  # a gap is forgotten as 0.1 s
    with np.errstate(over="ignore", invalid="ignore"):
        for i, available in enumerate(newest(time_s, delay_s).tolist()):
            for j in range(taught, available + 1):
                theta = updated(rls, rows[i if newest_motion else j], force_n[j], steps[j])
            taught = max(taught, available + 1)
            if not np.isfinite(theta).all():
                return predicted_n, np.full(rows.shape[1], nan)
            if available >= 0:
                predicted_n[i] = rows[i] @ theta
    return predicted_n, theta


def lead_s(time_s: Array, first: Array, second: Array) -> float:
    """By how many seconds `first` is ahead of `second`, both sinusoids of 1 rad/s."""
    basis = np.column_stack([np.cos(time_s), np.sin(time_s)])
    (c1, s1), (c2, s2) = (np.linalg.lstsq(basis, values, rcond=None)[0] for values in (first, second))
    return float(np.angle(complex(c1, -s1) / complex(c2, -s2)))


# --- runs: the simulated bench and measured recordings ---


@dataclass(frozen=True, slots=True, eq=False)
class ComparedRun:
    """A recording with what each of METHODS predicts for its n samples, and where these are compared.

    `instrument`: of the simulated bench.
    """

    name: str
    recording: Recording
    force_n: Array
    predicted_n: dict[str, Array]
    scored: NDArray[np.bool_]
    instrument: str = ""

    def error_n(self, method: str) -> Array:
        return (self.predicted_n[method] - self.force_n)[self.scored]

    def of_hold(self, method: str) -> float:
        """rms of the error over that of the hold."""
        return rms(self.error_n(method)) / rms(self.error_n("hold"))


def compared(name: str, recording: Recording, product_n: Array) -> ComparedRun:
    """All METHODS as a master DELAY_S away would run them; `tared`: on the force less its first value."""
    time_s, force_n, rows = recording.time_s, recording.force_n, motion_rows(recording)
    assert force_n is not None
    predicted_n = {
        "hold": held(time_s, force_n, DELAY_S),
        "paper": learn(time_s, rows, force_n, DELAY_S)[0],
        "newest": learn(time_s, rows, force_n, DELAY_S, newest_motion=True)[0],
        "tared": learn(time_s, rows, force_n - force_n[0], DELAY_S)[0] + force_n[0],
        "product": product_n,
    }
    scored = (time_s >= time_s[0] + _SCORED_FROM_S + DELAY_S) & np.isfinite(product_n)
    return ComparedRun(name, recording, force_n, predicted_n, scored)


def motion_rows(recording: Recording) -> Array:
    """phi = [x'', x', x] at each sample; derivatives by a causal filter of 20 Hz, or a quarter of the sample
    rate where that is less, which starts anew behind a gap.
    """
    state = StateFilter(min(20.0, recording.rate_hz / 4.0))
    rows = np.empty((len(recording), 3))
    for piece in recording.segments():
        state.reset()
        steps = np.diff(recording.time_s[piece], prepend=recording.time_s[piece.start]).tolist()
        for i, dt in enumerate(steps, start=piece.start):
            x = float(recording.position_m[i])
            _, v, a = state.step(x, dt)
            rows[i] = a, v, x
    return rows


def bench_run(instrument: str, duration_s: float, seed: int) -> ComparedRun:
    """The whole product in virtual time over a network of 150 ms one way.

    Raises:
        RunError: nothing was predicted.
    """
    plan = make_plan(LoopbackOptions(seed=seed, impairment="paper", preset=instrument, duration_s=duration_s))
    loop = VirtualLoopback(plan, seed)
    loop.run(lambda _: None)
    with TemporaryDirectory(prefix="forefeel-") as folder:
        path = Path(folder) / "run.mcap"
        loop.write(path)
        recorded = Run(path)
    force, haptics = partial(recorded.column, AXIS, FORCE), partial(recorded.column, AXIS, HAPTICS)
    valid, answered_ns = force("valid").astype(bool), force("answers_stamp_ns").astype(np.float64)
    rows = np.flatnonzero(valid & np.isfinite(answered_ns))
    index = first_answers(
        (haptics("session_id"), haptics("stamp_ns")),
        (force("session_id")[rows], answered_ns[rows]),
        force("stamp_ns")[rows],
    )
    stamps_ns = np.unique(force("stamp_ns")[valid])  # as the recording has them
    product_n = np.full(len(stamps_ns), nan)
    answered = np.searchsorted(stamps_ns, force("stamp_ns")[rows][index[index >= 0]])
    product_n[answered] = haptics("predicted_n").astype(np.float64)[index >= 0]
    if not np.isfinite(product_n).any():
        raise RunError(f"simulated bench, {instrument}: nothing was predicted in {duration_s:g} s")
    run = compared(f"{instrument} (simulated bench)", recorded.to_recording(AXIS), product_n)
    return replace(run, instrument=instrument)


def measured_run(path: Path) -> ComparedRun:
    """A measured recording; the product as in `forefeel evaluate`, the hold until it predicts.

    Raises:
        RecordingError: unreadable, without force, or too short.
    """
    recording = load_recording(path)
    if recording.force_n is None:
        raise RecordingError("no force column")
    if recording.duration_s < _SCORED_FROM_S + DELAY_S + 1.0:
        raise RecordingError(
            f"{recording.duration_s:.3g} s, expected at least {_SCORED_FROM_S + DELAY_S + 1} s"
        )
    recording = replace(recording, force_n=resisting_sign(recording) * recording.force_n)
    assert recording.force_n is not None
    trace = replay(recording, arrivals(recording.time_s, DelayedLink(DELAY_S)), Predictor())
    hold_n = held(recording.time_s, recording.force_n, DELAY_S)
    return compared(path.stem, recording, np.where(trace.answered, trace.force_n, hold_n))


# --- the sections ---


@dataclass(frozen=True, slots=True)
class Section:
    """`rows`: a table, its head first."""

    title: str
    caption: str
    rows: Sequence[Row]
    figure: Figure | None = None


def simulation() -> Section:
    """Figures 4 and 5: x = sin t at 100 Hz, three periods, without and with the delay."""
    figure = Figure(figsize=(11.0, 5.4), layout="constrained")
    rows: list[Row] = [("delay", "m, b, k", "error rms", "lead", "newest motion", "lead")]
    time_s, phi = sines(100.0, 3 * PERIOD_S)
    force_n, late = phi @ THETA, time_s >= PERIOD_S
    for axes, delay_s in zip(figure.subplots(2, 1), (0.0, DELAY_S), strict=True):
        arrived_n = held(time_s, force_n, delay_s) if delay_s else force_n
        stamps_n, theta = learn(time_s, phi, force_n, delay_s)
        newest_n, _ = learn(time_s, phi, force_n, delay_s, newest_motion=True)
        sizes = [f"{rms((made - force_n)[late]):.2g} N" for made in (stamps_n, newest_n)]
        leads = [
            f"{1e3 * lead_s(time_s[late], n[late], arrived_n[late]):.0f} ms" for n in (stamps_n, newest_n)
        ]
        rows.append((f"{delay_s:g} s", named(theta), sizes[0], leads[0], sizes[1], leads[1]))
        axes.plot(time_s, force_n, color="0.75", linewidth=5, label="force at the contact, now")
        axes.plot(time_s, arrived_n, "k", label="measured, as it arrives")
        axes.plot(time_s, stamps_n, label="predicted, paired by stamps")
        axes.plot(time_s, newest_n, "--", label="paired with the newest motion")
        _finish(axes, "force in N")
    return Section(
        "Figures 4 and 5: the simulation without and with 300 ms delay",
        "x = sin t, lambda 0.96, 100 Hz. Paired by the slave's stamps the prediction coincides with the "
        "force now; paired with the newest motion, as the paper describes it, it repeats the late one.",
        rows,
        figure,
    )


def bench(run: ComparedRun) -> Section:
    """Figures 7 and 8, or 9 and 10: force and error of one instrument on the simulated bench."""
    figures, bound_n = BOUNDS_N[run.instrument]
    time_s, force_n = run.recording.time_s[run.scored] - run.recording.time_s[0], run.force_n[run.scored]
    prompt_n = learn(run.recording.time_s, motion_rows(run.recording), run.force_n, 0.0)[0]
    shown = {
        "paper, no delay": prompt_n[run.scored],
        "paper, 300 ms": run.predicted_n["paper"][run.scored],
        "hold, 300 ms": run.predicted_n["hold"][run.scored],
        "product, 300 ms": run.predicted_n["product"][run.scored],
    }
    figure = Figure(figsize=(11.0, 6.2), layout="constrained")
    first, second = figure.subplots(2, 1, sharex=True)
    first.plot(time_s, 1e3 * force_n, "k", label="measured")
    second.axhspan(-1e3 * bound_n, 1e3 * bound_n, color="0.85", label="stated in the paper")
    span_mn = 1e3 * float(np.ptp(force_n))  # the paper's algorithm goes further, out of the picture
    first.set_ylim(1e3 * force_n.min() - 0.4 * span_mn, 1e3 * force_n.max() + 0.4 * span_mn)
    second.set_ylim(-0.8 * span_mn, 0.8 * span_mn)
    rows: list[Row] = [("", "rms", "max", f"within {1e3 * bound_n:g} mN")]
    for name, made_n in shown.items():
        error_n = np.abs(made_n - force_n)
        share = f"{100 * np.mean(error_n <= bound_n):.1f} %"
        rows.append((name, newton(rms(error_n)), newton(float(error_n.max())), share))
        first.plot(time_s, 1e3 * made_n, label=name)
        second.plot(time_s, 1e3 * (made_n - force_n), label=name)
    rows.append(("the force itself", newton(rms(force_n)), newton(float(np.abs(force_n).max())), ""))
    _finish(first, "force in mN")
    _finish(second, "error in mN")
    return Section(
        f"Figures {figures}: {run.instrument}, simulated bench",
        "Not the paper's phantom: the simulated vessel, stage and operator of this product in virtual time.",
        rows,
        figure,
    )


def _finish(axes: Axes, y: str) -> None:
    axes.set(xlabel="time in s", ylabel=y)
    axes.margins(x=0.01)
    axes.legend(ncols=5, loc="lower left", bbox_to_anchor=(0, 1))  # where it hides nothing


def identified(*parts: tuple[float, float]) -> tuple[Array, Array, tuple[str, ...]]:
    """(the paper's theta, the product's, what the product says is not determined) after 20 s at 100 Hz."""
    time_s, phi = sines(100.0, 20.0, parts)
    rls = product_rls(phi)
    _, paper = learn(time_s, phi, phi @ THETA, 0.0)
    _, product = learn(time_s, phi, phi @ THETA, 0.0, rls)
    scales = np.array(rls.scales)
    informed = np.linalg.inv(rls.covariance * np.outer(scales, scales))
    gathered = np.asarray(informed - np.eye(len(scales)) / PRIOR_VARIANCE, np.float64)
    return paper, product, analyse(gathered, ("m", "b", "k"), rls.scales)


def not_identifiable() -> Section:
    paper, product, says = identified((1.0, 1.0))
    _, two, _ = identified((1.0, 1.0), (0.3, 4.0))
    rows: list[Row] = [("learned from sin t", "m, b, k", "at 2 rad/s", "at 5 rad/s", "at 10 rad/s")]
    for name, theta in (
        ("truth", THETA),
        ("paper", paper),
        (f"product, which says: {'; '.join(says)}", product),
        ("product, with a sine of 4 rad/s besides", two),
    ):
        rows.append((name, named(theta), *(newton(amplitude_n(theta, w)) for w in (2.0, 5.0, 10.0))))
    return Section(
        "(a) Mass and stiffness can not be told apart",
        "With x = sin t, x'' = -x: two columns of the regression are one. The prediction is right at 1 rad/s "
        "and wrong at any other frequency.",
        rows,
    )


def expected_overflow_s(lam: float) -> float:
    """When lambda^-k / delta passes the largest double at 1 kHz: k = ln(1.8e308 delta) / -ln(lambda)."""
    return (log(float_info.max) + log(DELTA)) / -log(lam) / 1000.0


@dataclass(frozen=True, slots=True)
class Windup:
    """When the numbers overflow; when a parameter first exceeds 1e5 (true: 1); and each 20 ms the trace of P,
    relative to its start, and the largest parameter.
    """

    overflow_s: float
    exceeds_s: float
    growth: Array
    largest: Array


def windup(lam: float | None, seed: int | None = None) -> Windup:
    """x = sin t at 1 kHz, with a seed and 1 mN of noise: the paper's algorithm, or the product (lam None)."""
    phi = sines(1000.0, 1.02 * expected_overflow_s(lam or 0.98))[1]
    force_n = phi @ THETA + noise_n(len(phi), 0.001, seed)
    rls: Rls = paper_rls(lam=lam) if lam else product_rls(phi)
    start = float(np.trace(np.array(rls.covariance)))
    exceeds_s = inf
    growth: list[float] = []
    largest: list[float] = []
    with np.errstate(over="ignore", invalid="ignore"):
        for i, y in enumerate(force_n.tolist()):
            size = float(np.abs(updated(rls, phi[i], y, 1e-3)).max())
            if not np.isfinite(size):
                return Windup(i / 1000.0, exceeds_s, np.array(growth), np.array(largest))
            exceeds_s = min(exceeds_s, i / 1000.0) if size > 1e5 else exceeds_s
            if i % 20 == 0:
                growth.append(float(np.trace(np.array(rls.covariance))) / start)
                largest.append(size)
    return Windup(inf, exceeds_s, np.array(growth), np.array(largest))


def wind_up() -> Section:
    clean = {lam: windup(lam) for lam in (0.95, PAPER_LAMBDA, 0.97, 0.98)}
    noisy = [windup(PAPER_LAMBDA, seed) for seed in range(3)]
    product = windup(None, 0)
    rows: list[Row] = [
        ("forgetting factor", "overflow after", "by lambda^-k / delta alone", "passes 1e5 after")
    ]
    exceeds = f"{sorted(one.exceeds_s for one in noisy)[1]:.3g} s with 1 mN of noise"
    for lam, one in clean.items():
        sizes = f"{one.overflow_s:.3g} s", f"{expected_overflow_s(lam):.3g} s"
        rows.append((f"{lam:g}", *sizes, exceeds if lam == PAPER_LAMBDA else ""))
    rows.append(("product, 1 mN of noise", f"P at most {product.growth.max():.3g} of its start", "", "never"))
    return Section(
        "(b) The update overflows",
        "At 1 kHz P grows as lambda^-k in the direction that sin t does not excite. With 1 mN of noise the "
        "parameters are arbitrary long before that. The paper recommends a factor of 0.95 to 0.99.",
        rows,
    )


def memory_rms(rate_hz: float, seeds: int = 5) -> dict[str, list[float]]:
    """rms of the error at that rate with 5 mN of noise and the delay, one for each noise."""
    time_s, phi = sines(rate_hz, 15.0)
    force_n, inertia_n = phi @ THETA, THETA[0] * phi[:, 0]
    late = time_s >= _SCORED_FROM_S + DELAY_S
    found: dict[str, list[float]] = {"paper": [], "m known": [], "product": []}
    for seed in range(seeds):
        measured_n = force_n + noise_n(len(force_n), 0.005, seed)
        made = {
            "paper": learn(time_s, phi, measured_n, DELAY_S)[0],
            "m known": learn(time_s, phi[:, 1:], measured_n - inertia_n, DELAY_S)[0] + inertia_n,
            "product": learn(time_s, phi, measured_n, DELAY_S, product_rls(phi))[0],
        }
        for name, predicted_n in made.items():
            found[name].append(rms((predicted_n - force_n)[late]))
    return found


def memory() -> Section:
    rows: list[Row] = [
        ("sample rate", "memory", "paper, median of five", "lowest, highest", "m known", "product")
    ]
    for rate_hz in (1000.0, 100.0, 10.0):
        found = memory_rms(rate_hz)
        middle = [newton(float(np.median(sizes))) for sizes in found.values()]
        spread = f"{newton(min(found['paper']))}, {newton(max(found['paper']))}"
        seconds = quantity(-1.0 / (rate_hz * log(PAPER_LAMBDA)), "s")
        rows.append((f"{rate_hz:g} Hz", seconds, middle[0], spread, *middle[1:]))
    return Section(
        "(c) The forgetting factor is a memory in samples",
        "rms with 5 mN of noise, 300 ms late, lambda 0.96. With m known nothing is unidentifiable, and what "
        "remains is the short memory alone. The product's memory is 2 s at any rate.",
        rows,
    )


def unmodelled_rms(what: str, size_n: float) -> dict[str, float]:
    """rms of what a bias or a Coulomb friction leaves at 10 Hz over whole periods. The closed form is that of
    lambda = 1: all of a bias; of friction all but its first harmonic (4 / pi) Fc cos t, which is a damping.
    """
    time_s, phi = sines(10.0, 8 * PERIOD_S)
    one, sense = np.ones_like(time_s), np.sign(phi[:, 1])
    force_n = phi @ THETA + size_n * (one if what == "bias" else sense)
    wide = np.column_stack([phi, one, sense])
    made = {
        "paper": learn(time_s, phi, force_n, DELAY_S)[0],
        "lambda = 1": learn(time_s, phi, force_n, DELAY_S, paper_rls(lam=1.0))[0],
        "product": learn(time_s, wide, force_n, DELAY_S, product_rls(wide))[0],
    }
    sizes = {name: rms((predicted_n - force_n)[time_s >= 2 * PERIOD_S]) for name, predicted_n in made.items()}
    return {**sizes, "closed form": size_n * (1.0 if what == "bias" else sqrt(1.0 - 8.0 / pi**2))}


def unmodelled() -> Section:
    made = {what: unmodelled_rms(what, 0.010) for what in ("bias", "friction")}
    rows = [(f"10 mN of {what}", *(newton(size) for size in sizes.values())) for what, sizes in made.items()]
    return Section(
        "(d) No bias and no friction in the model",
        "rms on the paper's simulation at 10 Hz, where its algorithm works best, 300 ms late. A bias stays "
        "in the error; of friction the model takes up what looks like damping. The product's model has both.",
        [("", *made["bias"]), *rows],
    )


def pairing_rms() -> dict[str, float]:
    """rms on x = sin t at 100 Hz. The wrong pairing learns the delayed force: it is the hold."""
    time_s, phi = sines(100.0, 3 * PERIOD_S)
    force_n = phi @ THETA
    made = {
        "hold": held(time_s, force_n, DELAY_S),
        "paper": learn(time_s, phi, force_n, DELAY_S)[0],
        "newest": learn(time_s, phi, force_n, DELAY_S, newest_motion=True)[0],
        "product": learn(time_s, phi, force_n, DELAY_S, product_rls(phi))[0],
    }
    return {name: rms((predicted_n - force_n)[time_s >= PERIOD_S]) for name, predicted_n in made.items()}


def baseline(runs: Sequence[ComparedRun]) -> Section:
    others = METHODS[1:]
    rows: list[Row] = [("rms at 300 ms", "force", "hold", *(f"{name} / hold" for name in others))]
    for run in runs:
        sizes = newton(rms(run.force_n[run.scored])), newton(rms(run.error_n("hold")))
        rows.append((run.name, *sizes, *(f"{run.of_hold(name):.3g}" for name in others)))
    sine = pairing_rms()
    ratios = (f"{sine[name] / sine['hold']:.3g}" if name in sine else "" for name in others)
    rows.append(("x = sin t", newton(amplitude_n(THETA, 1.0) / sqrt(2.0)), newton(sine["hold"]), *ratios))
    return Section(
        "(e) No baseline, (f) the late force paired with the newest motion",
        "Above 1 doing nothing is better. Tared: on the force less its first value. The memory of "
        "25 samples (c) and the missing bias (d) carry the right pairing astray over 300 ms. inf: diverged.",
        rows,
    )


def since(runs: Sequence[ComparedRun]) -> Section:
    """The published methods of `benchmarks.prediction_published` on the same runs, over the same delay."""
    rows: list[Row] = [("rms / hold at 300 ms", "paper", *PUBLISHED_SINCE.values(), "product")]
    table = list[list[float]]()
    for run in runs:
        prepared = prepare(run.recording, DelayedLink(DELAY_S))
        scores = scored("", run.name, prepared, list(PUBLISHED_SINCE), OfflineNetworks({}))
        others = [inf if score.ratio is None else score.ratio for score in scores]
        table.append([run.of_hold("paper"), *others, run.of_hold("product")])
        rows.append((run.name, *(f"{ratio:.3g}" for ratio in table[-1])))
    with np.errstate(divide="ignore"):
        logs = np.log(np.array(table))
    means = [float(np.exp(np.mean(column[np.isfinite(column)]))) for column in logs.T]
    rows.append(("geometric mean of those above 0", *(f"{mean:.3g}" for mean in means)))
    return Section(
        "Since the paper",
        "Kelvin-Voigt and Hunt-Crossley by exponentially weighted recursive least squares (Batty et al., "
        "Sensors 2022, 22, 9770), with the contact known in hindsight and the best of five forgetting "
        "factors; a model-free forecast (Narayan and Fey, PLoS ONE 2020), the best of six: flattered, all.",
        rows,
    )


def named(theta: Array) -> str:
    return ", ".join(f"{name} {value:.3g}" for name, value in zip("mbk", theta.tolist(), strict=True))


def newton(value: float) -> str:
    return quantity(value, "N") if np.isfinite(value) else "diverged"


# --- the command ---


def make(out: Path, folders: Sequence[Path], seed: int, duration_s: float) -> None:
    """Computes everything, writes the figures, prints the tables."""
    benches = [bench_run(what, duration_s, seed) for what in BOUNDS_N]
    runs, skipped = list(benches), []
    for path in sorted(path for folder in folders for path in folder.iterdir()):
        if path.suffix.lower() in {".csv", ".parquet", ".mcap"}:
            try:
                runs.append(measured_run(path))
            except RecordingError as error:
                skipped.append(f"{path.name} skipped: {error}")
    sections = [simulation(), *map(bench, benches), not_identifiable(), wind_up(), memory(), unmodelled()]
    for one in (*sections, baseline(runs), since(runs)):
        if one.figure:
            name = re.sub(r"\W+", "_", one.title.partition(":")[0]).strip("_").lower()
            one.figure.savefig(out / f"{name}.png", dpi=120)
        table = (" | ".join(line) for line in one.rows)
        print(f"\n{one.title}", one.caption, *table, sep="\n  ")
    print("", *skipped, f"the figures are in {out}", sep="\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; exit 1: a run failed, 2: wrong input."""
    parser = argparse.ArgumentParser(prog="python -m studies.paper", description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the figures")
    parser.add_argument(
        "--recordings",
        type=Path,
        metavar="DIR",
        help="measured recordings; default: the variable FOREFEEL_DATA",
    )
    parser.add_argument("--seed", type=int, default=1, help="of operator, world and network of the bench")
    parser.add_argument("--duration", type=float, default=16.0, metavar="S", help="of each run of the bench")
    options = parser.parse_args(arguments)
    named = options.recordings or os.environ.get("FOREFEEL_DATA")
    if named and not Path(named).is_dir():
        parser.error(f"--recordings {named}: no such folder; expected a folder of recordings")
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        make(options.out, [Path(named)] if named else [], options.seed, options.duration)
    except (ForefeelError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
