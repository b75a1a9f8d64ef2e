"""Devices that lie, and healthy ones that have to be believed: `python -m benchmarks.liars [PART]...`.

In virtual time. `liars`: a stage or a load cell of the demo lies from 1.7 s on, amid the first stroke, or
from the start. Printed: when that is a fault; how long the stage was 0.02 mm off by then; its largest
deviation until then; its way once it is free again; the force then, and the largest of 6 s. `healthy`: both
instruments, five seeds, every cause of `benchmarks.hidden_in_service` hidden from 2 s on. `recordings`: each
in FOREFEEL_DATA as the motion of the hand, in mm where it is no length. Default: all of them; exit code 1: a
healthy device was not believed, or one of `ALARMS` was raised.
"""

import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

from benchmarks.hidden_in_service import HIDDEN, write_model
from forefeel.common.events.text import CONTACT_LOST, DISTRUSTED, OVER_LIMIT, SLOW_LIMIT, ZERO
from forefeel.common.limiter import LimitHit
from forefeel.common.recording.units import Mapping
from forefeel.loopback.plan import LoopbackOptions, make_plan
from forefeel.loopback.virtual import VirtualLoopback
from forefeel.slave.plant.stage import PlantStage
from forefeel.slave.plant.world import PlantLoadCell, SimulatedWorld

_FORCE = re.compile(r"_n(_|$)")
LIES_S, FREED_S, RUN_S = 1.7, 2.5, 6.0
_OFF_M = 2e-5
_SLOW_M_S = 0.020
INSTRUMENTS = {"catheter": 1.0, "guidewire": 0.1}
"""And by how much what is hidden is weaker: a guidewire's forces, and its force limit, are a tenth."""
SEEDS = range(5)
ALARMS = {OVER_LIMIT, SLOW_LIMIT, ZERO, DISTRUSTED, CONTACT_LOST, "reading_late"}
_NO_LENGTHS = "davinci", "robot_joint", "silverbox"


@dataclass(slots=True)
class Outcome:
    """`fault`: why, empty for none. `off_s`: when the stage was 0.02 mm off. `deviation_m`, `force_n`: up to
    the fault. `leap_m`: the way of the stage once it is free. `alarms`: rules. `most_n`: of the true force in
    the whole run.
    """

    fault: str = ""
    fault_s: float = 0.0
    off_s: float = 0.0
    deviation_m: float = 0.0
    leap_m: float = 0.0
    alarms: set[str] = field(default_factory=set)
    force_n: float = 0.0
    most_n: float = 0.0


def run(options: LoopbackOptions, lie: Callable[[SimulatedWorld], object] = lambda _: None) -> Outcome:
    """A loopback with those options, to its end, its world changed by `lie`."""
    plan, outcome = make_plan(options), Outcome()
    if options.recording is not None and "guidewire" in options.recording.name:
        plan.slave["axes"][0]["load_cell"]["pushes_only"] = True
    loop = VirtualLoopback(plan, options.seed)
    axis = loop.slave.axes[0]
    watch = axis._watch
    world: SimulatedWorld = axis._devices.stage._world  # type: ignore[attr-defined]
    start_ns, lies = loop.runtime.clock.now_ns(), lie(world)
    freed_m: list[float] = []

    for events in (axis.events, loop.master.axes[0].events):
        vars(events)["limit"] = partial(_heeded, events.limit, outcome.alarms)

    def look(now_ns: int) -> None:
        t = (now_ns - start_ns) * 1e-9
        force_n = abs(world._load_cell.filtered.value)
        outcome.most_n = max(outcome.most_n, force_n)
        if not outcome.fault:
            outcome.deviation_m = max(outcome.deviation_m, watch.following.deviation_m)
            if watch.following.deviation_m < _OFF_M:
                outcome.off_s = t
            if axis.halted:
                outcome.fault, outcome.fault_s, outcome.force_n = axis.reason, t, force_n
        if lies and t >= FREED_S:
            freed_m.append(watch.stage.position_m)
            outcome.leap_m = max(freed_m) - min(freed_m)

    loop.runtime.loop("look", 1_000_000, look)
    loop.run(lambda _: None)
    return outcome


def _heeded(limit: Callable[[LimitHit], None], alarms: set[str], hit: LimitHit) -> None:
    limit(hit)
    alarms |= {hit.rule} & ALARMS


# --- Lies ---


def _frozen(until_s: float, world: SimulatedWorld) -> bool:
    """The motor stands, whatever the servo demands."""
    stage, step = world._stage, world._stage.step

    def stuck(t: float) -> tuple[float, float, float]:
        before_m = stage.position_m
        moved = step(t)
        if not LIES_S <= t < until_s:
            return moved
        stage.position_m, stage.velocity_m_s = before_m, 0.0
        return before_m, 0.0, 0.0

    _replace(stage, step=stuck)
    return until_s < RUN_S


def _lost(share: float, world: SimulatedWorld) -> bool:
    """Of each step that share is lost, which the encoder shows and the servo does not make up for."""
    stage, step, lost_m = world._stage, world._stage.step, [0.0]

    def slipping(t: float) -> tuple[float, float, float]:
        before_m = stage.position_m
        x, v, a = step(t)
        if t >= LIES_S:
            lost_m[0] += share * (x - before_m)
            v, a = (1.0 - share) * v, (1.0 - share) * a
        return x - lost_m[0], v, a

    _replace(stage, step=slipping, readback=lambda: (stage.position_m - lost_m[0], stage.velocity_m_s))
    return False


def _slow(world: SimulatedWorld) -> bool:
    stage, step = world._stage, world._stage.step

    def slow(t: float) -> tuple[float, float, float]:
        if t >= LIES_S:
            stage._fastest_m_s = _SLOW_M_S
        return step(t)

    _replace(stage, step=slow)
    return False


def _converts(change: Callable[[float, float, Random], float], world: SimulatedWorld) -> bool:
    """(time s, reading N) -> reading N."""
    cell, convert, random = world._load_cell, world._load_cell.convert, Random(1)

    def lying(t: float) -> None:
        convert(t)
        cell.reading = cell.reading._replace(force_n=change(t, cell.reading.force_n, random))

    _replace(cell, convert=lying)
    return False


def _replace(of: PlantStage | PlantLoadCell, **methods: Callable[..., Any]) -> None:
    for name, method in methods.items():
        setattr(of, name, method)


def _constant() -> Callable[[float, float, Random], float]:
    kept: list[float] = []

    def change(t: float, force_n: float, random: Random) -> float:
        if t < LIES_S:
            return force_n
        kept.append(force_n)
        return kept[0] + random.gauss(0.0, 0.002)

    return change


LIARS: dict[str, Callable[[SimulatedWorld], bool]] = {
    "stage: half motion": lambda world: _lost(0.5, world),
    "stage: stuck": lambda world: _frozen(RUN_S, world),
    "stage: stuck for 0.8 s, then free": lambda world: _frozen(FREED_S, world),
    "stage: 20 mm/s at most": _slow,
    "stage: slips by a fifth": lambda world: _lost(0.2, world),
    "cell: sign reversed": lambda world: _converts(lambda _t, n, _r: -n, world),
    "cell: gain twice as large": lambda world: _converts(lambda _t, n, _r: 2.0 * n, world),
    "cell: gain half as large": lambda world: _converts(lambda _t, n, _r: 0.5 * n, world),
    "cell: a constant with noise": lambda world: _converts(_constant(), world),
}


def demo(instrument: str, seed: int = 1, **more: Any) -> LoopbackOptions:  # noqa: ANN401 - of LoopbackOptions
    return LoopbackOptions(seed=seed, impairment="paper", preset=instrument, duration_s=RUN_S, **more)


# --- Parts ---


def _liars() -> Iterator[str]:
    """None of them is healthy: nothing here fails the run."""
    print(
        "| instrument | lie | fault, ms | of these off | deviation, mm | way once free | force, N | at most |"
    )
    for instrument in INSTRUMENTS:
        for name, lie in LIARS.items():
            found = run(demo(instrument), lie)
            since_s = found.fault_s - (LIES_S if name.startswith("stage") or "constant" in name else 0.0)
            after = f"{since_s * 1e3:.0f}" if found.fault else "none"
            off = f"{(found.fault_s - found.off_s) * 1e3:.0f}" if found.deviation_m > _OFF_M else "-"
            mm = f"{found.deviation_m * 1e3:.3f} | {found.leap_m * 1e3:.2f}"
            force = f"{found.force_n:.3f} | {found.most_n:.3f}"
            print(f"| {instrument} | {name} | {after} | {off} | {mm} | {force} |", flush=True)
    yield from ()


def _healthy() -> Iterator[str]:
    with tempfile.TemporaryDirectory() as folder:
        for instrument, share in INSTRUMENTS.items():
            for cause in ("nothing", *sorted(set(HIDDEN) - {"contact_loss"})):  # a vessel has one
                hide: dict[str, Any] = {}
                if cause != "nothing":
                    hide = {"hide": hidden(cause, Path(folder), share), "hide_at_s": 2.0}
                found = [run(demo(instrument, seed, **hide)) for seed in SEEDS]
                yield from _told(f"{instrument}, {cause}", found)


def hidden(cause: str, folder: Path, share: float = 1.0, **parameters: float) -> Path:
    """A model.yaml with that cause alone, its forces by `share` of those of `HIDDEN`."""
    scaled = {name: value * (share if _FORCE.search(name) else 1.0) for name, value in HIDDEN[cause].items()}
    path = folder / f"{cause}.yaml"
    write_model(path, cause, scaled | parameters)
    return path


def _recordings() -> Iterator[str]:
    for path in sorted(Path(os.environ["FOREFEEL_DATA"]).glob("*.csv")):
        unit = "mm" if path.name.startswith(_NO_LENGTHS) else "m"
        force = None if path.name.startswith("human") else "N:force_n"
        columns = Mapping("s:time_s", f"{unit}:position_m", force)
        yield from _told(path.name, [run(LoopbackOptions(recording=path, columns=columns))])


def _told(name: str, found: list[Outcome]) -> Iterator[str]:
    faults = [each.fault or " ".join(each.alarms) for each in found if each.fault or each.alarms]
    print(f"{name}: {max(each.deviation_m for each in found) * 1e3:.3f} mm", *faults, sep=", ", flush=True)
    yield from faults


PARTS = {"liars": _liars, "healthy": _healthy, "recordings": _recordings}


def main(names: list[str]) -> int:
    """Prints the parts; 1 where a healthy device was not believed."""
    faults = [fault for name in names or PARTS for fault in PARTS[name]()]
    print(f"{len(faults)} false alarms")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
