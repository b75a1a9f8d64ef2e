"""`python -m tests.hidden_effects.vessels`: `write` recordings, `ask` about them, `score` the answers."""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tests.hidden_effects.laboratory import command
from tests.hidden_effects.vessels.draw import FRICTION, KINDS, draw
from tests.hidden_effects.vessels.plain import COLUMNS, shares


def main(arguments: Sequence[str] | None = None) -> int:
    """Always 0: this measures, it demands nothing."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    command.main("tests.hidden_effects.vessels", tuple(KINDS), draw, given)
    if given[:1] == ["score"]:
        folder, answers = Path(given[1]), Path(given[given.index("--answers") + 1])
        print("\nfirst: friction along the path is the first name; then what least squares explains\n")
        print(*(_line(folder / said["name"], said) for said in json.loads(answers.read_text())), sep="\n")
    return 0


def _line(folder: Path, said: Mapping[str, Any]) -> str:
    """Names, the error that they explain on held-out blocks, and what plain laws explain of the force."""
    names = [cause["name"] for cause in said["causes"] if cause["name"] != "bias"]
    first = "first" if names[:1] and names[0] in FRICTION else "-"
    gain = f"{said['gain'][0]:.2f}" if said.get("gain") else "-"
    t, x, force_n = np.loadtxt(folder / "a.csv", delimiter=",", skiprows=1).T
    truth = json.loads((folder / "truth.json").read_text())
    inserted_m = next(value for _, name, value in truth["parameters"] if name == "inserted_m")
    explained = shares(t, 1e-3 * x, force_n, inserted_m)
    plain = ", ".join(f"{name} {explained[name]:.2f}" for name in COLUMNS)
    words = " + ".join(names) or ("suspected: " + ", ".join(map(str, said.get("suspected", []))))
    return f"{folder.name}: {said['verdict']}, {first}, gain {gain}, {words} | {plain}"


if __name__ == "__main__":
    sys.exit(main())
