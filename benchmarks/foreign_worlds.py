"""Prediction and felt force in worlds that are not ours, by the delay: `python -m benchmarks.foreign_worlds`.

MuJoCo's `coronary` and `arch`, and our own catheter and guidewire beside them. Of each pair of seeds the
first gives a session that knows nothing, the second one that starts with the first one's prior. 60 s each in
virtual time, over the paper's impairment at that round trip, with a jitter of 5 % and .5 % lost each way.

A row is a world, a round trip, and either the cold sessions or those with a prior: mean / worst of the pairs.
Prediction is its rms error over the late force's; unnoticeable and offset are by the twin, and as measured
(`forefeel.report.transparency`); energy is the lowest that the hand has put into the handle.

`--quick`: one pair at 100 and 300 ms. `--keep FOLDER`: the recordings stay there; those that are there
already are judged and not run again. A session takes 20 to 40 s of one core: all of it some 50 minutes.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from benchmarks.links import listed
from benchmarks.markdown import Table
from forefeel.common.errors import InputError
from forefeel.common.recording.mcap_reader import Run
from forefeel.loopback.plan import LoopbackOptions, make_plan
from forefeel.loopback.virtual import VirtualLoopback
from forefeel.report.model import RunReport
from forefeel.report.summary import summarise
from forefeel.report.transparency import Transparency

FOREIGN, OURS = ("coronary", "arch"), ("catheter", "guidewire")
_DURATION_S = 60.0
_JITTER, _LOSS = 0.05, 0.005  # shares of the delay, and of the messages, each way
_BAND = 0.95
KINDS = "cold", "prior"


class Column(NamedTuple):
    """`badness`: the larger, the worse; `factor`, `places`: of what is shown."""

    head: str
    value: Callable[[RunReport], float | None]
    badness: Callable[[float], float]
    factor: float = 1.0
    places: int = 0


def _twin(report: RunReport) -> Transparency:
    return report.transparency or Transparency()


def _measured(report: RunReport) -> Transparency:
    return report.transparency_as_measured or Transparency()


def _less(value: float) -> float:
    return -value


COLUMNS = (
    Column("prediction / zoh", lambda report: report.ratio, float, places=3),
    Column("unnoticeable, %", lambda report: _twin(report).within_jnd, _less, 100.0, 1),
    Column("as measured, %", lambda report: _measured(report).within_jnd, _less, 100.0, 1),
    Column("felt / late", lambda report: _twin(report).ratio, float, places=3),
    Column("as measured", lambda report: _measured(report).ratio, float, places=3),
    Column("offset, ms", lambda report: _twin(report).offset_s, abs, 1e3, 1),
    Column("as measured, ms", lambda report: _measured(report).offset_s, abs, 1e3, 1),
    Column(
        "in the 95 % band, %", lambda report: report.predictor.coverage_95, lambda c: abs(c - _BAND), 100.0, 1
    ),
    Column("lowest energy, mJ", lambda report: report.hand_lowest_energy_j, _less, 1e3, 2),
    Column("stops", lambda report: report.stops, float),
    Column("armed, %", lambda report: report.armed_share, _less, 100.0, 1),
)


def session(world: str, delay_s: float, seed: int, folder: Path, kind: str) -> RunReport:
    """Report of one session, which is recorded in `folder` unless it is there; it loads and keeps its prior
    there.
    """
    path = folder / f"{kind}.mcap"
    if not path.exists():
        preset, world_of_others = (None, world) if world in FOREIGN else (world, None)
        plan = make_plan(
            LoopbackOptions(
                seed,
                preset=preset,
                world=world_of_others,
                duration_s=_DURATION_S,
                prior_dir=folder / "prior",
            )
        )
        one_way_s = delay_s / 2
        link = {
            "preset": "paper", "delay_s": one_way_s, "jitter_s": _JITTER * one_way_s, "loss": _LOSS,
        }  # fmt: skip
        for end in plan.slave, plan.master:
            end["impairment"] = {"inbound": link, "seed": seed}
        loop = VirtualLoopback(plan, seed)
        loop.run(lambda _done_s: None)
        partial = path.with_suffix(".partial")
        loop.write(partial)
        partial.rename(path)
    return summarise(Run(path))


def cells(reports: Sequence[RunReport]) -> list[str]:
    """Mean and worst of each column; a dash where a session has no value."""
    return [_cell(column, [column.value(report) for report in reports]) for column in COLUMNS]


def _cell(column: Column, values: Iterable[float | None]) -> str:
    known = [value for value in values if value is not None]
    if not known:
        return "-"
    mean, worst = sum(known) / len(known), max(known, key=column.badness)
    shown = (round(column.factor * value, column.places) + 0.0 for value in (mean, worst))  # no minus zero
    return " / ".join(f"{value:.{column.places}f}" for value in shown)


def _pair(text: str) -> tuple[int, int]:
    cold, prior = text.split("/")
    return int(cold), int(prior)


def main(words: Sequence[str]) -> None:
    """Prints the table, two rows as soon as they are known."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.foreign_worlds")
    parser.add_argument("--worlds", type=listed(str), default=",".join((*FOREIGN, *OURS)))
    parser.add_argument("--delays", type=listed(float), default="20,100,300,600", help="round trips in ms")
    parser.add_argument("--pairs", type=listed(_pair), default="1/2,3/4,5/6", help="seeds: cold/prior")
    parser.add_argument("--quick", action="store_true", help="--delays 100,300 --pairs 1/2")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="for the recordings")
    parser.add_argument("--json", type=Path, metavar="FILE", help="the figures, too")
    asked = parser.parse_args(words)
    if asked.quick:
        asked.delays, asked.pairs = [100.0, 300.0], [(1, 2)]
    start_s, rows = time.process_time(), list[dict[str, object]]()
    with TemporaryDirectory() as made:
        kept = asked.keep or Path(made)
        table = Table(["world", "ms", "", *(column.head for column in COLUMNS)], "")
        for world, delay_ms in product(asked.worlds, asked.delays):
            reports: dict[str, list[RunReport]] = {kind: [] for kind in KINDS}
            for seeds in asked.pairs:
                folder = kept / f"{world}-{delay_ms:g}-{seeds[0]}"
                folder.mkdir(parents=True, exist_ok=True)
                for kind, seed in zip(KINDS, seeds, strict=True):
                    report = session(world, 1e-3 * delay_ms, seed, folder, kind)
                    reports[kind].append(report)
                    values = {column.head: column.value(report) for column in COLUMNS}
                    rows.append({"world": world, "delay_ms": delay_ms, "kind": kind, "seed": seed, **values})
            for kind in KINDS:
                table.add([world, f"{delay_ms:g}", kind, *cells(reports[kind])])
    print(f"\n{len(rows)} sessions of {_DURATION_S:g} s, {time.process_time() - start_s:.0f} s of one core")
    if asked.json is not None:
        asked.json.write_text(json.dumps({"rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except InputError as error:
        print(f"python -m benchmarks.foreign_worlds: {error}", file=sys.stderr)
        sys.exit(2)
