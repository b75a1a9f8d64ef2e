"""Worlds of machines: a joint, a chirped stage, strokes through a seal, nothing hidden, something strange."""

from collections.abc import Callable
from math import pi

import numpy as np

from tests.hidden_effects.laboratory import forces
from tests.hidden_effects.laboratory.motion import (
    Motion,
    Rng,
    chirped,
    grid,
    log_uniform,
    moved,
    multisine,
    strokes,
    tremor,
)
from tests.hidden_effects.laboratory.truth import Array
from tests.hidden_effects.laboratory.world import Parts, World, sense_of, std, two_motions

RUBS = ("coulomb_friction", "stribeck_friction", "presliding_hysteresis")


def _friction(rng: Rng, m: Motion, force: float, travel: float) -> tuple[str, Callable[[Motion], Array]]:
    """One of the family of that size: its name, and its force along a motion."""
    name = str(rng.choice(RUBS, p=[0.5, 0.25, 0.25]))
    if name == "stribeck_friction":
        ratio, speed = (
            rng.uniform(1.2, 2.0),
            float(np.quantile(np.abs(m.v), 0.9)) * log_uniform(rng, 0.03, 0.3),
        )
        return name, lambda m: force * forces.stribeck(m, 1e-3 * travel, ratio, speed)
    length = travel * (log_uniform(rng, 1e-4, 2e-3) if name == RUBS[0] else log_uniform(rng, 0.01, 0.08))
    return name, lambda m: force * forces.bristle(m.x, length)


def joint(rng: Rng) -> World:
    """One joint of a robot: rad and N m, where an angle does not vanish at rest but at a pose."""
    rate_hz, t = grid(rng, (100.0, 1000.0), (10.0, 40.0))
    size, home = log_uniform(rng, 0.15, 1.3), rng.uniform(-1.0, 1.0)
    offset = float(rng.choice([0.0, pi, rng.uniform(-pi, pi)], p=[0.35, 0.3, 0.35]))
    form = str(rng.choice(["multisine", "moves", "chirp", "ramps"]))
    top_hz, leg_s = log_uniform(rng, 0.5, 4.0), log_uniform(rng, 0.5, 2.5)
    spread = float(rng.choice([1.1, 3.0]))  # many programs repeat one speed

    def path() -> Array:
        if form == "multisine":
            return home + size * multisine(rng, t, 0.1, top_hz)
        if form == "chirp":
            return home + size * chirped(rng, t, 0.1, top_hz, 1.0)
        return home + size * strokes(rng, t, (leg_s, spread * leg_s), 0.6 if form == "moves" else 0.0, False)

    motions = two_motions(path, t, log_uniform(rng, 0.08, 0.3))
    m = motions[0]
    gravity = log_uniform(rng, 0.5, 40.0)
    inertia = gravity * log_uniform(rng, 0.1, 0.8) / 9.81
    scale = max(std(gravity * np.sin(m.x - offset)), inertia * std(m.a))
    viscous = scale * log_uniform(rng, 0.05, 0.6) / std(m.v)
    bare = rng.random() < 0.25
    rubs, force = _friction(rng, m, scale * log_uniform(rng, 0.1, 1.0), size)
    loaded = rng.uniform(0.2, 0.8) if rng.random() < 0.3 else 0.0
    ripple = 0.0 if bare or rng.random() < 0.6 else scale * log_uniform(rng, 0.02, 0.15)
    teeth, phase = 2.0 * pi / (size * log_uniform(rng, 0.03, 0.4)), rng.uniform(0.0, 6.0)

    def parts(m: Motion) -> Parts:
        pulls = gravity * np.sin(m.x - offset)
        found = {"": inertia * m.a + viscous * m.v, "angle_force": pulls}
        if not bare:
            found[rubs] = force(m) * (1.0 - loaded + loaded * np.abs(pulls) / gravity)
        if ripple:
            found["position_map"] = ripple * np.sin(teeth * m.x + phase)
        return found

    numbers = {"inertia": inertia, "viscous": viscous, "gravity": gravity, "offset": offset}
    words = f"{form} {size:.2g} rad about {home:.2g}, gravity {gravity:.3g} sin(q - {offset:.2g})"
    also = ("stiffening", "position_map", *RUBS, *(("position_dependent_friction",) if loaded else ()))
    return World(
        words, rate_hz, motions, (parts(m), parts(motions[1])), log_uniform(rng, 0.005, 0.05),
        log_uniform(rng, 0.012, 0.08), log_uniform(rng, 1e-5, 1e-3), angular=True, sense=sense_of(rng),
        allowed=also[:2] if bare else also, base=(inertia, viscous, None), numbers=numbers,
    )  # fmt: skip


def chirp(rng: Rng) -> World:
    """A stage sampled slowly, with a chirp up to a quarter of the rate, and one effect or none."""
    rate_hz, t = grid(rng, (20.0, 50.0), (20.0, 120.0))
    top_hz, size, flat = (
        rate_hz * rng.uniform(0.12, 0.25),
        log_uniform(rng, 0.5e-3, 10e-3),
        rng.uniform(0.5, 1.5),
    )
    sizes = (size, size * rng.uniform(0.5, 1.2))
    motions = tuple(moved(t, s * chirped(rng, t, log_uniform(rng, 0.1, 0.5), top_hz, flat)) for s in sizes)
    m = motions[0]
    stiffness = log_uniform(rng, 20.0, 3000.0)
    mass = stiffness * std(m.x) / std(m.a) * log_uniform(rng, 0.1, 1.5)
    damping = stiffness * std(m.x) / std(m.v) * log_uniform(rng, 0.1, 1.0)
    effect = str(rng.choice(["coulomb_friction", "stress_relaxation", "stiffening", "hunt_crossley_damping",
                             "asymmetric_damping", "play", "time_delay", ""]))  # fmt: skip
    tau_s, delay_s = log_uniform(rng, 0.1, 3.0), rng.uniform(0.2, 1.5) / rate_hz
    gap = size * log_uniform(rng, 0.05, 0.5)
    shapes: dict[str, Callable[[Motion], Array]] = {
        "coulomb_friction": lambda m: forces.bristle(m.x, 2e-3 * size),
        "stress_relaxation": lambda m: forces.maxwell(m, tau_s),
        "stiffening": lambda m: m.x**3,
        "hunt_crossley_damping": lambda m: np.maximum(m.x, 0.0) * m.v,
        "asymmetric_damping": lambda m: np.maximum(m.v, 0.0),
    }

    def linear(m: Motion) -> Array:
        return mass * m.a + damping * m.v + stiffness * m.x

    amount = log_uniform(rng, 0.1, 0.7) * std(linear(m)) / std(shapes[effect](m)) if effect in shapes else 0.0

    def parts(m: Motion) -> Parts:
        found = {"": linear(m)}
        if effect in shapes:
            found[effect] = amount * shapes[effect](m)
        elif effect == "play":
            behind = moved(m.t, forces.played(m.x, gap), 0.02)
            found[effect] = damping * (behind.v - m.v) + stiffness * (behind.x - m.x)
        elif effect == "time_delay":
            found[effect] = np.interp(m.t - delay_s, m.t, found[""]) - found[""]
        return found

    keys = {"coulomb_friction": ("forward_n", "backward_n"), "stress_relaxation": ("stiffness_n_m",),
            "stiffening": ("cubic_n_m3",), "hunt_crossley_damping": ("damping_n_s_m2",)}  # fmt: skip
    exact = [(effect, key, amount) for key in keys.get(effect, ())]
    exact += {"stress_relaxation": [(effect, "time_constant_s", tau_s)], "play": [(effect, "width_m", gap)],
              "time_delay": [(effect, "delay_s", delay_s)]}.get(effect, [])  # fmt: skip
    also = {"coulomb_friction": RUBS, "time_delay": ("sensor_lag",), "play": ("backlash",),
            "hunt_crossley_damping": ("asymmetric_damping",)}.get(effect, ())  # fmt: skip
    return World(
        f"chirp to {top_hz:.3g} Hz, {size * 1e3:.3g} mm, {effect or 'nothing'}", rate_hz, (m, motions[1]),
        (parts(m), parts(motions[1])), log_uniform(rng, 0.005, 0.05), log_uniform(rng, 0.012, 0.08),
        log_uniform(rng, 1e-7, 2e-5), sense=sense_of(rng), allowed=also, base=(mass, damping, stiffness),
        parameters=tuple(exact),
    )  # fmt: skip


def through_a_seal(rng: Rng) -> World:
    """An instrument through a seal or a phantom, under a weight or beside a magnet."""
    rate_hz, t = grid(rng, (50.0, 1000.0), (10.0, 80.0))
    hand, travel = bool(rng.random() < 0.5), log_uniform(rng, 2e-3, 60e-3)
    leg_s, shakes = log_uniform(rng, 0.2, 1.5), log_uniform(rng, 10e-6, 150e-6) if hand else 0.0
    rests, spread = rng.uniform(0.0, 0.6), float(rng.choice([1.2, 4.0]))

    def path() -> Array:
        x = 0.5 * travel * strokes(rng, t, (leg_s, spread * leg_s), rests, hand)
        return x + tremor(rng, t, shakes) if hand else x

    motions = two_motions(path, t, 0.03 if hand else log_uniform(rng, 0.02, 0.1))
    m = motions[0]
    rubbing = log_uniform(rng, 0.1, 20.0)
    rubs, force = _friction(rng, m, rubbing, travel)
    side = float(rng.choice([1.0, -1.0, 0.0], p=[0.5, 0.35, 0.15]))
    stiffness = side * rubbing * log_uniform(rng, 0.1, 5.0) / std(m.x)
    damping, mass = rubbing * log_uniform(rng, 0.02, 0.5) / std(m.v), log_uniform(rng, 0.02, 1.5)
    weight = rubbing * rng.normal() * 2.0
    bent = stiffness * rng.uniform(-1.0, 1.5) / travel**2 * (rng.random() < 0.3)
    grows = rubbing / travel * rng.uniform(0.5, 2.0) * (rng.random() < 0.2)
    rate_n_s = (
        rubbing * log_uniform(rng, 0.1, 0.8) / t[-1] * (rng.random() < 0.25) * float(rng.choice([-1.0, 1.0]))
    )

    def parts(m: Motion) -> Parts:
        found = {"": mass * m.a + damping * m.v + stiffness * m.x + weight, rubs: force(m)}
        if bent:
            found["stiffening"] = bent * m.x**3
        if grows:
            found["position_dependent_friction"] = (
                grows * (m.x + 0.5 * travel) * forces.bristle(m.x, 1e-3 * travel)
            )
        if rate_n_s:
            found["sensor_drift"] = rate_n_s * m.t
        return found

    simple = rubs == RUBS[0] and not grows
    exact = [(rubs, key, rubbing) for key in ("forward_n", "backward_n")] if simple else []
    words = f"{'hand' if hand else 'motor'}, {travel * 1e3:.3g} mm, {rubs} {rubbing:.2g} N, "
    words += f"k {stiffness:.2g} N/m, weight {weight:.2g} N"
    return World(
        words, rate_hz, motions, (parts(m), parts(motions[1])), log_uniform(rng, 0.005, 0.05),
        log_uniform(rng, 0.012, 0.08), log_uniform(rng, 1e-6, 3e-5), sense=sense_of(rng), allowed=RUBS,
        base=(mass, damping, None if bent else stiffness), parameters=tuple(exact),
    )  # fmt: skip


def control(rng: Rng) -> World:
    """Mass, damper and spring with a tare, and nothing else."""
    rate_hz, t = grid(rng, (50.0, 1000.0), (10.0, 60.0))
    travel, leg_s = log_uniform(rng, 1e-3, 40e-3), log_uniform(rng, 0.2, 1.5)
    form = str(rng.choice(["multisine", "moves", "hand"]))

    def path() -> Array:
        if form == "multisine":
            return 0.5 * travel * multisine(rng, t, 0.1, log_uniform(rng, 2.0, 10.0))
        return 0.5 * travel * strokes(rng, t, (leg_s, 3.0 * leg_s), 0.4, form == "hand")

    motions = two_motions(path, t, 0.04)
    m, stiffness = motions[0], log_uniform(rng, 20.0, 5000.0)
    mass = stiffness * std(m.x) / std(m.a) * log_uniform(rng, 0.05, 1.0)
    damping = stiffness * std(m.x) / std(m.v) * log_uniform(rng, 0.05, 1.0)
    tare = stiffness * travel * rng.normal()
    parts = [{"": mass * m.a + damping * m.v + stiffness * m.x + tare} for m in motions]
    return World(
        f"{form}, {travel * 1e3:.3g} mm", rate_hz, motions, (parts[0], parts[1]),
        log_uniform(rng, 0.005, 0.05), 0.0, log_uniform(rng, 1e-8, 1e-6), sense=sense_of(rng),
        base=(mass, damping, stiffness),
    )  # fmt: skip


def outside(rng: Rng) -> World:
    """Something without a name in the vocabulary is the largest effect beside mass, damper and spring."""
    rate_hz, t = grid(rng, (50.0, 250.0), (20.0, 60.0))
    travel, leg_s, hand = log_uniform(rng, 2e-3, 40e-3), log_uniform(rng, 0.3, 1.5), bool(rng.random() < 0.5)
    motions = two_motions(lambda: 0.5 * travel * strokes(rng, t, (leg_s, 3.0 * leg_s), 0.4, hand), t, 0.05)
    m, half = motions[0], 0.55 * travel
    kinds = ("warming friction", "detent", "preisach", "second axis", "yielding", "bumps in and out")
    what = str(rng.choice(kinds))
    stiffness, share = log_uniform(rng, 20.0, 3000.0), log_uniform(rng, 0.4, 2.0)
    own = int(rng.integers(2**31))
    base = stiffness * std(m.x)
    damping = base / std(m.v) * log_uniform(rng, 0.05, 0.5)
    mass = base / std(m.a) * log_uniform(rng, 0.01, 0.3)

    def other(m: Motion, run: int) -> Array:
        same, fresh, count = np.random.default_rng(own), np.random.default_rng((own, run)), 14
        u = forces.bristle(m.x, 0.004 * travel)
        if what == "warming friction":
            return np.asarray(u * np.abs(1.0 + 0.8 * forces.wandering(fresh, m.t, 0.2)))
        if what == "detent":
            return forces.bumps(same, m.x, -half, half, count)
        if what == "preisach":
            return forces.preisach(same, m.x, -half, half)
        if what == "second axis":
            return forces.wandering(fresh, m.t, 1.0)
        if what == "yielding":
            return forces.yielding(m.x, 2.0 / travel, 0.35, 0.3 / travel)
        way_in, way_out = (forces.bumps(same, m.x, -half, half, count) for _ in range(2))
        return np.asarray(0.5 * (1.0 + u) * way_in + 0.5 * (1.0 - u) * way_out)

    strange = [other(m, run) for run, m in enumerate(motions)]
    scale = share * base / std(strange[0])
    parts = [{"": mass * m.a + damping * m.v + stiffness * m.x, "outside": scale * part}
             for m, part in zip(motions, strange, strict=True)]  # fmt: skip
    also = {"warming friction": RUBS, "detent": ("position_map",), "preisach": RUBS[:1] + RUBS[2:],
            "second axis": ("not_driven_by_this_axis",), "yielding": (RUBS[2],),
            "bumps in and out": ("position_map",)}[what]  # fmt: skip
    return World(
        f"{what}, {travel * 1e3:.3g} mm", rate_hz, motions, (parts[0], parts[1]),
        log_uniform(rng, 0.005, 0.05), log_uniform(rng, 0.012, 0.08), log_uniform(rng, 1e-6, 2e-5),
        sense=sense_of(rng), allowed=also, outside=True,
    )  # fmt: skip
