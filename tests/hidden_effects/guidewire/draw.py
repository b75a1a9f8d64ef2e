"""Draws a guidewire's recording: `draw(kind, seed)`; the same arguments give the same recording."""

from functools import reduce
from math import ceil

import numpy as np

from tests.hidden_effects.guidewire import effects
from tests.hidden_effects.guidewire.effects import Effect, Make, Scene, happening
from tests.hidden_effects.guidewire.wire import Run, Wire, force
from tests.hidden_effects.laboratory.draw import missed, recording
from tests.hidden_effects.laboratory.motion import Motion, Rng, chirped, log_uniform, moved, strokes, tremor
from tests.hidden_effects.laboratory.truth import Array, Recorded
from tests.hidden_effects.laboratory.world import Parts, World, sense_of, std, total

KINDS = ("known", "new", "mixture", "nothing", "outside")
# of 30: 8, 5, 9, 4 and 4
TURN = 4 * ("known", "mixture", "new", "nothing", "mixture", "outside", "known") + ("new", "mixture")
_FINE_HZ, _COARSE_HZ, _MOST = 400.0, 100.0, 30_000
_LEAST, _LARGEST, _ABOVE = 0.06, 0.5, 3.0  # shares of the force's standard deviation; times the noise
_SEEN_HZ = 45.0  # rate of samples that show a tremor
_LATE = 0.03  # share of the force that half a sample of lateness may change
_TRIES = 60
_TIMED = ("pulsation", "varying_pulsation", "sensor_drift", "settling_drift", "mains_hum")


def draw(kind: str, seed: int) -> Recorded:
    """Recording of that kind, with its truth and a second motion of the same world."""
    rng = np.random.default_rng((KINDS.index(kind), seed))
    for _ in range(_TRIES):
        world = _world(rng, _hidden(rng, kind, seed), kind == "outside")
        if world is not None:
            return recording(kind, seed, rng, world)
    raise RuntimeError(f"{kind} {seed}: no world of {_TRIES} hides enough")


def _hidden(rng: Rng, kind: str, seed: int) -> list[Make]:
    if kind == "outside":
        return [effects.outside]
    if kind in ("known", "new"):
        singles = effects.KNOWN if kind == "known" else effects.NEW
        return [singles[seed % len(singles)]]
    if kind == "nothing":
        return []
    weights = np.array([weight for weight, _ in effects.GROUPS])
    count = int(rng.choice([2, 3], p=[0.6, 0.4]))
    at = sorted(rng.choice(len(weights), count, replace=False, p=weights / np.sum(weights)))
    makes = [makes[int(rng.integers(len(makes)))] for makes in (effects.GROUPS[i][1] for i in at)]
    if makes[0] in (effects.rubbing, effects.path) and effects.living in makes and rng.random() < 0.4:
        makes[makes.index(effects.living)] = effects.living_on_friction
    return makes


def _world(rng: Rng, makes: list[Make], outside: bool) -> World | None:
    rate_hz, over, words, (scene, second), bare = _stage(rng, makes)
    hidden = [make(rng, scene) for make in makes]
    run = happening(hidden, rng, scene.m)
    noise_n = log_uniform(rng, 0.5e-3, 5e-3)
    coarse = run.every(max(1, round(1.0 / (_COARSE_HZ * float(run.m.t[1])))))
    sizes = _sizes(rng, bare, hidden, coarse, _ABOVE * noise_n / scene.force_n)
    if sizes is None or not _enough(_parts(bare, hidden, sizes, coarse), coarse.m, 1, noise_n):
        return None
    parts = _parts(bare, hidden, sizes, run)
    if not _enough(parts, scene.m, over, noise_n):
        return None
    there = happening(hidden, rng, second)
    clean_n = std(total(parts))
    exact = [(e.name, key, value) for e, size in zip(hidden, sizes, strict=True)
             for key, value in e.parameters(size).items()]  # fmt: skip
    return World(
        f"{words}: {', '.join(make.__name__ for make in makes) or 'nothing'}", rate_hz, (scene.m, second),
        (parts, {"": force(_wire(bare, hidden, sizes), there)}), noise_n / clean_n,
        rng.uniform(0.0, 0.02),
        log_uniform(rng, 0.03e-6, 80e-6), sense=sense_of(rng),
        allowed=tuple(dict.fromkeys(name for effect in hidden for name in effect.allowed)), outside=outside,
        base=(bare.mass_kg, bare.damping_n_s_m, bare.stiffness_n_m),
        parameters=tuple(exact), over=over, lost=log_uniform(rng, 1e-4, 0.02) if rng.random() < 0.5 else 0.0,
        timed=_TIMED, late=_late(parts, scene.m, 1.0 / rate_hz), further=(run.further, there.further),
    )  # fmt: skip


def _wire(bare: Wire, hidden: list[Effect], sizes: list[float]) -> Wire:
    return reduce(lambda wire, each: each[0].with_it(wire, each[1]), zip(hidden, sizes, strict=True), bare)


def _parts(bare: Wire, hidden: list[Effect], sizes: list[float], run: Run) -> Parts:
    """Change of the force by each effect beside the others; "" is what is left of it."""
    whole = force(_wire(bare, hidden, sizes), run)
    parts: Parts = {"": whole}
    for i, effect in enumerate(hidden):
        others = _wire(bare, hidden[:i] + hidden[i + 1 :], sizes[:i] + sizes[i + 1 :])
        parts[effect.name] = whole - force(others, run)
        parts[""] = parts[""] - parts[effect.name]
    return parts


def _late(parts: Parts, m: Motion, sample_s: float) -> float:
    """Samples by which the force may be read late, up to a half: so few that it is no cause of weight."""
    force = total({name: part for name, part in parts.items() if name not in _TIMED})
    changes = np.interp(m.t - 0.5 * sample_s, m.t, force) - force
    return 0.5 * min(1.0, _LATE * std(force) / missed(m, changes))


def _enough(parts: Parts, m: Motion, over: int, noise_n: float) -> bool:
    """True if each effect is neither lost nor all there is, in a force of a guidewire."""
    force_n = std(total(parts))
    least = max(_LEAST, _ABOVE * noise_n / force_n)
    shares = [missed(m, part, over) / force_n for name, part in parts.items() if name]
    return all(least < share < _LARGEST for share in shares) and 0.02 < force_n < 2.0


def _stage(rng: Rng, makes: list[Make]) -> tuple[float, int, str, tuple[Scene, Motion], Wire]:
    """Rate, steps of the grid per sample, words; the scene of the first motion, the second; the bare wire."""
    quick: dict[Make, float] = {effects.hum: 200.0, effects.mode: 60.0}
    rate_hz = log_uniform(rng, max(quick.get(make, 20.0) for make in [*makes, effects.coulomb]), 1000.0)
    lasts_s = min(log_uniform(rng, 20.0, 90.0), _MOST / rate_hz)
    over = max(1, ceil(_FINE_HZ / rate_hz))
    t = np.arange(round(lasts_s * rate_hz) * over) / (rate_hz * over)
    travel_m = log_uniform(rng, 10e-3, 60e-3)
    home_m = travel_m * rng.uniform(-0.5, 0.5) if rng.random() < 0.3 else 0.0
    form = str(rng.choice(["strokes", "operator", "chirp", "ramps"], p=[0.3, 0.35, 0.15, 0.2]))
    leg_s, spread, rests = log_uniform(rng, 0.4, 2.0), log_uniform(rng, 1.5, 5.0), rng.uniform(0.0, 0.6)
    shakes_m, back = log_uniform(rng, 2e-5, 2e-4), bool(rng.random() < 0.6)
    top_hz = log_uniform(rng, 1.0, min(5.0, 0.2 * rate_hz))

    def path() -> Array:
        if form == "chirp":
            return chirped(rng, t, 0.1, top_hz, rng.uniform(0.7, 1.5))
        if form == "ramps":
            return strokes(rng, t, (1.5 * leg_s, 1.5 * spread * leg_s), 0.9, False, back)
        return strokes(rng, t, (leg_s, spread * leg_s), rests, form == "operator", back)

    def motion() -> Motion:
        shakes = tremor(rng, t, shakes_m) if form == "operator" and rate_hz > _SEEN_HZ else 0.0
        m = moved(t, 0.5 * travel_m * path() + shakes, 0.03 if form == "operator" else settles_s)
        wide = travel_m / float(np.ptp(m.x))  # a drive follows a quick chirp by a part only
        return Motion(t, home_m + wide * (m.x - np.min(m.x)), wide * m.v, wide * m.a)

    settles_s = log_uniform(rng, 0.05, 0.2)
    m, second = motion(), motion()
    stiffness = log_uniform(rng, 20.0, 500.0)
    while stiffness * std(m.x) > 0.8:
        stiffness *= 0.7
    spring_n = stiffness * std(m.x)
    bare = Wire(
        min(log_uniform(rng, 5e-3, 0.2), spring_n / std(m.a)),
        spring_n / std(m.v) * log_uniform(rng, 0.03, 0.5), stiffness, entry_m=home_m,
        rest_m=home_m + travel_m * (rng.uniform(-0.3, 0.6) if rng.random() < 0.5 else 0.0),
    )  # fmt: skip
    words = f"{form}, {travel_m * 1e3:.3g} mm, {rate_hz:.3g} Hz, {lasts_s:.3g} s"
    return rate_hz, over, words, (Scene(m, home_m, travel_m, std(force(bare, Run(m)))), second), bare


def _sizes(rng: Rng, bare: Wire, hidden: list[Effect], run: Run, least: float) -> list[float] | None:
    """Sizes at which each effect, beside those before it, has a share of the force that is drawn.

    `least`: share that noise allows; None where it is too large.
    """
    sizes: list[float] = []
    least = 1.15 * max(_LEAST, least) * (1.0 + 0.3 * (len(hidden) - 1))
    if least > 0.9 * _LARGEST:
        return None
    for i, effect in enumerate(hidden):
        wanted = log_uniform(rng, least, 0.9 * _LARGEST)
        without, (low, high) = force(_wire(bare, hidden[:i], sizes), run), effect.span
        for _ in range(6):
            size = (low * high) ** 0.5
            whole = force(_wire(bare, hidden[: i + 1], [*sizes, size]), run)
            more = missed(run.m, whole - without) > wanted * std(whole)
            low, high = (low, size) if more else (size, high)
        sizes.append((low * high) ** 0.5)
    return sizes
