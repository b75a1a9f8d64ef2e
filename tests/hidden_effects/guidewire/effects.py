"""What is hidden in a guidewire's recording: each effect as a change of the wire, of a size to be chosen."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from tests.hidden_effects.guidewire import patient
from tests.hidden_effects.guidewire.wire import Rub, Run, Wire, swinging
from tests.hidden_effects.laboratory.forces import bristle, wandering
from tests.hidden_effects.laboratory.motion import Motion, Rng, log_uniform
from tests.hidden_effects.laboratory.truth import Array
from tests.hidden_effects.laboratory.world import std

RUBS = ("coulomb_friction", "stribeck_friction", "presliding_hysteresis")


@dataclass(frozen=True, eq=False)
class Scene:
    """What an effect is drawn for: first motion, travel in m from `home_m` on, typical force in N."""

    m: Motion
    home_m: float
    travel_m: float
    force_n: float

    @property
    def lasts_s(self) -> float:
        return float(self.m.t[-1])


@dataclass(frozen=True, eq=False)
class Effect:
    """An effect of a size within `span`: the wire with it, and its parameters as the vocabulary has them.

    `unit`: its force of unit size along a run, or with `key` `wave` the patient's wave; `further`: columns of
    the recording that it follows, drawn first.
    """

    name: str
    span: tuple[float, float]
    wire: Callable[[Wire, float], Wire] = lambda wire, _: wire
    unit: Callable[[Rng, Motion, dict[str, Array]], Array] | None = None
    key: str = ""
    further: Callable[[Rng, Array], dict[str, Array]] | None = None
    parameters: Callable[[float], dict[str, float]] = lambda _: {}
    allowed: tuple[str, ...] = ()

    def with_it(self, wire: Wire, size: float) -> Wire:
        if self.unit is None or self.key:
            return self.wire(wire, size)
        return replace(wire, beside={**wire.beside, self.name: size})


def happening(effects: list[Effect], rng: Rng, m: Motion) -> Run:
    """A run of the stage, with all that goes on beside."""
    units: dict[str, Array] = {}
    further: dict[str, Array] = {}
    for effect in effects:
        if effect.further:
            further |= effect.further(rng, m.t)
        if effect.unit:
            units[effect.key or effect.name] = effect.unit(rng, m, further)
    return Run(m, units, further)


def rubbing(rng: Rng, scene: Scene) -> Effect:
    """Dry friction of the seal: at once, larger at rest, or building up over a way."""
    name = str(rng.choice(RUBS))
    return {RUBS[0]: coulomb, RUBS[1]: stribeck, RUBS[2]: presliding}[name](rng, scene)


def coulomb(rng: Rng, scene: Scene) -> Effect:
    length_m = log_uniform(rng, 2e-6, 6e-5)
    return Effect(
        RUBS[0], (0.03, 3.0), lambda w, s: replace(w, rubs=(*w.rubs, Rub(s * scene.force_n, 0.0, length_m))),
        parameters=lambda s: {"forward_n": s * scene.force_n, "backward_n": s * scene.force_n},
    )  # fmt: skip


def stribeck(rng: Rng, scene: Scene) -> Effect:
    ratio, share = rng.uniform(1.3, 2.2), log_uniform(rng, 0.03, 0.3)
    length_m, speed = log_uniform(rng, 2e-6, 6e-5), share * float(np.quantile(np.abs(scene.m.v), 0.9))

    def wire(w: Wire, s: float) -> Wire:
        return replace(w, rubs=(*w.rubs, Rub(s * scene.force_n, 0.0, length_m)), static=(ratio, speed))

    sizes = {"coulomb_n": scene.force_n, "static_n": ratio * scene.force_n}

    def parameters(s: float) -> dict[str, float]:
        return {**{key: s * value for key, value in sizes.items()}, "stribeck_velocity_m_s": speed}

    return Effect(RUBS[1], (0.03, 3.0), wire, parameters=parameters)


def presliding(rng: Rng, scene: Scene) -> Effect:
    lengths = scene.travel_m * log_uniform(rng, 0.01, 0.06) * np.geomspace(0.2, 2.0, 4)
    shares = rng.dirichlet([3.0] * 4)

    def wire(w: Wire, s: float) -> Wire:
        rubs = [
            Rub(s * scene.force_n * share, 0.0, length) for share, length in zip(shares, lengths, strict=True)
        ]
        return replace(w, rubs=(*w.rubs, *rubs))

    return Effect(RUBS[2], (0.03, 3.0), wire)


def path(rng: Rng, scene: Scene) -> Effect:
    """Rod in a path, mu N' per inserted length: all along a lumen, or in the bends as the tip comes to them.

    Its elements let go one after the other, the farther the later.
    """
    bends, count = bool(rng.random() < 0.6), int(rng.integers(2, 9))
    lengths = scene.travel_m * log_uniform(rng, 0.002, 0.08) * np.geomspace(0.15, 3.0, count)
    shares, before_m = rng.dirichlet([2.0] * count), scene.travel_m * log_uniform(rng, 0.02, 2.0)
    begins = np.sort(rng.uniform(0.0, 0.8, count)) * scene.travel_m * bends
    arcs = scene.travel_m * rng.uniform(0.05, 0.3, count) if bends else np.full(count, np.inf)
    wrap = rng.uniform(0.1, 0.3) * rng.uniform(0.3, 2.0) / scene.travel_m * bends  # mu theta, over the travel

    def wire(w: Wire, s: float) -> Wire:
        per_m = s * scene.force_n / scene.travel_m * (4.0 if bends else 1.0)
        each = zip(shares, lengths, begins, arcs, strict=True)
        rubs = [Rub(share * per_m * before_m, share * per_m, *at) for share, *at in each]
        return replace(w, rubs=(*w.rubs, *rubs), wrap=(0.0, wrap))

    return Effect(
        "position_dependent_friction", (0.02, 5.0), wire,
        allowed=("capstan", *(RUBS if before_m > 0.5 * scene.travel_m else ())),
    )  # fmt: skip


def capstan(rng: Rng, scene: Scene) -> Effect:
    """mu of .1 to .3 times the angle of the bends, which may come with the depth."""
    deep = rng.random() < 0.5
    key, per = ("wrap_rad_m", 1.0 / scene.travel_m) if deep else ("wrap_rad", 1.0)
    return Effect(
        "capstan", (0.05, 1.8), lambda w, s: replace(w, wrap=(0.0, s * per) if deep else (s, 0.0)),
        parameters=lambda s: {key: s * per}, allowed=("position_dependent_friction",),
    )  # fmt: skip


def stiffening(rng: Rng, scene: Scene) -> Effect:
    return Effect(
        "stiffening", (0.2, 30.0),
        lambda w, s: replace(w, quadratic_n_m2=s * w.stiffness_n_m / scene.travel_m, rest_m=scene.home_m),
    )  # fmt: skip


def wall(rng: Rng, scene: Scene) -> Effect:
    """A vessel's wall that begins at a place, its stiffness over a toe."""
    toe_m = scene.travel_m * log_uniform(rng, 0.005, 0.15)

    def place_m(s: float) -> float:
        return scene.home_m + s * scene.travel_m

    def parameters(s: float) -> dict[str, float]:
        return {"contact_position_m": place_m(s)} if toe_m < 0.02 * scene.travel_m else {}

    return Effect(
        "contact_loss", (0.03, 0.75), parameters=parameters,
        wire=lambda w, s: replace(w, rest_m=place_m(s), one_sided=True, toe_m=toe_m),
    )  # fmt: skip


def relaxing(rng: Rng, scene: Scene) -> Effect:
    """Tissue has a spectrum of times; a single one where it is a plain branch."""
    tau_s, count, unit = log_uniform(rng, 0.2, 8.0), int(rng.integers(1, 5)), scene.force_n / std(scene.m.x)
    taus = tau_s * np.geomspace(0.3, 3.0, count) if count > 1 else [tau_s]

    def parameters(s: float) -> dict[str, float]:
        return {"stiffness_n_m": s * unit, "time_constant_s": tau_s} if count == 1 else {}

    return Effect(
        "stress_relaxation", (0.05, 10.0), parameters=parameters,
        wire=lambda w, s: replace(w, branches=tuple((s * unit / count, each) for each in taus)),
    )  # fmt: skip


def hunt(rng: Rng, scene: Scene) -> Effect:
    """Damping of a wall or tissue per depth beyond its rest."""
    unit = scene.force_n / std(scene.m.v * np.maximum(scene.m.x - scene.home_m, 0.0))
    return Effect(
        "hunt_crossley_damping", (0.05, 5.0),
        lambda w, s: replace(w, more_n_s_m2=s * unit, rest_m=scene.home_m),
        parameters=lambda s: {"damping_n_s_m2": s * unit} if scene.home_m == 0.0 else {},
    )  # fmt: skip


def asymmetric(rng: Rng, scene: Scene) -> Effect:
    side = float(rng.choice([-1.0, 1.0], p=[0.3, 0.7]))
    return Effect("asymmetric_damping", (0.02, 3.0),
                  unit=lambda _, m, __: side * scene.force_n / std(scene.m.v) * np.abs(m.v))  # fmt: skip


def play(rng: Rng, scene: Scene) -> Effect:
    return Effect("play", (0.005, 0.4), lambda w, s: replace(w, gap_m=s * scene.travel_m),
                  parameters=lambda s: {"width_m": s * scene.travel_m}, allowed=("backlash",))  # fmt: skip


def cogging(rng: Rng, scene: Scene) -> Effect:
    """Of a screw or motor, on the stage."""
    period_m, ratios = scene.travel_m / log_uniform(rng, 3.5, 18.0), rng.uniform(0.0, 0.5, 3)
    phases = rng.uniform(0.0, 2.0 * pi, 4)

    def unit(_: Rng, m: Motion, __: dict[str, Array]) -> Array:
        p, sizes = 2.0 * pi * m.x / period_m, (1.0, *ratios)
        waves = [size * np.sin((n + 1) * p + phases[n]) for n, size in enumerate(sizes)]
        return scene.force_n * np.asarray(np.sum(waves, axis=0))

    return Effect("position_map", (0.03, 3.0), unit=unit, parameters=lambda _: {"period_m": period_m})


def _patient(rng: Rng, scene: Scene, name: str, rhythm: patient.Rhythm, how: str) -> Effect:
    shares = {"": (1.0, 0.0, 0.0), "depth": (0.0, 1.0 / scene.travel_m, 0.0), "friction": (0.0, 0.0, 1.0)}[
        how
    ]

    def wire(w: Wire, s: float) -> Wire:
        return replace(w, heart=(s * scene.force_n * shares[0], s * scene.force_n * shares[1], s * shares[2]))

    exact = {"frequency_hz": rhythm.hz} if not rhythm.varies else {}
    return Effect(
        name, (0.03, 0.45 if how == "friction" else 3.0), wire, key="wave",
        unit=lambda rng, m, _: rhythm.along(rng, m.t), parameters=lambda _: exact,
        allowed=("pulsation", "varying_pulsation"),
    )  # fmt: skip


def steady_heart(rng: Rng, scene: Scene) -> Effect:
    hz = rng.uniform(0.8, 2.2) if rng.random() < 0.7 else rng.uniform(0.2, 0.45)
    return _patient(rng, scene, "pulsation", patient.Rhythm(rng, hz, 0.0), "")


def _rhythm(rng: Rng) -> patient.Rhythm:
    if rng.random() < 0.5:
        return patient.Rhythm(rng, rng.uniform(0.8, 1.8), rng.uniform(0.03, 0.08))
    return patient.Rhythm(rng, rng.uniform(0.15, 0.4), rng.uniform(0.1, 0.2))


def living(rng: Rng, scene: Scene) -> Effect:
    """Heart or breath whose rate varies, a force of its own or one that grows with the depth."""
    how = str(rng.choice(["", "depth"], p=[0.7, 0.3]))
    return _patient(rng, scene, "varying_pulsation", _rhythm(rng), how)


def living_on_friction(rng: Rng, scene: Scene) -> Effect:
    """The same on the vessel's grip: it needs a friction beside it."""
    return _patient(rng, scene, "varying_pulsation", _rhythm(rng), "friction")


def drift(rng: Rng, scene: Scene) -> Effect:
    side = float(rng.choice([-1.0, 1.0]))
    unit = side * scene.force_n / scene.lasts_s
    return Effect("sensor_drift", (0.1, 10.0), unit=lambda _, m, __: unit * m.t,
                  parameters=lambda s: {"rate_n_s": s * unit})  # fmt: skip


def settling(rng: Rng, scene: Scene) -> Effect:
    course = patient.Settling(rng, scene.lasts_s)
    return Effect(
        "settling_drift", (0.1, 10.0), unit=lambda rng, m, _: scene.force_n * course.along(rng, m.t),
        parameters=lambda _: {"settling_s": course.settles_s}, allowed=("sensor_drift",),
    )  # fmt: skip


def lag(rng: Rng, scene: Scene) -> Effect:
    return Effect("sensor_lag", (0.005, 2.0), lambda w, s: replace(w, lag_s=s),
                  parameters=lambda s: {"time_constant_s": s}, allowed=("time_delay",))  # fmt: skip


def hum(rng: Rng, scene: Scene) -> Effect:
    hz = float(rng.choice([50.0, 60.0])) + rng.uniform(-0.03, 0.03)

    def unit(rng: Rng, m: Motion, _: dict[str, Array]) -> Array:
        return scene.force_n * np.asarray(np.sin(2.0 * pi * hz * m.t + rng.uniform(0.0, 6.3)))

    return Effect("mains_hum", (0.05, 1.5), unit=unit, parameters=lambda _: {"frequency_hz": hz})


def mode(rng: Rng, scene: Scene) -> Effect:
    """A mass that hangs on the stage: a holder's lever, a coiled end of the wire."""
    hz, ratio = log_uniform(rng, 2.0, 9.0), log_uniform(rng, 0.02, 0.15)
    unit = scene.force_n / std(swinging(scene.m, hz, ratio))
    return Effect("unmodelled_resonance", (0.05, 3.0),
                  unit=lambda _, m, __: unit * swinging(m, hz, ratio),
                  parameters=lambda _: {"frequency_hz": hz, "damping_ratio": ratio})  # fmt: skip


def puncture(rng: Rng, scene: Scene) -> Effect:
    at_s, softer = scene.lasts_s * rng.uniform(0.2, 0.8), bool(rng.random() < 0.7)

    def ratio(s: float) -> float:
        return 1.0 / (1.0 + s) if softer else 1.0 + s

    return Effect("stiffness_change", (0.1, 10.0), lambda w, s: replace(w, ratio=ratio(s), change_s=at_s),
                  parameters=lambda s: {"time_s": at_s, "ratio": ratio(s)})  # fmt: skip


def roll(rng: Rng, scene: Scene) -> Effect:
    """Weight of an eccentric holder, which acts on the cell by the sine of the roll angle."""
    most_rad, phase = log_uniform(rng, 1.0, 8.0), rng.uniform(0.0, 2.0 * pi)
    return Effect(
        "with_column", (0.05, 4.0), further=lambda rng, t: {"roll_rad": patient.rolled(rng, t, most_rad)},
        unit=lambda _, __, further: scene.force_n * np.sin(further["roll_rad"] + phase),
        parameters=lambda s: {"sine_n": s * scene.force_n * float(np.cos(phase)),
                              "cosine_n": s * scene.force_n * float(np.sin(phase))},
    )  # fmt: skip


def cross_talk(rng: Rng, scene: Scene) -> Effect:
    """Of a second axis: its spring, its dry friction, or a share of the force on it."""
    how = str(rng.choice(["spring", "friction", "force"]))
    header = "force_y_N" if how == "force" else str(rng.choice(["roll_rad", "y_mm"]))
    most = log_uniform(rng, 1.0, 4.0) if header == "roll_rad" else log_uniform(rng, 5.0, 30.0)

    def columns(rng: Rng, t: Array) -> dict[str, Array]:
        if how == "force":
            return {header: 0.5 * wandering(rng, t, 0.5) + 0.4 * wandering(rng, t, 3.0)}
        return {header: patient.rolled(rng, t, most)}

    def unit(_: Rng, __: Motion, further: dict[str, Array]) -> Array:
        along = further[header]
        shape = (
            bristle(along, 2e-3 * most) if how == "friction" else along / (0.5 if how == "force" else most)
        )
        return np.asarray(scene.force_n * shape)

    return Effect("with_column", (0.05, 4.0), unit=unit, further=columns)


def slip(rng: Rng, scene: Scene) -> Effect:
    """A gripper that lets the wire jump or creep where the force passes what it holds."""
    way_m, creeps = log_uniform(rng, 0.3e-3, 4e-3), bool(rng.random() < 0.35)

    def holding_n(s: float) -> float:
        return 3.0 * scene.force_n / s

    def wire(w: Wire, s: float) -> Wire:
        if creeps:
            return replace(w, holding_n=holding_n(s), creep_n_s_m=0.5 * w.stiffness_n_m)
        return replace(w, holding_n=holding_n(s), slip_m=way_m, slip_m_s=0.15)

    def parameters(s: float) -> dict[str, float]:
        return {"holding_n": holding_n(s), **({} if creeps else {"slipped_m": way_m})}

    return Effect("gripper_slip", (0.7, 12.0), wire, parameters=parameters)


def buckling(rng: Rng, scene: Scene) -> Effect:
    """The wire bows between gripper and sheath: pi^2 EI / (K L)^2, where L falls as it is pushed in."""
    free_m = scene.travel_m + log_uniform(rng, 8e-3, 60e-3)
    middle_n_m2 = scene.force_n * (free_m - 0.5 * scene.travel_m) ** 2
    return Effect(
        "buckling", (0.4, 8.0),
        lambda w, s: replace(w, euler_n_m2=3.0 * middle_n_m2 / s, free_m=free_m, rest_m=scene.home_m),
        parameters=lambda s: {"euler_n_m2": 3.0 * middle_n_m2 / s, "free_length_m": free_m + scene.home_m},
    )  # fmt: skip


def yielding(rng: Rng, scene: Scene) -> Effect:
    """A wall that yields where it is pushed, or tissue that yields both ways, as an elastic friction does."""
    both = bool(rng.random() < 0.3)

    def wire(w: Wire, s: float) -> Wire:
        rest_m = scene.home_m + (0.3 if both else 0.0) * scene.travel_m
        return replace(
            w, yield_n=3.0 * scene.force_n / s, yields_back=both, rest_m=rest_m, one_sided=not both
        )

    return Effect("yielding_wall", (0.8, 12.0), wire, allowed=RUBS if both else (),
                  parameters=lambda s: {"yield_n": 3.0 * scene.force_n / s})  # fmt: skip


def prolapse(rng: Rng, scene: Scene) -> Effect:
    kept = rng.uniform(0.1, 0.5)
    return Effect(
        "prolapse", (0.8, 12.0),
        lambda w, s: replace(w, prolapse_n=3.0 * scene.force_n / s, kept=kept, rest_m=scene.home_m),
        parameters=lambda s: {"limit_n": 3.0 * scene.force_n / s},
    )  # fmt: skip


def outside(rng: Rng, scene: Scene) -> Effect:
    """Something without a name."""
    what = str(rng.choice(["whirl", "friction that wanders", "bump in and out"]))
    hz, length_m = rng.uniform(4.0, 8.0), scene.travel_m * log_uniform(rng, 1e-3, 1e-2)
    low, high = scene.home_m + 0.15 * scene.travel_m, scene.home_m + 0.85 * scene.travel_m
    ways = [(rng.uniform(low, high), float(rng.normal())) for _ in range(2)]
    width_m, slow_hz = scene.travel_m * log_uniform(rng, 0.03, 0.12), log_uniform(rng, 0.05, 0.3)

    def unit(rng: Rng, m: Motion, _: dict[str, Array]) -> Array:
        if what == "whirl":
            return patient.whirl(rng, m, hz)
        if what == "bump in and out":
            return patient.bumps(m, ways[0], ways[1], width_m)
        return patient.restless(rng, m, length_m, slow_hz)

    return Effect("outside", (0.02 * scene.force_n, 8.0 * scene.force_n), unit=unit,
                  allowed=RUBS if what == "friction that wanders" else ())  # fmt: skip


Make = Callable[[Rng, Scene], Effect]
# of each group at most one is in a mixture, as often as its weight says
GROUPS: tuple[tuple[float, tuple[Make, ...]], ...] = (
    (2.0, (rubbing, path, path, capstan)),
    (1.3, (stiffening, wall, relaxing, hunt, puncture, yielding, prolapse)),
    (1.0, (steady_heart, living, living)),
    (1.0, (play, cogging, asymmetric, slip, buckling)),
    (0.6, (roll, cross_talk)),
    (0.7, (drift, settling, lag, mode)),
)
KNOWN: tuple[Make, ...] = (
    path, coulomb, wall, path, stribeck, capstan, presliding, stiffening, path, relaxing, play, hunt, path,
    steady_heart, asymmetric, cogging, path, puncture, mode, drift, capstan, lag, hum, path,
)  # fmt: skip
NEW: tuple[Make, ...] = (
    roll, living, slip, buckling, yielding, cross_talk, living, prolapse, buckling, slip, settling, living,
)  # fmt: skip
