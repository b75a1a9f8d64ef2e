"""Worlds of materials: a tensile test, relaxation, creep, palpation."""

import numpy as np

from tests.hidden_effects.laboratory import forces
from tests.hidden_effects.laboratory.motion import (
    Motion,
    Rng,
    grid,
    log_uniform,
    moved,
    strokes,
    tremor,
    visited,
)
from tests.hidden_effects.laboratory.truth import Array
from tests.hidden_effects.laboratory.world import Parts, World, sense_of, two_motions


def pull(rng: Rng) -> World:
    """A specimen pulled or pressed once, at one speed; the other motion is another specimen's speed."""
    rate_hz, t = grid(rng, (5.0, 100.0), (10.0, 600.0))
    travel, waits = log_uniform(rng, 0.5e-3, 40e-3), rng.uniform(0.0, 0.05)
    curve = str(rng.choice(["linear", "stiffening", "toe", "softening", "yield", "relaxation"]))
    most_n, bend, k = log_uniform(rng, 1.0, 2000.0), rng.uniform(0.3, 3.0), log_uniform(rng, 1.0, 6.0)
    taus_s = [t[-1] * log_uniform(rng, 0.03, 0.5) for _ in range(int(rng.integers(1, 3)))]

    def ramp(reach: float) -> Motion:
        return moved(t, reach * travel * np.clip((t / t[-1] - waits) / (1.0 - waits), 0.0, 1.0), 0.05)

    def force(m: Motion) -> Array:
        s = np.maximum(m.x / travel, 0.0)
        shapes = {"linear": s, "stiffening": s + bend * s**3,
                  "toe": np.logaddexp(0.0, 8.0 * k * (s - 0.3)) / k,
                  "softening": (1.0 - np.exp(-bend * s)) / bend,
                  "yield": np.minimum(s, 0.3 + 0.03 * k * (s - 0.3))}  # fmt: skip
        if curve == "relaxation":
            shapes[curve] = s + forces.relaxing(m, [(bend / travel, tau_s) for tau_s in taus_s])
        return np.asarray(shapes[curve])

    motions = (ramp(1.0), ramp(rng.uniform(0.4, 0.9)))
    full = [most_n * force(m) / np.max(force(motions[0])) for m in motions]
    lines = [most_n / travel * m.x for m in motions]
    name = {"linear": "", "relaxation": "stress_relaxation"}.get(curve, "stiffening")
    parts = [
        ({"": line, name: part - line} if name else {"": line})
        for line, part in zip(lines, full, strict=True)
    ]
    also = {"linear": ("nothing_missing", "nothing_found"), "toe": ("contact_loss",),
            "stiffening": ()}.get(curve, ("stiffening", "stress_relaxation"))  # fmt: skip
    return World(
        f"{curve}, {travel * 1e3:.3g} mm in {t[-1]:.3g} s, to {most_n:.3g} N", rate_hz, motions,
        (parts[0], parts[1]), log_uniform(rng, 0.0005, 0.01), log_uniform(rng, 0.002, 0.03),
        log_uniform(rng, 1e-8, 1e-6), rough=log_uniform(rng, 0.1e-6, 30e-6), sense=sense_of(rng),
        allowed=also, separable=False,
    )  # fmt: skip


def ramp_hold(rng: Rng) -> World:
    """Relaxation: steps of a ramp, each with a hold of a minute to an hour."""
    rate_hz, t = grid(rng, (1.0, 50.0), (120.0, 3600.0))
    count = int(rng.integers(1, 6))
    travel, stiffness = log_uniform(rng, 0.5e-3, 20e-3), log_uniform(rng, 100.0, 50e3)
    ramp_s = t[-1] / count * log_uniform(rng, 0.005, 0.08)
    branches = [
        (stiffness * log_uniform(rng, 0.1, 1.0), t[-1] / count * log_uniform(rng, 0.02, 0.6))
        for _ in range(int(rng.choice([0, 1, 2, 3], p=[0.15, 0.35, 0.3, 0.2])))
    ]
    drift_n_s = 0.0 if rng.random() < 0.7 else stiffness * travel / t[-1] * log_uniform(rng, 0.02, 0.2)

    def path() -> Array:
        up, stops, here = rng.random() < 0.6, [(0.0, 0.0)], 0.0
        for i in range(count):
            there = (i + 1.0) / count if up else rng.uniform(0.2, 1.0) * (i % 2 == 0)
            start = t[-1] * (i + rng.uniform(0.02, 0.2)) / count
            stops += [
                (start, here),
                (start + ramp_s * max(abs(there - here), 0.05) * log_uniform(rng, 0.5, 2.0), there),
            ]
            here = there
        return travel * visited(t, stops, False)

    def parts(m: Motion) -> Parts:
        found = {"": stiffness * m.x}
        if branches:
            found["stress_relaxation"] = forces.relaxing(m, branches)
        if drift_n_s:
            found["sensor_drift"] = drift_n_s * m.t
        return found

    motions = two_motions(path, t, 2.0 / rate_hz)
    keys = ("stiffness_n_m", "time_constant_s") if len(branches) == 1 else ()
    single = [
        ("stress_relaxation", key, value)
        for branch in branches
        for key, value in zip(keys, branch, strict=False)
    ]
    return World(
        f"{count} ramps of {ramp_s:.3g} s, {len(branches)} branches, drift {drift_n_s:.2g} N/s", rate_hz,
        motions, (parts(motions[0]), parts(motions[1])), log_uniform(rng, 0.001, 0.02),
        log_uniform(rng, 0.005, 0.04), log_uniform(rng, 1e-7, 5e-6), rough=log_uniform(rng, 1e-7, 5e-6),
        sense=sense_of(rng), base=(None, None, stiffness), parameters=tuple(single),
    )  # fmt: skip


def creep(rng: Rng) -> World:
    """Steps of a force that a controller holds; the position creeps, as the inverse of relaxing branches."""
    rate_hz, t = grid(rng, (5.0, 100.0), (60.0, 1800.0))
    law = str(rng.choice(["kelvin", "burgers", "logarithmic"]))
    stiffness, most_n = log_uniform(rng, 200.0, 20e3), log_uniform(rng, 0.5, 100.0)
    count, lag_s = int(rng.integers(2, 7)), log_uniform(rng, 0.05, 2.0)
    share, tau_s = log_uniform(rng, 0.1, 1.0), t[-1] / count * log_uniform(rng, 0.03, 0.5)
    flow_s = t[-1] * log_uniform(rng, 0.5, 5.0)

    def held(force: Array) -> Motion:
        m = moved(t, force / stiffness)
        x = m.x + share * (m.x - forces.maxwell(m, tau_s)) * (law != "logarithmic")
        if law == "burgers":
            x = x + np.cumsum(m.x) * (t[1] - t[0]) / flow_s
        if law == "logarithmic":
            decades = [0.01 * t[-1] * 4.0**i for i in range(4)]
            x = x + 0.4 * share * sum((m.x - forces.maxwell(m, each) for each in decades), np.zeros_like(t))
        return moved(t, x)

    def steps() -> Array:
        force, here = np.zeros_like(t), 0.0
        for i in range(count):
            here = (
                here + rng.uniform(0.2, 1.0)
                if rng.random() < 0.6 or here == 0.0
                else rng.uniform(0.0, 0.6) * here
            )
            force[t >= t[-1] * (i + rng.uniform(0.05, 0.25)) / count] = here
        return np.asarray(most_n * moved(t, force / np.max(force), lag_s).x)

    pushes = (steps(), steps())
    motions = (held(pushes[0]), held(pushes[1]))
    lowest = stiffness / (1.0 + share)
    parts = [
        {"": lowest * m.x, "stress_relaxation": push - lowest * m.x}
        for m, push in zip(motions, pushes, strict=True)
    ]
    inverse = (("stiffness_n_m", stiffness - lowest), ("time_constant_s", tau_s / (1.0 + share)))
    exact = [("stress_relaxation", *each) for each in inverse] if law == "kelvin" else []
    return World(
        f"{law}, {count} steps to {most_n:.3g} N, lag {lag_s:.2g} s", rate_hz, motions, (parts[0], parts[1]),
        log_uniform(rng, 0.001, 0.02), log_uniform(rng, 0.002, 0.02), log_uniform(rng, 1e-7, 2e-6),
        rough=log_uniform(rng, 1e-7, 3e-6), sense=sense_of(rng),
        base=(None, None, lowest if law == "kelvin" else None), parameters=tuple(exact),
    )  # fmt: skip


def palpation(rng: Rng) -> World:
    """Indentations by hand into a tissue that stiffens, relaxes and damps; the probe leaves it between."""
    rate_hz, t = grid(rng, (100.0, 1000.0), (10.0, 40.0))
    travel, leg_s = log_uniform(rng, 3e-3, 20e-3), log_uniform(rng, 0.2, 1.2)
    rests, shakes = rng.uniform(0.1, 0.7), log_uniform(rng, 10e-6, 100e-6)
    spread = float(rng.choice([1.3, 3.0]))
    leaves = bool(rng.random() < 0.75)
    surface = travel * (rng.uniform(-0.4, 0.15) if leaves else -0.7)

    def path() -> Array:
        x = 0.5 * travel * strokes(rng, t, (leg_s, spread * leg_s), rests, True, back=True)
        return x + tremor(rng, t, shakes)

    motions = two_motions(path, t, 0.03)
    depth_m = float(np.max(motions[0].x)) - surface
    stiffness = log_uniform(rng, 0.5, 15.0) / depth_m
    bend = rng.uniform(0.3, 2.0) / depth_m * (rng.random() < 0.8)
    branches = [
        (stiffness * log_uniform(rng, 0.2, 1.0), log_uniform(rng, 0.1, 5.0))
        for _ in range(int(rng.integers(0, 3)))
    ]
    damps = stiffness / depth_m * log_uniform(rng, 0.02, 0.2) * (rng.random() < 0.6)
    mass, damping = log_uniform(rng, 0.01, 0.2), stiffness * log_uniform(rng, 0.003, 0.05)

    def parts(m: Motion) -> Parts:
        d = np.maximum(m.x - surface, 0.0)
        rate = np.where(d > 0.0, m.v, 0.0)
        found = {"stiffening": stiffness * bend * d**2, "hunt_crossley_damping": damps * d * rate}
        found["stress_relaxation"] = forces.relaxing(m, branches, rate)
        held = stiffness * d + damping * rate + sum(found.values())
        touching = (d > 0.0) & (held > 0.0)
        known = {name: np.where(touching, part, 0.0) for name, part in found.items() if np.any(part)}
        straight = damping * m.v + stiffness * (m.x - surface)
        lost = np.where(touching, damping * rate + stiffness * d, 0.0) - straight
        return {"": mass * m.a + straight, **known, "contact_loss": lost}

    both = (parts(motions[0]), parts(motions[1]))
    return World(
        f"{travel * 1e3:.3g} mm, contact {'lost' if leaves else 'kept'}, {len(branches)} branches", rate_hz,
        motions, both, log_uniform(rng, 0.005, 0.04), log_uniform(rng, 0.02, 0.08),
        log_uniform(rng, 1e-6, 3e-5),
        sense=sense_of(rng), allowed=("stiffening", "contact_loss") if leaves or bend else (),
    )  # fmt: skip
