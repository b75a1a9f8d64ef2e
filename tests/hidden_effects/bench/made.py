"""Draws a recording of a population: `draw(population, seed)`; the same arguments give the same recording.

An effect has to be visible: by the difference between the bench with it and without it, refitted with mass,
damping, stiffness and bias by plain least squares, its share of the force is at least LEAST_SHARE times the
noise's rms, or everything but the kind of effect is drawn anew (of several effects each has to be). `odd` and
what the diagnosis makes of a recording are exempt: nothing is ever selected by what it finds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from math import inf
from typing import NamedTuple

import numpy as np

from tests.hidden_effects.bench import effects as hidden
from tests.hidden_effects.bench.effects import Effect, Maker
from tests.hidden_effects.bench.measure import NOISES, Bench, Sensor, Take, encoded, noise, read, stamps
from tests.hidden_effects.bench.rig import Body, Link, Rig, Wall, contact
from tests.hidden_effects.bench.stage import AFTER_S, ODD, USUAL, Array, Rng, Stage, log_uniform, moved

LEAST_SHARE = 3.0
"""Of an effect, in multiples of the noise's rms."""
_MOST_TRIES = 300
_MOST_SAMPLES = 30_000
_ENCODER_M = (1e-6, 50e-6)  # m, from a linear scale to a motor's hall sensors
_STROKES_M = (2e-3, 60e-3)  # m, from a vessel's diameter to a catheter's advance
_FORCES_N = (0.05, 5.0)  # N rms, from a guidewire's tip to a needle
_NOISE_SHARES, _NOISES_N = (0.005, 0.05), (0.3e-3, 5e-3)  # of the force's rms, and N: load cells of 1 to 10 N
_MASSES_KG = (0.02, 0.4)  # kg, from a shaft with its clamp to a gripper
_SLOWEST_S = 0.5  # s, the largest ratio of damping to stiffness


class Population(Enum):
    KNOWN = "known"
    PLAY = "play"
    COMPOSITIONS = "compositions"
    SLOW = "slow"
    NOTHING = "nothing"
    HUM = "hum"
    ODD = "odd"


@dataclass(frozen=True)
class Made:
    """A recording and its truth. `names` are those of the vocabulary, `families` all that are really there.

    `hides` is False only where mass, damper, spring and bias are everything.
    """

    time_s: Array
    position_m: Array
    force_n: Array
    names: frozenset[str]
    families: frozenset[str]
    description: str
    hides: bool
    parameters: dict[str, Mapping[str, float]]


class _Plan(NamedTuple):
    makers: tuple[Maker, ...]
    rates_hz: tuple[float, float] = (100.0, 2000.0)
    durations_s: tuple[float, float] = (10.0, 40.0)
    paths: tuple[str, ...] = USUAL
    tremor_m: tuple[float, float] = (5e-6, 100e-6)


def _nothing(rng: Rng, bench: Bench) -> list[Effect]:
    return []


_PLANS = {
    Population.KNOWN: _Plan(hidden.KNOWN),
    Population.PLAY: _Plan((hidden.drive_play, hidden.hub_play)),
    Population.COMPOSITIONS: _Plan(hidden.COMPOSITIONS),
    Population.SLOW: _Plan(tuple(m for m in hidden.KNOWN if m not in hidden.FAST), (20.0, 100.0)),
    Population.NOTHING: _Plan((_nothing,), (20.0, 2000.0)),
    Population.HUM: _Plan((hidden.hum,), (200.0, 2000.0), paths=("hand",), tremor_m=(50e-6, 200e-6)),
    Population.ODD: _Plan((*hidden.KNOWN, _nothing), (20.0, 2000.0), (3.0, 10.0), ODD),
}


def draw(population: Population, seed: int) -> Made:
    """The kinds of effect take turns with the seed.

    Raises:
        RuntimeError: no visible recording in _MOST_TRIES.
    """
    bench, take, found, share, force_n = _visible(population, seed)
    return _recorded(bench, take, found, share, force_n)


def draw_two(population: Population, seed: int) -> tuple[Made, Made]:
    """The recording of `draw`, and another one of the same bench: another path, from the same position on and
    with the same stroke.

    Raises:
        RuntimeError: as `draw`.
    """
    bench, take, found, share, force_n = _visible(population, seed)
    rng = np.random.default_rng((list(Population).index(population), seed, 1))
    stage = moved(rng, str(rng.choice(_PLANS[population].paths)), bench.duration_s, bench.reach_m, 0.0)
    stage = replace(stage, x=stage.x - np.min(stage.x) + np.min(bench.stage.x))
    other = replace(bench, stage=stage)
    other_n = read(changed(other, found), take)
    return _recorded(bench, take, found, share, force_n), _recorded(other, take, found, share, other_n)


def _visible(population: Population, seed: int) -> tuple[Bench, Take, list[Effect], float, Array]:
    plan = _PLANS[population]
    rng = np.random.default_rng((list(Population).index(population), seed))
    maker = plan.makers[seed % len(plan.makers)]
    for _ in range(_MOST_TRIES):
        bench, take = _drawn_bench(rng, plan, maker)
        found = maker(rng, bench)
        force_n = read(changed(bench, found), take)
        share = inf if population is Population.ODD else visibility(bench, take, found, force_n)
        if share >= LEAST_SHARE:
            return bench, take, found, share, force_n
    raise RuntimeError(f"{population.value} {seed}: nothing visible in {_MOST_TRIES} recordings")


def visibility(bench: Bench, take: Take, found: Sequence[Effect], complete: Array) -> float:
    """The smallest share of an effect in the `complete` force by the noise's rms; infinite without any."""
    if not found:
        return inf
    x = np.stack(bench.stage.at(take.time_s), axis=1)
    columns = np.column_stack((x / np.maximum(np.std(x, axis=0), 1e-12), np.ones(len(x))))
    shares = []
    for effect in found:
        added = complete - read(changed(bench, [other for other in found if other is not effect]), take)
        left = added - columns @ np.linalg.lstsq(columns, added, rcond=None)[0]
        shares.append(float(np.sqrt(np.mean(left**2))) / take.noise_rms_n)
    return min(shares)


def changed(bench: Bench, found: Sequence[Effect]) -> Bench:
    """The bench with these effects."""
    for effect in found:
        bench = effect.change(bench)
    return bench


def _recorded(bench: Bench, take: Take, found: Sequence[Effect], share: float, force_n: Array) -> Made:
    said = " + ".join(effect.words for effect in found) or "nothing"
    return Made(
        time_s=take.time_s,
        position_m=encoded(bench, take),
        force_n=force_n,
        names=frozenset(effect.name for effect in found if effect.name),
        families=frozenset[str]().union(*(effect.families for effect in found)),
        description=f"{said}{f' [{share:.1f} x noise]' if share < inf else ''} in {take.words}",
        hides=bool(found),
        parameters={effect.name: effect.parameters for effect in found if effect.name},
    )


def _drawn_bench(rng: Rng, plan: _Plan, maker: Maker) -> tuple[Bench, Take]:
    stage, words = _drawn_stage(rng, plan, (rate_hz := _drawn_rate_hz(rng, plan, maker)))
    free = bool(rng.random() < 0.2) and (maker in hidden.WITHOUT_WALL or maker is _nothing)
    rig, ideal_n = _drawn_rig(rng, stage, free)
    noise_n = float(np.clip(_rms(ideal_n) * log_uniform(rng, *_NOISE_SHARES), *_NOISES_N))
    force_n, peak_n = float(np.std(ideal_n)), float(np.max(np.abs(ideal_n)))
    sensor, duration_s = Sensor(bias_n=rng.uniform(-0.5, 0.5) * force_n), float(stage.t[-1]) - AFTER_S
    bench = Bench(stage, rig, sensor, duration_s, noise_n, force_n, peak_n)
    return bench, _drawn_take(rng, bench, rate_hz, words)


def _drawn_rate_hz(rng: Rng, plan: _Plan, maker: Maker) -> float:
    low, high = plan.rates_hz
    return log_uniform(rng, max(low, 200.0) if maker in hidden.FAST else low, high)


def _drawn_stage(rng: Rng, plan: _Plan, rate_hz: float) -> tuple[Stage, str]:
    path, stroke_m = str(rng.choice(plan.paths)), log_uniform(rng, *_STROKES_M)
    duration_s = min(rng.uniform(*plan.durations_s), _MOST_SAMPLES / rate_hz)
    tremor_m = min(log_uniform(rng, *plan.tremor_m), 0.02 * stroke_m) if path == "hand" else 0.0
    words = f"{path} {1e3 * stroke_m:.3g} mm, tremor {1e6 * tremor_m:.0f} um, {duration_s:.0f} s"
    return moved(rng, path, duration_s, stroke_m, tremor_m), words


def _drawn_take(rng: Rng, bench: Bench, rate_hz: float, words: str) -> Take:
    """An encoder counts at least 400 steps of a stroke: nobody measures a short one with a coarse one."""
    colour, kind = str(rng.choice(NOISES)), str(rng.choice(("even", "even", "jittered", "dropped")))
    time_s = stamps(rng, kind, bench.duration_s, rate_hz)
    encoder_m = min(log_uniform(rng, *_ENCODER_M), bench.reach_m / 400.0)
    rig, noises_n = bench.rig, noise(rng, colour, len(time_s), rate_hz, bench.noise_rms_n)
    words += f" {rate_hz:.0f} Hz {kind}, noise {colour} {1e3 * bench.noise_rms_n:.2g} mN"
    words += f", encoder {1e6 * encoder_m:.2g} um, force {bench.force_n:.3g} N, m {rig.bodies[0].mass_kg:.3g}"
    words += f" b {rig.wall.forward_n_s_m:.3g} k {rig.wall.stiffness_n_m:.3g}"
    return Take(time_s, rate_hz, noises_n, encoder_m, int(rng.integers(2**31)), words)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _drawn_rig(rng: Rng, stage: Stage, free: bool) -> tuple[Rig, Array]:
    """One body on the load cell, pressed against the wall or clamped in it; and the ideal force of it."""
    wanted_n = log_uniform(rng, *_FORCES_N)
    stiffness = 0.0 if free else wanted_n * rng.uniform(0.5, 1.0) / float(np.std(stage.x))
    damping = wanted_n * rng.uniform(0.05, 0.5) / _rms(stage.v)
    damping = damping if free else min(damping, _SLOWEST_S * stiffness)
    mass_kg = float(np.clip(wanted_n * log_uniform(rng, 0.005, 0.3) / _rms(stage.a), *_MASSES_KG))
    low, reach = float(np.min(stage.x)), float(np.ptp(stage.x))
    rest_m = low + reach * (rng.uniform(-0.2, 0.0) if rng.random() < 0.6 else rng.uniform(0.3, 0.7))
    cell_hz = max(rng.uniform(250.0, 700.0), np.sqrt(50.0 * stiffness / mass_kg) / (2.0 * np.pi))
    cell = Link(*contact(mass_kg, cell_hz, rng.uniform(0.3, 0.6)))
    wall = Wall(stiffness, rest_m, damping, damping)
    ideal_n = mass_kg * stage.a + damping * stage.v + stiffness * (stage.x - rest_m)
    return Rig((Body(mass_kg),), (cell,), wall), ideal_n
