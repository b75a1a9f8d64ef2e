"""Draws a recording: `draw(kind, seed)`.

A kind is a name of the vocabulary, two of them joined by `+`, `nothing`, `outside` (or one of its own names),
`pure_sine`, `constant_speed`, `standstill`. The same kind, seed and size give the same recording.
"""

from math import pi
from zlib import crc32

import numpy as np

from tests.hidden_effects.generator.chain import CHAIN
from tests.hidden_effects.generator.friction import FRICTION
from tests.hidden_effects.generator.motion import (
    RATE_HZ,
    RICH,
    STEP_S,
    WEIGHTS,
    Motion,
    drawn_motion,
    log_uniform,
)
from tests.hidden_effects.generator.outside import OUTSIDE
from tests.hidden_effects.generator.parts import Base, Form, Part, Place, Scene, Signal, transmit
from tests.hidden_effects.generator.scan import Array, one_pole
from tests.hidden_effects.generator.truth import Hidden, Noise, Truth, reading
from tests.hidden_effects.generator.wall import WALL

FORMS: tuple[Form, ...] = (*FRICTION, *WALL, *CHAIN)
VOCABULARY: tuple[str, ...] = tuple(dict.fromkeys(form.name for form in FORMS))
OUTSIDE_NAMES: tuple[str, ...] = tuple(form.name for form in OUTSIDE)
SPECIAL = ("pure_sine", "constant_speed", "standstill")

SINE_EFFECTS = ("", "coulomb_friction", "stiffening", "stress_relaxation", "time_delay", "backlash", "bias")
"""What a pure sine may hide; the empty name is nothing."""
STEADY_EFFECTS = ("", "coulomb_friction", "bias")
"""What a constant speed may hide."""

CONTRADICTIONS: tuple[frozenset[str], ...] = tuple(
    frozenset(pair.split("+"))
    for pair in (
        "coulomb_friction+stribeck_friction", "coulomb_friction+presliding_hysteresis",
        "stribeck_friction+presliding_hysteresis", "time_delay+sensor_lag",
        "presliding_hysteresis+backlash", "presliding_hysteresis+stress_relaxation",
        "contact_loss+backlash", "contact_loss+stiffening", "contact_loss+hunt_crossley_damping",
        "contact_loss+stiffness_change", "contact_loss+position_dependent_friction",
        "contact_loss+stress_relaxation", "contact_loss+asymmetric_damping", "contact_loss+bias",
        "sensor_saturation+sensor_spikes", "quadratic_drag+asymmetric_damping",
        "coulomb_friction+bias", "stribeck_friction+position_dependent_friction",
        "presliding_hysteresis+position_dependent_friction",
    )
)  # fmt: skip
"""Pairs that are not drawn: one contains the other, or their order on the way is a matter of taste."""

_LARGEST_RATIO_S, _LARGEST_RATIO_S2 = 0.5, 0.02
"""Of damping and of mass to stiffness: a slow motion does not get a carriage in place of a catheter."""


def draw(
    kind: str,
    seed: int,
    size: float = 1.0,
    longest_s: float = 60.0,
    fastest_hz: float = 2000.0,
    slowest_hz: float = 50.0,
    motion: str = "",
) -> Hidden:
    """A recording of that kind; `size` scales the shares (0.25: a quarter).

    `longest_s`, `fastest_hz` and `slowest_hz` bound the record, for tests that have no time for long ones;
    `motion`: one of RICH in place of any of them.

    Raises:
        KeyError: no such kind.
    """
    rng = np.random.default_rng((crc32(kind.encode()), seed))
    forms = _drawn_forms(rng, kind)
    motion_kind = kind if kind in SPECIAL else motion or str(rng.choice(RICH, p=WEIGHTS))
    inserted = next((form.inserted for form in forms if form.inserted is not None), bool(rng.random() < 0.5))
    duration_s = float(rng.uniform(10.0, longest_s))
    rate_hz = min(fastest_hz, max(slowest_hz, _drawn_rate(rng, forms)))
    stage = drawn_motion(rng, motion_kind, duration_s, inserted)
    base = _drawn_base(rng, stage, any(form.light for form in forms))
    scene = Scene(stage, base, base.force(stage.x, stage.v, stage.a), duration_s, rate_hz)
    parts, shares = _drawn_parts(rng, forms, scene, size)
    noise = Noise(2e-3, log_uniform(rng, 5.0, 50.0), rng.uniform(0.1e-3, 0.5e-3), 1e-6)
    uniform = bool(rng.random() < 0.8)
    time_s = _stamps(rng, duration_s, rate_hz, uniform)
    force_n = reading(stage, base, parts, time_s, _drawn_noise(rng, noise, stage, time_s))
    position_m = np.round(np.interp(time_s, stage.t, stage.x) / noise.encoder_m) * noise.encoder_m
    truth = Truth(parts, shares, motion_kind, duration_s, rate_hz, base, noise)
    return Hidden(time_s, position_m, force_n, truth, stage)


def drawn_pairs(seed: int, count: int) -> list[str]:
    """Kinds of that many different pairs without contradictions."""
    rng = np.random.default_rng(seed)
    pairs: dict[str, None] = {}
    while len(pairs) < count:
        first, second = sorted(rng.choice(VOCABULARY, 2, replace=False).tolist())
        if frozenset((first, second)) not in CONTRADICTIONS:
            pairs[f"{first}+{second}"] = None
    return list(pairs)


def _drawn_forms(rng: np.random.Generator, kind: str) -> list[Form]:
    names = {
        "nothing": (),
        "standstill": (),
        "outside": (str(rng.choice(OUTSIDE_NAMES)),),
        "pure_sine": (str(rng.choice(SINE_EFFECTS)),),
        "constant_speed": (str(rng.choice(STEADY_EFFECTS)),),
    }.get(kind, tuple(kind.split("+")))
    return [_drawn_form(rng, name) for name in names if name]


def _drawn_form(rng: np.random.Generator, name: str) -> Form:
    forms = [form for form in (*FORMS, *OUTSIDE) if form.name == name]
    if not forms:
        raise KeyError(f"no kind {name!r}")
    return forms[int(rng.integers(len(forms)))]


def _drawn_rate(rng: np.random.Generator, forms: list[Form]) -> float:
    """Seven in ten between 200 and 1000 Hz, the others from 50 to 2000 Hz."""
    lowest = max([50.0, *(form.lowest_rate_hz for form in forms)])
    low, high = (200.0, 1000.0) if rng.random() < 0.7 else (50.0, 2000.0)
    return log_uniform(rng, max(low, lowest), high)


def _drawn_base(rng: np.random.Generator, stage: Motion, light: bool) -> Base:
    """From the weights of spring, damper and mass in the force, whose std is 0.2 to 0.4 N."""
    weights = rng.uniform(0.5, 1.0), rng.uniform(0.15, 0.7), rng.uniform(0.05, 0.4)
    wanted_n = rng.uniform(0.2, 0.4)
    weights = (*weights[:2], 0.1 * weights[2]) if light else weights
    spreads = [float(np.std(column)) for column in (stage.x, stage.v, stage.a)]
    if min(spreads) < 1e-9:
        stiffness = wanted_n / spreads[0] if spreads[0] > 1e-9 else rng.uniform(10.0, 60.0)
        return Base(rng.uniform(0.05, 0.3), rng.uniform(1.0, 5.0), stiffness)
    k, b, m = (weight / spread for weight, spread in zip(weights, spreads, strict=True))
    b, m = min(b, _LARGEST_RATIO_S * k), min(m, _LARGEST_RATIO_S2 * k)
    size = wanted_n / float(np.std(m * stage.a + b * stage.v + k * stage.x))
    return Base(size * m, size * b, size * k)


def _drawn_parts(
    rng: np.random.Generator, forms: list[Form], scene: Scene, size: float
) -> tuple[tuple[Part, ...], tuple[float, ...]]:
    parts: list[Part] = []
    for form in forms:
        part = Part(form, form.draw(rng, scene))
        wanted = size * log_uniform(rng, *form.shares)
        parts.append(part.scaled(size) if form.own_size else sized(part, scene, wanted))
    return tuple(parts), tuple(share(part, scene) for part in parts)


def share(part: Part, scene: Scene) -> float:
    """std of the added force over std of the mass-damper-spring force; its rms where it is constant."""
    added = _added(part, scene)
    recorded = scene.motion.t >= 0.0
    inside = added[recorded]
    spread, rms = float(np.std(scene.force[recorded])), float(np.sqrt(np.mean(inside * inside)))
    constant = part.form.linear and float(np.std(inside)) < 1e-6 * rms
    return (rms if constant else float(np.std(inside))) / spread


def _added(part: Part, scene: Scene) -> Array:
    """The force that the effect alone adds; of what acts on samples, at the recording's rate."""
    if part.form.place is not Place.READING:
        return transmit(scene.motion, scene.base, (part,)) - scene.force
    every = max(1, round(RATE_HZ / scene.rate_hz))
    force = scene.force[::every]
    zeros = np.zeros_like(force)
    signal = Signal(scene.base, scene.motion.t[::every], zeros, zeros, zeros, force)
    part.form.act(signal, part.values)
    change = np.zeros_like(scene.force)
    change[: len(force) * every] = np.repeat(signal.force - force, every)[: len(change)]
    return change


def sized(part: Part, scene: Scene, wanted: float, tolerance: float = 0.005) -> Part:
    """The part at the scale that gives the share: one step when linear, else bisection of the logarithm."""
    if part.form.linear:
        return part.scaled(wanted / share(part, scene))
    thin = Scene(scene.motion.thinned(10), scene.base, scene.force[::10], scene.duration_s, scene.rate_hz)
    coarse = scene if part.form.place is Place.READING else thin
    low, high = np.log(1e-3), np.log(1e3)
    for _ in range(40):
        middle = 0.5 * (low + high)
        reached = share(part.scaled(float(np.exp(middle))), coarse)
        if abs(reached - wanted) < tolerance * wanted:
            break
        low, high = (middle, high) if reached < wanted else (low, middle)
    return part.scaled(float(np.exp(middle)))


def _stamps(rng: np.random.Generator, duration_s: float, rate_hz: float, uniform: bool) -> Array:
    """Regular, or with jitter of up to 30 % of the period and one sample in 500 missing."""
    count = int(duration_s * rate_hz)
    regular = np.arange(count) / rate_hz
    if uniform:
        return regular
    jittered = regular + rng.uniform(-0.3, 0.3, count) / rate_hz
    kept = jittered[rng.random(count) > 0.002]
    return np.asarray(kept - kept[0])


def _drawn_noise(rng: np.random.Generator, noise: Noise, stage: Motion, time_s: Array) -> Array:
    """AR(1) on the fine grid, so that irregular stamps see the same spectrum; white on the samples."""
    pole = float(np.exp(-2.0 * pi * noise.corner_hz * STEP_S))
    coloured = one_pole(pole, rng.standard_normal(len(stage.t)))
    coloured *= noise.rms_n / float(np.std(coloured))
    nearest = np.clip(np.rint((time_s - stage.t[0]) / STEP_S).astype(int), 0, len(stage.t) - 1)
    return np.asarray(coloured[nearest] + noise.white_n * rng.standard_normal(len(time_s)))
