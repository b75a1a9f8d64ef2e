"""Command line of a generator: `write` recordings, `ask` about them, `score` the answers."""

import argparse
import json
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from tests.hidden_effects.laboratory.score import judge, shares, table
from tests.hidden_effects.laboratory.truth import Recorded


def main(
    program: str, kinds: Sequence[str], draw: Callable[[str, int], Recorded], arguments: Sequence[str] | None
) -> int:
    """Always 0: this measures, it demands nothing.

    `kinds` are written in turn; one that stands there more than once has the next seed each time.
    """
    options = _options(program, arguments)
    folders = sorted(path.parent for path in options.folder.glob("*/truth.json"))
    if options.command == "write":
        drawn: Counter[str] = Counter()
        for i in range(options.count):
            kind = kinds[i % len(kinds)]
            seed = options.seed + drawn[kind]
            drawn[kind] += 1
            written(options.folder / f"{i:04d}_{kind}_{seed}", draw(kind, seed))
    elif options.command == "ask":
        from tests.hidden_effects.laboratory.ask import answers  # imports the product

        found = json.loads(options.answers.read_text()) if options.answers.exists() else []
        known = {answer["name"] for answer in found}
        left = [folder for folder in folders if folder.name not in known]
        for answer in answers(left, options.jobs, options.product):
            found.append(answer)
            options.answers.write_text(json.dumps(found, indent=1))
    else:
        told = {answer["name"]: answer for answer in json.loads(options.answers.read_text())}
        pairs = [(_truth(folder), told[folder.name]) for folder in folders if folder.name in told]
        judged = [judge(truth, answer) for truth, answer in pairs]
        print(f"{shares(judged)}\n\n{table(judged)}")
    return 0


def written(folder: Path, recorded: Recorded) -> None:
    """Makes a.csv and b.csv of both motions, clean.npz of their clean forces, and truth.json."""
    folder.mkdir(parents=True)
    second = recorded.second
    assert second is not None
    for name, run in (("a", recorded), ("b", second)):
        scale = 1e3 if "mm" in run.header[1] else 1.0
        columns = np.column_stack([run.time_s, run.position * scale, run.force, *run.further.values()])
        head = ",".join([*run.header, *run.further])
        np.savetxt(folder / f"{name}.csv", columns, "%.10g", delimiter=",", header=head, comments="")
    np.savez(folder / "clean.npz", a=recorded.force_clean, b=second.force_clean)
    travel = float(np.ptp(recorded.position))
    (folder / "truth.json").write_text(json.dumps({**asdict(recorded.truth), "travel": travel}, indent=1))


def _truth(folder: Path) -> dict[str, Any]:
    truth: dict[str, Any] = json.loads((folder / "truth.json").read_text())
    return truth


def _options(program: str, arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog=f"python -m {program}", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    write = commands.add_parser("write", help="recordings and their truth")
    write.add_argument("folder", type=Path)
    write.add_argument("--seed", type=int, default=0, help="first seed of each kind")
    write.add_argument("--count", type=int, default=200)
    ask = commands.add_parser("ask", help="diagnose every a.csv that has no answer yet")
    ask.add_argument("folder", type=Path)
    ask.add_argument("answers", type=Path)
    ask.add_argument("--jobs", type=int, default=1, help="processes")
    ask.add_argument("--product", type=Path, help="checkout to ask, in place of the importable one")
    score = commands.add_parser("score", help="table of answers")
    score.add_argument("folder", type=Path)
    score.add_argument("--answers", type=Path, required=True)
    return parser.parse_args(arguments)
