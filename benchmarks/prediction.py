"""The predictor beside its peers: `python -m benchmarks.prediction [--delays MS,...] [--methods NAME,...]`.

Every method gets what a master would have got. `prepare`, `replay` and `score` are those of `forefeel
evaluate`, so the numbers are those of that command to the last digit. Printed for each delay: the rms error
over that of the zero-order hold, on

- the recordings with a force in `--data` (default: the folder that FOREFEEL_DATA names);
- the demo world: a run of the catheter and of the guidewire in virtual time for each seed of `--demo`, over
  the paper's impairment at that round trip; beside them what the master predicted in the run itself;
- `--generated N` recordings: steps, ramps, pushes by a hand, noise and free motion in turn.

`--ablation` prints instead what `forefeel` reaches without each of its parts, see `prediction_ablation`.

Below a table stand the geometric mean, and on how many recordings, and instruments, forefeel is better, with
the two-sided p of a paired sign test: recordings of one instrument are not independent. `--figure FILE` draws
the recordings over the delays (`prediction_figure`). The methods of `prediction_published` are given more
than a master has.

A method whose package is not installed is left out; the extra `bench` has all.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from math import comb, exp, inf, log
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from benchmarks.links import listed
from benchmarks.markdown import Table
from benchmarks.prediction_ablation import VARIANTS
from benchmarks.prediction_peers import PEERS
from benchmarks.prediction_published import PUBLISHED, OfflineNetworks, instrument
from forefeel.common.errors import InputError, RecordingError
from forefeel.common.events.text import quantity
from forefeel.common.recording.loading import load_recording
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.evaluation.arrivals import DelayedLink
from forefeel.diagnosis.evaluation.evaluate import Prepared, prepare
from forefeel.diagnosis.evaluation.methods import METHODS, Method, replay
from forefeel.diagnosis.evaluation.score import score
from forefeel.loopback.plan import LoopbackOptions, make_plan
from forefeel.loopback.virtual import VirtualLoopback
from forefeel.report.summary import summarise
from forefeel.report.wording import offset_text, ratio

Array = NDArray[np.float64]

ALL = (*(name for name in METHODS if name != "forefeel"), *PEERS, *PUBLISHED, "forefeel")


def made(method: str, name: str, prepared: Prepared, networks: OfflineNetworks) -> Sequence[Method]:
    """Methods of one kind that know nothing yet of a recording; of several the best in hindsight counts."""
    if method in PUBLISHED:
        return PUBLISHED[method][1](name, prepared, networks)
    return [PEERS[method][1]() if method in PEERS else METHODS[method](None)]


# --- recordings ---

KINDS = "steps", "ramps", "pushes", "noise", "free motion"
_GENERATED_S = 20.0
_DEMO = "catheter", "guidewire"
_LEAST = 1e-9  # ratio that the sign test tells from 0
_JITTER_S = 0.01  # each way, of the paper's impairment


def measured(folder: Path) -> dict[str, Recording]:
    """The recordings of a folder, by their stems.

    Raises:
        InputError: there are none.
    """
    found = {path.stem: load_recording(path) for path in sorted(folder.glob("*.csv"))}
    if not found:
        raise InputError(f"--data {folder}: no CSV files, expected recordings")
    return found


def demo(preset: str, seed: int, delay_s: float) -> tuple[Recording, str]:
    """A run of 20 s in virtual time; the ratio to zoh that its master reached: over all, settled."""
    one_way = {"preset": "paper", "delay_s": delay_s / 2, "jitter_s": min(_JITTER_S, delay_s / 4)}
    plan = make_plan(LoopbackOptions(seed, preset=preset))
    for end in plan.slave, plan.master:
        end["impairment"] = {"inbound": one_way, "seed": seed}
    loop = VirtualLoopback(plan, seed)
    loop.run(lambda _done_s: None)
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"{preset}.mcap"
        loop.write(path)
        run = Run(path)
        report = summarise(run)
        return run.to_recording(), f"{ratio(report.ratio)} / {ratio(report.settled.ratio)}"


def generated(seed: int) -> Recording:
    """20 s of one of `KINDS`: a motion against a contact with spring, damper, dry friction and noise."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    rate_hz = float(rng.choice([50.0, 100.0, 200.0, 500.0]))
    t = np.arange(round(_GENERATED_S * rate_hz)) / rate_hz
    x = 1e-2 * _motion(kind, rng, t)
    v = np.gradient(x, t)
    contact_m = float(rng.choice([x.min() - 1e-3, np.quantile(x, rng.uniform(0.1, 0.6))]))
    depth_m = np.maximum(x - contact_m, 0.0)
    k, b, coulomb_n = rng.uniform(20, 400), rng.uniform(0.1, 4.0), rng.uniform(0.0, 0.3)
    f = k * depth_m + (depth_m > 0) * (b * v + coulomb_n * np.tanh(v / 1e-3))
    if kind in {"noise", "free motion"}:  # force and motion have nothing to do with each other
        f = _smooth(rng.standard_normal(len(t)), rate_hz * rng.uniform(0.0, 0.3)) * (kind == "noise")
    if kind == "pushes" and rng.random() < 0.5:  # by a hand at the instrument's tip
        f += _pulses(rng, t, 0.3 * np.ptp(f))
    noise_n = 10 ** rng.uniform(-3, -1.5) * (np.ptp(f) or 0.1)
    f += rng.uniform(-0.5, 0.5) + noise_n * rng.standard_normal(len(t))
    x += 10 ** rng.uniform(-7, -5) * rng.standard_normal(len(t))
    return Recording(f"{kind} {seed}", t, x, f, source=f"generated {seed}")


def _motion(kind: str, rng: np.random.Generator, t: Array) -> Array:
    """In strokes of some 1."""
    if kind == "noise":
        return _smooth(rng.standard_normal(len(t)), len(t) / t[-1] * rng.uniform(0.0, 0.3))
    edges_s = np.cumsum(rng.uniform(0.3, 2.5, 200))
    levels = rng.uniform(-1.0, 1.0, 201)
    if kind == "steps":
        return np.asarray(levels[np.searchsorted(edges_s, t)])
    if kind == "ramps":
        return np.interp(t, edges_s, levels[1:])
    # strokes of least jerk with rests between them; in free motion with tremor
    after = np.searchsorted(edges_s, t)
    start_s, stop_s = (np.concatenate(([0.0], edges_s))[after + i] for i in (0, 1))
    part = np.clip((t - start_s) / (0.7 * (stop_s - start_s)), 0.0, 1.0)
    stroke = part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
    tremor = 0.01 * np.sin(2 * np.pi * rng.uniform(6, 10) * t) * (kind == "free motion")
    return np.asarray(levels[after] + (levels[after + 1] - levels[after]) * stroke + tremor)


def _smooth(white: Array, samples: float) -> Array:
    """White noise, or, with more than a sample, through a window of that length; rms 1."""
    window = np.hanning(int(samples) + 3)
    smooth = np.convolve(white, window, mode="same")
    return np.asarray(smooth / np.sqrt(np.mean(smooth**2)))


def _pulses(rng: np.random.Generator, t: Array, size_n: float) -> Array:
    at_s, width_s = rng.uniform(0.0, t[-1], 8), rng.uniform(0.1, 0.6, 8)
    pulses = np.exp(-(((t[:, None] - at_s) / width_s) ** 2))
    return np.asarray(pulses @ rng.uniform(-size_n, size_n, 8))


# --- scores ---


@dataclass(frozen=True, slots=True)
class Row:
    """One method on one recording; `us`: processor time in us for each of its samples."""

    kind: str
    recording: str
    delay_s: float
    method: str
    rms_n: float | None
    ratio: float | None
    offset_s: float | None
    diverged_at_s: float | None
    coverage_95: float | None
    us: float


def scored(
    kind: str, name: str, prepared: Prepared, methods: Sequence[str], networks: OfflineNetworks
) -> list[Row]:
    """A row for each method, each from a cold start."""
    recording, zoh = prepared.recording, prepared.zoh
    zoh_n = score(recording.time_s, prepared.force_n, zoh, zoh, prepared.rows).size.rms_n
    rows = list[Row]()
    for method in methods:
        candidates = list[Row]()
        for each in made(method, name, prepared, networks):
            start_s = time.process_time()
            trace = replay(recording, prepared.arrivals, each)
            us = 1e6 * (time.process_time() - start_s) / len(recording)
            found = score(recording.time_s, prepared.force_n, trace, zoh, prepared.rows)
            rms_n = found.size.rms_n
            relative = rms_n / zoh_n if rms_n is not None and zoh_n else None
            outcome = rms_n, relative, found.offset_s, found.diverged_at_s, found.band.coverage
            candidates.append(Row(kind, name, prepared.delay_s, method, *outcome, us))
        rows.append(min(candidates, key=_size))
    return rows


# --- tables ---


def _cell(row: Row) -> str:
    if row.method == "zoh":
        return quantity(row.rms_n, "N")
    return "diverged" if row.diverged_at_s is not None else ratio(row.ratio)


def _summary(table: Table, rows: Sequence[Row], methods: Sequence[str], beyond: int) -> None:
    """Below the recordings of a table; `beyond`: its columns after those of the methods."""
    of = {name: [row for row in rows if row.method == name] for name in methods}
    for head, figure in (
        ("geometric mean", _geometric_mean),
        ("worst", _worst),
        ("time offset, median", _offset),
        ("forefeel better (sign test)", lambda rows: sign_test(of.get("forefeel", []), rows)),
        ("by instrument", lambda rows: sign_test(of.get("forefeel", []), rows, instrument)),
        ("95 % band holds 93 to 97 %", _in_band),
        ("processor time, µs a sample", lambda rows: f"{np.median([row.us for row in rows]):.0f}"),
    ):
        table.add([f"**{head}**", *(figure(of[name]) for name in methods), *[""] * beyond])


def _geometric_mean(rows: Sequence[Row]) -> str:
    known = [row.ratio for row in rows if row.ratio]
    lost = len(rows) - len(known)
    return ratio(exp(np.mean(np.log(known))) if known else None) + (f" of {len(known)}" if lost else "")


def _worst(rows: Sequence[Row]) -> str:
    return ratio(max((_size(row) for row in rows), default=None))


def _size(row: Row) -> float:
    """The ratio; a method that diverged is infinitely off, and 0/0 is as good."""
    if row.diverged_at_s is not None:
        return inf
    return 1.0 if row.ratio is None else row.ratio


def _offset(rows: Sequence[Row]) -> str:
    known = [row.offset_s for row in rows if row.offset_s is not None]
    return offset_text(float(np.median(known)) if known else None)


def sign_test(
    ours: Sequence[Row], theirs: Sequence[Row], unit: Callable[[str], str] = lambda recording: recording
) -> str:
    """On how many units ours is better, and the two-sided p of a paired sign test; a unit of several
    recordings counts by the geometric mean of the ratio of both.
    """
    units = dict[str, list[float]]()
    for mine, other in zip(ours, theirs, strict=False):
        if mine.method != other.method:
            gain = log(max(_size(other), _LEAST)) - log(max(_size(mine), _LEAST))
            units.setdefault(unit(mine.recording), []).append(gain)
    gains = [float(np.mean(each)) for each in units.values() if np.mean(each) != 0.0]
    if not gains:
        return "-"
    n, better = len(gains), sum(gain > 0.0 for gain in gains)
    p = min(1.0, 2.0 * sum(comb(n, k) for k in range(max(better, n - better), n + 1)) / 2.0**n)
    return f"{better} of {n}, p {p:.2g}"


def _in_band(rows: Sequence[Row]) -> str:
    known = [row.coverage_95 for row in rows if row.coverage_95 is not None]
    return f"{sum(0.93 <= share <= 0.97 for share in known)} of {len(known)}" if known else "-"


def compared(
    kind: str,
    delay_s: float,
    recordings: Mapping[str, tuple[Recording, str]],
    methods: Sequence[str],
    networks: OfflineNetworks,
) -> list[Row]:
    """Prints a table, a row as soon as it is known. `recordings`: with what stands in a last column."""
    heads = ["zoh (rms)" if name == "zoh" else name for name in methods]
    live = ["forefeel in the run, all / settled"] if kind == "demo world" else []
    print(f"\n{kind}, {1e3 * delay_s:g} ms: rms error / that of zoh\n")
    table, rows, skipped = Table(["", *heads, *live], ""), list[Row](), list[str]()
    for name, (recording, beside) in recordings.items():
        try:
            prepared = prepare(recording, DelayedLink(delay_s))
        except RecordingError as error:
            skipped.append(f"{name}: {str(error).rpartition(': ')[2]}")
            continue
        rows += (found := scored(kind, name, prepared, methods, networks))
        table.add([name, *map(_cell, found), *[beside] * len(live)])
    if rows:
        _summary(table, rows, methods, len(live))
    for reason in skipped:
        table.line(f"\nleft out: {reason}")
    return rows


def stressed(
    seeds: range, delays_s: Sequence[float], methods: Sequence[str], networks: OfflineNetworks
) -> list[Row]:
    """Prints the worst of the generated recordings, and how many are worse than zoh by 5 and 10 %."""
    rows = list[Row]()
    for seed in seeds:
        recording = generated(seed)
        for delay_s in delays_s:
            prepared = prepare(recording, DelayedLink(delay_s))
            rows += scored("generated", recording.name, prepared, methods, networks)
    print(f"\n{len(seeds)} generated recordings: rms error / that of zoh\n")
    table = Table(["delay", "", *methods], "")
    for group in dict.fromkeys(map(_group, delays_s)):
        inside = [row for row in rows if group == _group(row.delay_s)]
        of = [[row for row in inside if row.method == name] for name in methods]
        table.add([group, "worst", *map(_worst_of, of)])
        for limit in (1.05, 1.1):
            table.add([group, f"above {limit:g}", *(sum(_size(row) > limit for row in each) for each in of)])
    return rows


def ablated(delay_s: float, worlds: Mapping[str, Mapping[str, Recording]]) -> list[Row]:
    """Prints a table of the geometric means on each world's recordings, a row for each part left out."""
    prepared = {
        world: {
            name: prepare(each, DelayedLink(delay_s))
            for name, each in recordings.items()
            if each.force_n is not None
        }
        for world, recordings in worlds.items()
    }
    print(f"\nablation, {1e3 * delay_s:g} ms: rms error / that of zoh, geometric mean (worst)\n")
    table, rows = Table(["", *worlds], ""), list[Row]()
    for variant, context in VARIANTS.items():
        cells = list[str]()
        for world, recordings in prepared.items():
            with context():
                found = [
                    replace(row, method=variant)
                    for name, each in recordings.items()
                    for row in scored(world, name, each, ["forefeel"], OfflineNetworks({}))
                ]
            cells.append(f"{_geometric_mean(found)} ({_worst(found)})")
            rows += found
        table.add([variant, *cells])
    return rows


def _group(delay_s: float) -> str:
    return "100 to 500 ms" if 0.1 <= delay_s <= 0.5 else f"{1e3 * delay_s:g} ms"


def _worst_of(rows: Sequence[Row]) -> str:
    worst = max(rows, key=_size)
    return f"{ratio(_size(worst))} ({worst.recording})"


# --- command ---


def _methods(text: str) -> str:
    if text not in ALL:
        raise argparse.ArgumentTypeError(f"{text!r}: expected some of {', '.join(ALL)}")
    return text


def _delay(text: str) -> float:
    """s, from ms."""
    return DelayedLink(1e-3 * float(text)).delay_s


def main(words: Sequence[str]) -> list[Row]:
    """Prints the tables, and returns what they hold."""
    data = os.environ.get("FOREFEEL_DATA")
    parser = argparse.ArgumentParser(prog="python -m benchmarks.prediction")
    parser.add_argument("--data", type=Path, default=Path(data) if data else None, help="recordings as CSV")
    parser.add_argument("--delays", type=listed(_delay), default="20,100,300,500,700", help="in ms")
    parser.add_argument("--methods", type=listed(_methods), default=",".join(ALL))
    parser.add_argument(
        "--demo", type=int, nargs="*", default=[1], metavar="SEED", help="none: no demo world"
    )
    parser.add_argument("--generated", type=int, default=0, metavar="N", help="recordings to generate")
    parser.add_argument(
        "--first-seed", type=int, default=0, metavar="SEED", help="of those, one after another"
    )
    parser.add_argument("--ablation", action="store_true", help="of forefeel alone")
    parser.add_argument("--json", type=Path, metavar="FILE", help="the figures, too")
    asked = parser.parse_args(words)
    recordings = {} if asked.data is None else measured(asked.data)
    methods = [
        name for name in asked.methods if _installed(name) and (recordings or name != "offline_network")
    ]
    networks = OfflineNetworks(recordings)
    rows = list[Row]()
    for delay_s in asked.delays:
        runs = {f"{p} {seed}": demo(p, seed, delay_s) for p in _DEMO for seed in asked.demo}
        if asked.ablation:
            worlds = {"recordings": recordings, "demo world": {n: run for n, (run, _) in runs.items()}}
            rows += ablated(delay_s, {world: each for world, each in worlds.items() if each})
            continue
        if recordings:
            rows += compared(
                "recordings", delay_s, {n: (r, "") for n, r in recordings.items()}, methods, networks
            )
        if runs:
            rows += compared("demo world", delay_s, runs, methods, networks)
    if asked.generated:
        seeds = range(asked.first_seed, asked.first_seed + asked.generated)
        rows += stressed(seeds, asked.delays, methods, networks)
    if asked.json is not None:
        asked.json.write_text(json.dumps({"rows": [asdict(row) for row in rows]}, indent=1) + "\n")
    return rows


def _installed(name: str) -> bool:
    package = {**PEERS, **PUBLISHED}.get(name, ("numpy", None))[0]
    if find_spec(package) is not None:
        return True
    print(f"{name}: {package} is not installed (pip install 'forefeel[bench]')")
    return False


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except InputError as error:
        print(f"python -m benchmarks.prediction: {error}", file=sys.stderr)
        sys.exit(2)
