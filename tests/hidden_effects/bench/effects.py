"""What a bench can hide: each maker draws an effect's size from the bench's own scale.

The truth is what is physically there. Families say which names mean the same place in the machine; they were
fixed before any diagnosis was run. A bias belongs to every recording and to no truth.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import exp, pi, sqrt

import numpy as np

from tests.hidden_effects.bench.measure import Bench, walking, wandering
from tests.hidden_effects.bench.rig import Body, Link, contact
from tests.hidden_effects.bench.stage import Rng, log_uniform

FAMILIES: dict[str, tuple[str, ...]] = {
    "dry": ("coulomb_friction", "stribeck_friction", "presliding_hysteresis", "capstan",
            "position_dependent_friction"),
    "play": ("play", "backlash"),
    "contact": ("contact_loss", "stiffening"),
    "damping": ("hunt_crossley_damping", "quadratic_drag", "asymmetric_damping"),
    "relaxation": ("stress_relaxation",),
    "sensor": ("bias", "time_delay", "sensor_lag", "sensor_drift", "sensor_saturation",
               "sensor_quantisation", "sensor_spikes"),
    "periodic": ("pulsation", "mains_hum", "unmodelled_resonance"),
    "position": ("position_map", "gravity_load"),
    "change": ("stiffness_change",),
}  # fmt: skip
_FAMILY = {name: family for family, names in FAMILIES.items() for name in names}


_MEANING = {
    "gap_m": "width_m", "capstan": "wrap_rad", "capstan_per_m": "wrap_rad_m", "lag_s": "time_constant_s",
    "hunt_n_s_m2": "damping_n_s_m2", "growth_n_m": "force_per_length_n_m",
    **{name: name for name in ("drag_n_s2_m2", "delay_s", "rate_n_s", "limit_n", "step_n")},
}  # fmt: skip


def family_of(name: str) -> str:
    """A name that nobody knows is a family of its own."""
    return _FAMILY.get(name, name)


def canonical(name: str) -> str:
    """One name for the two of the play."""
    return "play" if name == "backlash" else name


@dataclass(frozen=True)
class Effect:
    """`name` is empty where no name of the vocabulary stands for it; `also`: families that come with it;
    `parameters`: by the vocabulary's names, those of which it has the meaning.
    """

    name: str
    words: str
    change: Callable[[Bench], Bench]
    also: frozenset[str] = frozenset()
    parameters: Mapping[str, float] = field(default_factory=dict)

    @property
    def families(self) -> frozenset[str]:
        """Those that are really there."""
        return self.also | ({family_of(self.name)} if self.name else set())


Maker = Callable[[Rng, Bench], list[Effect]]
"""Effects that come together; most makers make one."""


def _made(name: str, place: Callable[..., Bench], /, *also: str, **fields: object) -> list[Effect]:
    """One effect: `place(bench, **fields)`; its words are its name."""
    return _told(name, name, place, *also, **fields)


def _told(
    words: str, name: str, place: Callable[..., Bench], /, *also: str, **fields: object
) -> list[Effect]:
    """The same with words of its own; either way its numbers stand behind them."""
    numbers = ", ".join(f"{key}={value:.3g}" for key, value in fields.items() if isinstance(value, float))
    said = f"{words}({numbers})" if numbers else words
    meant = ((_MEANING[key], value) for key, value in fields.items() if key in _MEANING)
    values = {key: value for key, value in meant if isinstance(value, float)}
    return [Effect(name, said, lambda bench: place(bench, **fields), frozenset(also), values)]


def _share(rng: Rng, bench: Bench, low: float, high: float) -> float:
    """That share of the force of mass, damper and spring, in N."""
    return bench.force_n * log_uniform(rng, low, high)


# Dry friction


def coulomb(rng: Rng, bench: Bench) -> list[Effect]:
    """The same at rest and in motion."""
    force_n = _share(rng, bench, 0.1, 1.0)
    return _made("coulomb_friction", Bench.with_tip, coulomb_n=force_n, static_n=force_n)


def wearing(rng: Rng, bench: Bench) -> list[Effect]:
    """Coulomb friction that wears along its way."""
    force_n, way_m = _share(rng, bench, 0.3, 1.0), float(np.sum(np.abs(np.diff(bench.stage.x))))
    fields = {"coulomb_n": force_n, "static_n": force_n, "wear_m": way_m * rng.uniform(0.1, 0.4)}
    return _made("coulomb_friction", Bench.with_tip, **fields)


def stribeck(rng: Rng, bench: Bench) -> list[Effect]:
    """A seal that has dried: stick-slip where the instrument is soft enough."""
    force_n, speed = _share(rng, bench, 0.1, 0.8), log_uniform(rng, 0.5e-3, 10e-3)
    fields = {"coulomb_n": force_n, "static_n": force_n * rng.uniform(1.3, 2.5), "stribeck_m_s": speed}
    return _made("stribeck_friction", Bench.with_tip, **fields)


def presliding(rng: Rng, bench: Bench) -> list[Effect]:
    """Six asperities that break away one after the other (Iwan, J. Appl. Mech. 33, 1966)."""
    force_n, last_m = _share(rng, bench, 0.15, 1.0), bench.reach_m * log_uniform(rng, 0.02, 0.3)
    asperities = tuple((force_n / 6.0 / slip, slip) for slip in (last_m * np.arange(1, 7) / 6.0).tolist())
    said = f"presliding({force_n:.3g} N, {last_m:.3g} m)"
    return _told(said, "presliding_hysteresis", Bench.with_rig, asperities=asperities)


def lengthening(rng: Rng, bench: Bench) -> list[Effect]:
    """The longer inside, the more friction."""
    growth_n_m = _share(rng, bench, 0.2, 1.5) / float(np.max(bench.stage.x))
    return _made("position_dependent_friction", Bench.with_tip, growth_n_m=growth_n_m)


def capstan(rng: Rng, bench: Bench) -> list[Effect]:
    """Bends: friction is a factor on the tip's force; their angle is fixed or grows with the depth."""
    if rng.random() < 0.5:
        return _made("capstan", Bench.with_wall, capstan=rng.uniform(0.15, 0.9))
    per_m = rng.uniform(0.3, 1.2) / float(np.max(bench.stage.x))
    return _made("capstan", Bench.with_wall, capstan_per_m=per_m)


# Transmission: play, shafts


def _gap_m(rng: Rng, bench: Bench) -> float:
    return bench.reach_m * log_uniform(rng, 0.01, 0.25)


def _middle_m(rng: Rng, bench: Bench) -> float:
    """Where tissue that is clamped on both sides leaves the tip."""
    return float(np.quantile(bench.stage.x, rng.uniform(0.3, 0.7)))


def drive_play(rng: Rng, bench: Bench) -> list[Effect]:
    """In the drive: behind it the carriage, held by its guide, and on it load cell and instrument."""
    return _made(
        "play", _with_carriage, gap_m=_gap_m(rng, bench), mass_kg=rng.uniform(0.2, 0.8),
        nut_hz=rng.uniform(150.0, 300.0), guide_n=bench.peak_n * rng.uniform(1.5, 3.0),
        restitution=rng.uniform(0.2, 0.7),
    )  # fmt: skip


def _with_carriage(
    bench: Bench, gap_m: float, mass_kg: float, nut_hz: float, guide_n: float, restitution: float
) -> Bench:
    rig, nut = bench.rig, Link(*contact(mass_kg, nut_hz, restitution), gap_m)
    carriage = Body(mass_kg, coulomb_n=guide_n, static_n=guide_n)
    return bench.with_rig(bodies=(carriage, *rig.bodies), links=(nut, *rig.links), cell=rig.cell + 1)


def hub_play(rng: Rng, bench: Bench) -> list[Effect]:
    """Between a hub on the load cell and the shaft; hub and shaft share the mass in any way."""
    return _made(
        "play", _with_loose_shaft, gap_m=_gap_m(rng, bench), hub_share=rng.uniform(0.1, 0.9),
        stop_hz=rng.uniform(100.0, 300.0), restitution=rng.uniform(0.2, 0.7), rest_m=_middle_m(rng, bench),
    )  # fmt: skip


def _with_loose_shaft(
    bench: Bench, gap_m: float, hub_share: float, stop_hz: float, restitution: float, rest_m: float
) -> Bench:
    shaft_kg = (1.0 - hub_share) * bench.rig.bodies[-1].mass_kg
    contact_hz = max(stop_hz, sqrt(30.0 * bench.rig.wall.stiffness_n_m / shaft_kg) / (2.0 * pi))
    loose = Link(*contact(shaft_kg, contact_hz, restitution), gap_m)
    return _split(bench.with_wall(rest_m=rest_m), loose, hub_share, shaft_kg)


def _split(bench: Bench, link: Link, hub_share: float, behind_kg: float) -> Bench:
    """The last body becomes two with that link between them; what rubs stays on the one behind."""
    rig, tip = bench.rig, bench.rig.bodies[-1]
    hub, behind = Body(hub_share * tip.mass_kg), tip._replace(mass_kg=behind_kg)
    return bench.with_rig(bodies=(*rig.bodies[:-1], hub, behind), links=(*rig.links, link))


def _guided(bench: Bench, damping_n_s_m: float) -> Bench:
    """The base's damper at the first body and this one at the wall.

    A compliance before a viscous wall would relax, and that is an effect of its own.
    """
    rig = bench.rig
    hub = rig.bodies[0]._replace(viscous_n_s_m=rig.wall.forward_n_s_m)
    slight = bench.with_wall(forward_n_s_m=damping_n_s_m, backward_n_s_m=damping_n_s_m)
    return slight.with_rig(bodies=(hub, *rig.bodies[1:]))


def compliant_play(rng: Rng, bench: Bench) -> list[Effect]:
    """Compliance before and behind the play."""
    return _told("compliant play",
        "play", _with_compliant_play, "periodic", gap_m=_gap_m(rng, bench),
        front=rng.uniform(1.0, 6.0), behind=rng.uniform(1.0, 6.0), rest_m=_middle_m(rng, bench),
    )  # fmt: skip


def _with_compliant_play(bench: Bench, gap_m: float, front: float, behind: float, rest_m: float) -> Bench:
    """`front`, `behind`: stiffnesses by the wall's; three bodies of equal mass."""
    mass_kg, k = bench.rig.bodies[-1].mass_kg / 3.0, bench.rig.wall.stiffness_n_m
    before = Link(front * k, 0.3 * sqrt(front * k * mass_kg))
    after = Link(behind * k, 0.3 * sqrt(behind * k * mass_kg), gap_m)
    sprung = _split(bench.with_wall(rest_m=rest_m), before, 1.0 / 3.0, 2.0 * mass_kg)
    return _guided(_split(sprung, after, 0.5, mass_kg), 0.2 * sqrt(k * mass_kg))


def resonance(rng: Rng, bench: Bench) -> list[Effect]:
    """A flexible shaft with a tip that swings; the viscous guide is at its hub."""
    return _made(
        "unmodelled_resonance", _with_shaft, ratio=log_uniform(rng, 0.5, 8.0),
        mode_hz=log_uniform(rng, 3.0, 20.0), damping_ratio=rng.uniform(0.02, 0.15),
    )  # fmt: skip


def _with_shaft(bench: Bench, ratio: float, mode_hz: float, damping_ratio: float) -> Bench:
    """`ratio`: the shaft's stiffness by the wall's; no tip is heavier than 1 kg."""
    wall, shaft_n_m = bench.rig.wall, ratio * bench.rig.wall.stiffness_n_m
    tip_kg = min(1.0, (shaft_n_m + wall.stiffness_n_m) / (2.0 * pi * mode_hz) ** 2)
    damping = damping_ratio * sqrt((shaft_n_m + wall.stiffness_n_m) * tip_kg)  # half in shaft, half in wall
    return _guided(_split(bench, Link(shaft_n_m, damping), 1.0, tip_kg), damping)


def rubbing_shaft(rng: Rng, bench: Bench) -> list[Effect]:
    """A compliant shaft with friction all along it: it moves piece by piece."""
    fields = {
        "force_n": _share(rng, bench, 0.3, 1.0),
        "wound_m": bench.reach_m * log_uniform(rng, 0.02, 0.15),
    }
    return _told("rubbing shaft", "coulomb_friction", _with_rubbing_shaft, "periodic", **fields)


def _with_rubbing_shaft(bench: Bench, force_n: float, wound_m: float) -> Bench:
    """Four bodies with a quarter of mass and friction each."""
    quarter_kg = bench.rig.bodies[-1].mass_kg / 4.0
    stiffness_n_m = 3.0 * (force_n / wound_m + bench.rig.wall.stiffness_n_m)
    springs = 3 * (Link(stiffness_n_m, 0.3 * sqrt(stiffness_n_m * quarter_kg)),)
    bodies = 4 * (Body(quarter_kg, coulomb_n=force_n / 4.0, static_n=force_n / 4.0),)
    flexible = bench.with_rig(bodies=bodies, links=(*bench.rig.links, *springs))
    return _guided(flexible, 0.2 * sqrt(bench.rig.wall.stiffness_n_m * quarter_kg))


def buckling(rng: Rng, bench: Bench) -> list[Effect]:
    """A shaft that gives way above a force."""
    return _told("buckling", "", _with_buckling, limit_n=bench.peak_n * rng.uniform(0.3, 0.75))


def _with_buckling(bench: Bench, limit_n: float) -> Bench:
    half_kg, stiffness_n_m = 0.5 * bench.rig.bodies[-1].mass_kg, 100.0 * bench.rig.wall.stiffness_n_m
    shaft = Link(stiffness_n_m, damping := 0.4 * sqrt(stiffness_n_m * half_kg), 0.0, limit_n)
    return _guided(_split(bench, shaft, 0.5, half_kg), 0.1 * damping)


# Wall and tissue


def unilateral(rng: Rng, bench: Bench) -> list[Effect]:
    """A wall that begins somewhere on the way and can not pull."""
    begins_m = float(np.min(bench.stage.x)) + rng.uniform(0.1, 0.6) * bench.reach_m
    return _made("contact_loss", Bench.with_wall, rest_m=begins_m, unilateral=1.0)


def polynomial(rng: Rng, bench: Bench) -> list[Effect]:
    """Stiffer with depth, by a square or a cube."""
    field, power = (("quadratic_n_m2", 2), ("cubic_n_m3", 3))[int(rng.integers(2))]
    return _made(
        "stiffening", Bench.with_wall, **{field: _share(rng, bench, 0.3, 4.0) / bench.reach_m**power}
    )


def exponential(rng: Rng, bench: Bench) -> list[Effect]:
    """Soft tissue (Fung, Biomechanics, chapter 7)."""
    times = rng.uniform(1.5, 5.0)
    fields = {"level_n": _share(rng, bench, 0.5, 4.0) / exp(times), "length_m": bench.reach_m / times}
    return _made("stiffening", Bench.with_wall, **fields)


def hunt_crossley(rng: Rng, bench: Bench) -> list[Effect]:
    """Damping that grows with the depth below the wall's surface."""
    spread = float(np.std((bench.stage.x - np.min(bench.stage.x)) * bench.stage.v))
    damping = _share(rng, bench, 0.2, 1.0) / spread
    return _made("hunt_crossley_damping", Bench.with_wall, hunt_n_s_m2=damping)


def drag(rng: Rng, bench: Bench) -> list[Effect]:
    coefficient = _share(rng, bench, 0.2, 1.0) / float(np.std(bench.stage.v * np.abs(bench.stage.v)))
    return _made("quadratic_drag", Bench.with_wall, drag_n_s2_m2=coefficient)


def asymmetric(rng: Rng, bench: Bench) -> list[Effect]:
    """A valve's lip: another damping in than out."""
    more = _share(rng, bench, 0.2, 1.0) / float(np.std(bench.stage.v))
    field = ("forward_n_s_m", "backward_n_s_m")[int(rng.integers(2))]
    return _made("asymmetric_damping", Bench.with_wall, **{field: bench.rig.wall.forward_n_s_m + more})


def relaxation(rng: Rng, bench: Bench) -> list[Effect]:
    """One Maxwell branch, or two."""
    first_s = log_uniform(rng, 0.1, 4.0)
    times = [first_s] if rng.random() < 0.5 else [first_s, first_s * rng.uniform(4.0, 12.0)]
    shares = [rng.uniform(0.3, 2.0) for _ in times]
    said = "relaxation " + ", ".join(f"{s:.2f} k {t:.2g} s" for s, t in zip(shares, times, strict=True))
    return _viscoelastic(said, bench, times, shares)


def fractional(rng: Rng, bench: Bench) -> list[Effect]:
    """A springpot from 5 ms to 100 s by ten branches: stiffness falls as a power of their time."""
    order, times = rng.uniform(0.15, 0.5), np.geomspace(5e-3, 100.0, 10)
    shares = (rng.uniform(0.3, 1.0) * times**-order).tolist()
    return _viscoelastic(f"fractional of order {order:.2f}", bench, times.tolist(), shares)


def _viscoelastic(words: str, bench: Bench, times: list[float], shares: list[float]) -> list[Effect]:
    """Branches whose stiffness is that share of the wall's."""
    k = bench.rig.wall.stiffness_n_m
    branches = tuple((share * k, time_s) for share, time_s in zip(shares, times, strict=True))
    return _told(words, "stress_relaxation", Bench.with_rig, branches=branches)


def puncture(rng: Rng, bench: Bench) -> list[Effect]:
    """The wall gives way, or the tip enters something stiffer."""
    ratio = rng.uniform(0.2, 0.65) if rng.random() < 0.6 else rng.uniform(1.5, 3.0)
    at_s = bench.duration_s * rng.uniform(0.25, 0.75)
    return _made("stiffness_change", Bench.with_wall, ratio=ratio, change_s=at_s)


def position_map(rng: Rng, bench: Bench) -> list[Effect]:
    """Cogging with two harmonics, or a smooth map such as an arm's weight."""
    size_n, kind = _share(rng, bench, 0.15, 0.8), ("cogging", "map")[int(rng.integers(2))]
    pitch_m = min(log_uniform(rng, 1e-3, 6e-3), 0.4 * bench.reach_m)
    lengths = (
        [pitch_m, 0.5 * pitch_m] if kind == "cogging" else list(bench.reach_m * rng.uniform(0.4, 1.0, 3))
    )
    waves = tuple(
        (size_n / (1 + n), 2.0 * pi / length_m, rng.uniform(0.0, 2.0 * pi))
        for n, length_m in enumerate(lengths)
    )
    said = f"{kind}({size_n:.3g} N, {lengths[0]:.3g} m)"
    return _told(said, "position_map", Bench.with_rig, waves=waves)


def pulsation(rng: Rng, bench: Bench) -> list[Effect]:
    """The wall moves with the heart or the breath, by a wave with three harmonics."""
    low, high = (0.8, 2.2) if rng.random() < 0.6 else (6.0 / bench.duration_s, 0.5)
    frequency_hz = rng.uniform(min(low, high), high)
    size_m = _share(rng, bench, 0.1, 0.6) / bench.rig.wall.stiffness_n_m
    turns, phases = 2.0 * pi * frequency_hz * bench.stage.t, rng.uniform(0.0, 2.0 * pi, 3)
    waves = [share * np.sin((n + 1) * turns + phases[n]) for n, share in enumerate((1.0, 0.4, 0.15))]
    said = f"pulsation({frequency_hz:.3g} Hz, {size_m:.3g} m)"
    return _told(said, "pulsation", replace, heave_m=size_m * np.sum(waves, axis=0))


# The load cell's chain


def delay(rng: Rng, bench: Bench) -> list[Effect]:
    return _made("time_delay", Bench.with_sensor, delay_s=log_uniform(rng, 5e-3, 80e-3))


def lag(rng: Rng, bench: Bench) -> list[Effect]:
    """A slow amplifier."""
    return _made("sensor_lag", Bench.with_sensor, lag_s=log_uniform(rng, 5e-3, 100e-3))


def drift(rng: Rng, bench: Bench) -> list[Effect]:
    """A ramp of the zero."""
    rate_n_s = _share(rng, bench, 0.2, 2.0) / bench.duration_s * float(rng.choice((-1.0, 1.0)))
    return _made("sensor_drift", Bench.with_sensor, rate_n_s=rate_n_s)


def saturation(rng: Rng, bench: Bench) -> list[Effect]:
    return _made("sensor_saturation", Bench.with_sensor, limit_n=bench.peak_n * rng.uniform(0.3, 0.85))


def quantisation(rng: Rng, bench: Bench) -> list[Effect]:
    """Ten and more times the noise, or it would not show; at most the force's own std."""
    step_n = min(bench.noise_rms_n * rng.uniform(10.5, 30.0), bench.force_n)
    return _made("sensor_quantisation", Bench.with_sensor, step_n=step_n)


def spikes(rng: Rng, bench: Bench) -> list[Effect]:
    """A motor's switching."""
    fields = {"spike_hz": log_uniform(rng, 0.2, 3.0), "spike_n": bench.peak_n * log_uniform(rng, 0.5, 4.0)}
    return _made("sensor_spikes", Bench.with_sensor, **fields)


def hum(rng: Rng, bench: Bench) -> list[Effect]:
    """3.4 to 5.9 times the noise's rms: a sine's amplitude is 1.4 times its rms, the harmonics add 5 %."""
    mains_hz = float(rng.choice((50.0, 60.0))) + rng.normal(0.0, 0.02)
    size_n = bench.noise_rms_n * rng.uniform(3.2, 5.6) * sqrt(2.0)
    return _made("mains_hum", Bench.with_sensor, hum_hz=mains_hz, hum_n=size_n)


# Without a name


def operator(rng: Rng, bench: Bench) -> list[Effect]:
    """Somebody pushes: no axis causes it."""
    size_n, corner_hz = _share(rng, bench, 0.2, 0.8), log_uniform(rng, 0.1, 1.0)
    said = f"operator's push({size_n:.3g} N, {corner_hz:.3g} Hz)"
    return _told(said, "", replace, push_n=size_n * wandering(rng, bench.stage, corner_hz))


def walk(rng: Rng, bench: Bench) -> list[Effect]:
    size_n = _share(rng, bench, 0.2, 0.8)
    wander_n = size_n * walking(rng, bench.stage)
    return _told(f"random walk({size_n:.3g} N)", "", Bench.with_sensor, wander_n=wander_n)


def temperature(rng: Rng, bench: Bench) -> list[Effect]:
    """The cell's zero wanders up and down: it is the sensor, but no ramp."""
    size_n = _share(rng, bench, 0.2, 0.8)
    wander_n = size_n * wandering(rng, bench.stage, log_uniform(rng, 0.02, 0.1))
    return _told(f"temperature({size_n:.3g} N)", "", Bench.with_sensor, "sensor", wander_n=wander_n)


def gain_wander(rng: Rng, bench: Bench) -> list[Effect]:
    gain = 1.0 + rng.uniform(0.1, 0.3) * wandering(rng, bench.stage, log_uniform(rng, 0.05, 0.3))
    return _told("gain wanders", "", Bench.with_sensor, gain=gain)


# Several at once


def three(rng: Rng, bench: Bench) -> list[Effect]:
    """Three of different families that can be in one bench."""
    groups = ((coulomb, lengthening), (polynomial, exponential), (relaxation,), (drift,), (pulsation,),
              (position_map,), (drive_play,), (puncture,), (hunt_crossley, drag))  # fmt: skip
    selected = rng.choice(len(groups), 3, replace=False).tolist()
    return [effect for n in selected for effect in groups[n][int(rng.integers(len(groups[n])))](rng, bench)]


def together(*makers: Maker) -> Maker:
    return lambda rng, bench: [effect for maker in makers for effect in maker(rng, bench)]


KNOWN: tuple[Maker, ...] = (
    coulomb, drift, unilateral, relaxation, drive_play, hunt_crossley, capstan, pulsation, puncture,
    position_map, delay, polynomial, stribeck, asymmetric, saturation, resonance, exponential, presliding,
    spikes, drag, lag, lengthening, quantisation, hum,
)  # fmt: skip
"""One name each, in an order that mixes the families."""
FAST: frozenset[Maker] = frozenset((hum, resonance))
"""Not to be seen below 200 Hz."""
WITHOUT_WALL: frozenset[Maker] = frozenset(
    (coulomb, stribeck, presliding, lengthening, drag, drift, position_map)
)
"""What shows in free space, too."""
COMPOSITIONS: tuple[Maker, ...] = (
    fractional, operator, compliant_play, three, walk, wearing, buckling, together(hub_play, coulomb),
    temperature, together(puncture, relaxation), rubbing_shaft, together(unilateral, pulsation), gain_wander,
    together(capstan, unilateral), together(coulomb, operator), three,
)  # fmt: skip
