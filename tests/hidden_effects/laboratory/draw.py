"""Draws a recording: `draw(kind, seed)`; the same arguments give the same recording."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.hidden_effects.laboratory import machines, materials
from tests.hidden_effects.laboratory.forces import Rest, noise
from tests.hidden_effects.laboratory.motion import Motion, Rng, log_uniform
from tests.hidden_effects.laboratory.truth import Array, Recorded, Truth
from tests.hidden_effects.laboratory.world import Parts, World, total

WORLDS: dict[str, Callable[[Rng], World]] = {
    "joint": machines.joint,
    "pull": materials.pull,
    "ramp_hold": materials.ramp_hold,
    "creep": materials.creep,
    "chirp": machines.chirp,
    "strokes": machines.through_a_seal,
    "palpation": materials.palpation,
    "control": machines.control,
    "outside": machines.outside,
}
KINDS = tuple(WORLDS)
_LATE = "time_delay"
_SEEN = 1.0  # times the noise, of a ripple over position in the rest
_LEAST = 0.003  # share of the force below which a part is no part of the truth
_LINEAR = (("time_s", "position_mm", "force_N"), ("Time (s)", "Displacement (mm)", "Load (N)"),
           ("time_s", "displacement_mm", "load_N"), ("Time [s]", "Position [m]", "Force [N]"))  # fmt: skip
_ROTARY = (("time_s", "angle_rad", "torque_Nm"), ("Time (s)", "Angle (rad)", "Torque (Nm)"))


def draw(kind: str, seed: int) -> Recorded:
    """Recording of that kind, with its truth and a second motion of the same world."""
    rng = np.random.default_rng((KINDS.index(kind), seed))
    return recording(kind, seed, rng, WORLDS[kind](rng))


def recording(kind: str, seed: int, rng: Rng, world: World) -> Recorded:
    """What a bench records of a world, with its second motion."""
    clean_n = float(np.std(total(world.parts[0])))
    rest = Rest(rng, float(np.ptp(world.motions[0].x)))
    headers = _ROTARY if world.angular else _LINEAR
    header = headers[int(rng.integers(len(headers)))]
    runs = _Bench(rng, world, clean_n)
    parts = {_LATE: runs.lateness(), **world.parts[0]}
    truth = _truth(kind, seed, world, parts, clean_n)
    if world.rest * rest.ripple > _SEEN * world.noise:  # who names it says what is there
        truth = replace(truth, allowed=(*truth.allowed, "position_map"))
    (first, clean, further), (second, second_clean, second_further) = (
        runs.recorded(rng, rest, run) for run in (0, 1)
    )
    beside = Recorded(*second, header, second_clean, None, truth, second_further)
    return Recorded(*first, header, clean, beside, truth, further)


class _Bench:
    """How the bench samples and reads: the same in both motions."""

    def __init__(self, rng: Rng, world: World, clean_n: float) -> None:
        self._world, self._clean_n = world, clean_n
        late = rng.uniform(0.0, world.late) if rng.random() < 0.4 else 0.0
        self._late = 0.0 if _LATE in world.parts[0] else late  # samples, of the force
        self._jitter = rng.uniform(0.02, 0.3) if rng.random() < 0.4 else 0.0  # samples
        self._stamped = bool(rng.random() < 0.5)  # whether the stamps tell it
        self._digits = clean_n * log_uniform(rng, 1e-4, 5e-3)  # step of the force in the file
        self._tare_n = clean_n * rng.normal() * (rng.random() < 0.5)

    def lateness(self) -> Array:
        """What the force of the first motion changes by as it is read late: a cause like any other."""
        m, parts = self._world.motions[0], self._world.parts[0]
        force = total({name: part for name, part in parts.items() if name not in self._world.timed})
        return np.asarray(np.interp(m.t - self._late / self._world.rate_hz, m.t, force) - force)

    def recorded(
        self, rng: Rng, rest: Rest, run: int
    ) -> tuple[tuple[Array, Array, Array], Array, dict[str, Array]]:
        """Stamps, position and force as in the file; the clean force at the true instants; more columns."""
        world, m = self._world, self._world.motions[run]
        step_s = 1.0 / world.rate_hz
        nominal = m.t[:: world.over]
        if world.lost:
            nominal = nominal[rng.random(len(nominal)) >= world.lost]
        at = nominal + self._jitter * step_s * np.clip(rng.normal(size=len(nominal)), -1.5, 1.5) / 3.0
        stamps = np.round(at if self._stamped else nominal, 6)
        force = total(world.parts[run])
        extra = world.rest * self._clean_n * rest.along(rng, m) if world.rest else np.zeros_like(force)
        late = np.clip(at - self._late * step_s, m.t[0], m.t[-1])
        read = np.interp(late, m.t, force + extra) + self._tare_n * (1.0 + 0.3 * run)
        read = world.sense * (read + world.noise * self._clean_n * noise(rng, len(at)))
        x = np.interp(at, m.t, m.x) + world.rough * rng.normal(size=len(at))
        x = np.round(x / world.step) * world.step
        read = np.round(read / self._digits) * self._digits
        further = {name: np.interp(at, m.t, column) for name, column in world.further[run].items()}
        return (stamps, x, read), world.sense * np.interp(at, m.t, force), further


def _truth(kind: str, seed: int, world: World, parts: Parts, clean_n: float) -> Truth:
    m = world.motions[0]
    shares = {name: missed(m, part, world.over) / clean_n for name, part in parts.items() if name}
    named = [(n, share) for n, share in shares.items() if share > _LEAST and n != "outside"]
    return Truth(
        kind=kind,
        seed=seed,
        motion=world.words,
        names=tuple(sorted(named, key=lambda each: -each[1])),
        allowed=world.allowed,
        separable=world.separable,
        sense=world.sense,
        mass=world.base[0],
        damping=world.base[1],
        stiffness=world.base[2],
        parameters=world.parameters,
        hidden=missed(m, total(parts), world.over) / clean_n,
        force_n=clean_n,
        left_n=world.rest * clean_n,
        noise_n=world.noise * clean_n,
        outside=world.outside,
    )


def missed(m: Motion, force: Array, over: int = 1) -> float:
    """rms of what the best mass, damping, stiffness and bias leave of a force."""
    columns, force = np.column_stack([m.a, m.v, m.x, np.ones_like(m.t)])[::over], force[::over]
    columns = columns / np.maximum(np.max(np.abs(columns), axis=0), 1e-300)
    solved = np.linalg.lstsq(columns, force, rcond=None)[0]
    return float(np.sqrt(np.mean((force - columns @ solved) ** 2)))
