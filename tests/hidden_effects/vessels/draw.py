"""Draws a recording: `draw(kind, seed)`; the same arguments give the same recording."""

from math import radians
from typing import NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from forefeel.devices.mujoco.path import GUIDE_M, Path, Piece
from forefeel.devices.mujoco.wire import STEP_S, EscapedError, Guidewire, WireChain
from tests.hidden_effects.laboratory.motion import Motion, Rng, log_uniform, moved, strokes, tremor
from tests.hidden_effects.laboratory.truth import Array, Recorded, Truth

FRICTION = ("position_dependent_friction", "friction_along_the_path", "capstan")  # names that say the same
# a wire that straightens pushes back by its depth alone, from where it is bent first
ELASTIC = ("stiffening", "position_map", "stiffness_change", "contact_loss")
_SMOOTH = 5e-3  # friction of a vessel in which that is nearly all; none at all lets the wire out
_LEAST = 0.05  # share of the force below which that is no part of the truth
_RATES_HZ = (100, 125, 200, 250)
_HEADER = ("time_s", "position_mm", "force_N")
_BEHIND_M = 5e-3  # of guide behind the stage's end, and of vessel beyond the tip's
_ATTEMPTS = 5


class Kind(NamedTuple):
    """Inner width of the vessel, and radii of its bends, from and to."""

    lumen_m: tuple[float, float]
    bends_m: tuple[float, float]


KINDS = {"narrow": Kind((2.5e-3, 4.5e-3), (0.02, 0.035)), "wide": Kind((6e-3, 8e-3), (0.02, 0.06))}


def draw(kind: str, seed: int, lasts_s: tuple[float, float] = (20.0, 40.0)) -> Recorded:
    """Recording of that kind, with its truth and a second motion of the same vessel.

    A vessel that the wire leaves is drawn anew; where it leaves five in a row, `EscapedError`.
    """
    for attempt in range(_ATTEMPTS):
        try:
            return _drawn(
                kind, seed, lasts_s, np.random.default_rng((list(KINDS).index(kind), seed, attempt))
            )
        except EscapedError:
            if attempt == _ATTEMPTS - 1:
                raise
    raise AssertionError


def _drawn(kind: str, seed: int, lasts_s: tuple[float, float], rng: Rng) -> Recorded:
    travel_m, inserted_m = rng.uniform(0.02, 0.04), rng.uniform(0.01, 0.035)
    lumen_m, friction = rng.uniform(*KINDS[kind].lumen_m), rng.uniform(0.1, 0.2)
    stiffness = log_uniform(rng, 5e-5, 5e-4)
    guide_m = travel_m + _BEHIND_M
    vessel = drawn_path(rng, guide_m, inserted_m + travel_m + _BEHIND_M, lumen_m, KINDS[kind].bends_m)
    radius_m = 0.18e-3 * (stiffness / 5e-5) ** 0.25  # of the same metal
    wire = WireChain(stiffness, radius_m, guide_m + inserted_m, rng.uniform(2.5e-3, 3.5e-3))
    rate_hz, noise_n = int(rng.choice(_RATES_HZ)), rng.uniform(1e-3, 3e-3)
    step_m = log_uniform(rng, 1e-6, 1e-5)
    runs = []
    for _ in range(2):
        hand = bool(rng.random() < 0.5)
        m = _motion(rng, travel_m, rng.uniform(*lasts_s), hand)
        time_s, x, clean_n = _sampled(m, forces(Guidewire(wire, vessel, friction), m), rate_hz)
        force_n = clean_n + noise_n * rng.normal(size=len(x))
        runs.append((hand, (time_s, np.round(x / step_m) * step_m, force_n), clean_n))
    (hand, first, clean_n), (_, second, second_n) = runs
    elastic_n = _elastic_n(Guidewire(wire, vessel, _SMOOTH), travel_m, first[1])
    parts = {FRICTION[0]: clean_n - elastic_n, ELASTIC[0]: elastic_n, "": clean_n}
    share = {name: _left_of(*first[:2], part) / float(np.std(clean_n)) for name, part in parts.items()}
    bent = ELASTIC if share[ELASTIC[0]] > _LEAST else ()
    names = [(name, share[name]) for name in (FRICTION[0], *bent[:1])]
    truth = Truth(
        kind=kind,
        seed=seed,
        motion=f"{'operator' if hand else 'strokes'} of {1e3 * travel_m:.0f} mm, "
        f"lumen {1e3 * lumen_m:.1f} mm, friction {friction:.2f}, "
        f"EI {1e6 * stiffness:.0f} N mm2, {1e3 * inserted_m:.0f} mm inserted",
        names=tuple(sorted(names, key=lambda each: -each[1])),
        allowed=(*FRICTION[1:], *bent[1:]),
        separable=True,
        sense=1.0,
        mass=None,
        damping=None,
        stiffness=None,
        parameters=(("vessel", "inserted_m", inserted_m),),
        hidden=share[""],
        force_n=float(np.std(clean_n)),
        left_n=0.0,
        noise_n=noise_n,
        outside=kind == "wide",
    )
    beside = Recorded(*second, _HEADER, second_n, None, truth)
    return Recorded(*first, _HEADER, clean_n, beside, truth)


def drawn_path(
    rng: Rng, guide_m: float, length_m: float, lumen_m: float, bends_m: tuple[float, float]
) -> Path:
    """A guide and `length_m` of bends and straights behind it that do not cross."""
    while True:
        pieces, heading, left = [Piece(guide_m, 0.0, 0.5 * GUIDE_M)], 0.0, length_m
        while left > 0.0:
            pieces.append(Piece(rng.uniform(4e-3, 18e-3), 0.0, 0.5 * lumen_m))
            radius, angle = rng.uniform(*bends_m), radians(rng.uniform(35.0, 100.0))
            side = 1.0 if rng.random() < 0.5 else -1.0
            side = -np.sign(heading) if abs(heading + side * angle) > radians(130.0) else side
            heading += side * angle
            pieces.append(Piece(radius * angle, side / radius, 0.5 * lumen_m))
            left -= pieces[-1].length_m + pieces[-2].length_m
        path = Path(tuple(pieces))
        if not path.crosses_itself():
            return path


def _motion(rng: Rng, travel_m: float, lasts_s: float, hand: bool) -> Motion:
    """In and out from the most retracted place: a stage's strokes, or a hand's with rests and tremor."""
    t = np.arange(round(lasts_s / STEP_S), dtype=np.float64) * STEP_S
    stroke_s = (0.4, 2.0) if hand else (0.8, 4.0)
    x = 0.5 * travel_m * (1.0 + strokes(rng, t, stroke_s, 0.4 if hand else 0.1, hand))
    if hand:
        x = x + tremor(rng, t, rng.uniform(0.02e-3, 0.1e-3))
    return moved(t, x - x[0], 0.06)


def forces(world: Guidewire, m: Motion) -> Array:
    """Force of the stage at every step; `EscapedError` where the wire leaves its vessel."""
    world.settle()
    return np.array([world.step(x, v) for x, v in zip(m.x.tolist(), m.v.tolist(), strict=True)])


def _elastic_n(world: Guidewire, travel_m: float, x: Array) -> Array:
    """Force by depth without friction: the mean of a slow way in and out."""
    t = np.arange(round(4.0 / STEP_S), dtype=np.float64) * STEP_S
    m = moved(t, 0.5 * travel_m * (1.0 - np.cos(2.0 * np.pi * t / t[-1])))
    way_in, way_out = forces(world, m).reshape(2, -1)
    return np.interp(x, m.x[: len(t) // 2], 0.5 * (way_in + way_out[::-1]))


def _sampled(m: Motion, force_n: Array, rate_hz: int) -> tuple[Array, Array, Array]:
    """Means over each sample's period, as an integrating converter takes them."""
    each = round(1.0 / (rate_hz * STEP_S))
    count = len(m.t) // each
    t, x, f = (column[: count * each].reshape(count, each).mean(axis=1) for column in (m.t, m.x, force_n))
    return np.round(t - t[0], 6), x, f


def _left_of(time_s: Array, x: Array, force_n: Array) -> float:
    """rms of what mass, damping, stiffness and bias leave, by smoothed derivatives of the samples."""
    step_s = float(np.median(np.diff(time_s)))
    v, a = (savgol_filter(x, 11, 3, deriv=order, delta=step_s) for order in (1, 2))
    columns = np.column_stack([np.ones_like(x), *(column / np.std(column) for column in (x, v, a))])
    solved = np.linalg.lstsq(columns, force_n, rcond=None)[0]
    return float(np.sqrt(np.mean((force_n - columns @ solved) ** 2)))
