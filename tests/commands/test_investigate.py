"""`forefeel investigate` as a person uses it."""

import json
import shlex
from dataclasses import replace

import pytest

from forefeel.common.recording.loading import load_recording
from tests.commands.command_line import ROOT, contents
from tests.commands.conftest import Shell
from tests.unit.asked_bench import LIMITS, recorded, stroke
from tests.unit.diagnosis_samples import put
from tests.unit.evaluation_samples import csv_text

BOUNDS = "--workspace 0,0.02 --max-speed 0.05 --max-acceleration 1 --seconds 10"
QUESTION = {"motion.csv", "question.json", "question.html"}


def test_question_gives_a_motion_and_the_command_that_judges_its_answer(shell: Shell) -> None:
    put(shell.folder / "run.csv", recorded(stroke()))
    out = shell.folder / "run-asked"
    shown = shell(f"investigate run.csv {BOUNDS}")
    assert shown.code == 0
    assert {path.name for path in out.iterdir()} == QUESTION
    asked = json.loads((out / "question.json").read_text())
    assert (asked["question"]["verdict"], asked["answer"]) == ("not_separable", None)
    path = load_recording(out / "motion.csv").position_m
    assert LIMITS.low_m <= path.min() < path.max() <= LIMITS.high_m
    answer = recorded(path, seed=2)
    put(shell.folder / "answer.csv", answer)
    command = shlex.split(shown.err.partition("with the answer: ")[2])
    shown = shell([*command[1:], "--json"])
    assert shown.code == 0
    assert {path.name for path in out.iterdir()} == QUESTION | {"model.yaml", "answer.json", "answer.html"}
    judged = json.loads(shown.out)
    assert judged == json.loads((out / "answer.json").read_text())
    assert [cause["name"] for cause in judged["answer"]["causes"]] == ["coulomb_friction"]
    assert judged["confirmation"]["verdict"] == "confirmed"
    before = contents(out)
    put(shell.folder / "um.csv", replace(answer, position_m=1e6 * answer.position_m))
    shown = shell(f"investigate run.csv um.csv --out {out} --overwrite")
    assert shown.code == 2
    assert "um.csv: position_m spans " in shown.err
    assert contents(out) == before


GOOD = csv_text(recorded(stroke()))
SLAVE = "role: slave\naxes: [{name: insertion, limits: {workspace_m: [0.0, 0.02]}}]\n"
MASTER = (ROOT / "deploy/config/master.yaml").read_text()
BAD = {
    "no recording": ("", ("expected a recording, or --config FILE",)),
    "third": ("@/a.csv @/b.csv @/c.csv", ("c.csv: a third recording",)),
    "one end": ("@/a.csv --workspace 0.03", ("--workspace 0.03: expected two numbers in m",)),
    "falling": ("@/a.csv --workspace 0.03,0", ("0.03,0: expected two numbers in m",)),
    "answer, bench": ("@/a.csv @/b.csv --config @/slave.yaml --virtual-time", ("b.csv: expected no",)),
    "beyond": ("--config @/slave.yaml --virtual-time --max-force 9", ("force_n = 9: expected within 3",)),
    "range beyond": ("--config @/slave.yaml --virtual-time --workspace 0,1", ("high_m = 1", "within 0.02")),
    "master simulated": ("--config @/master.yaml --virtual-time", ("master.yaml", "expected 'slave'")),
    "slave live": ("--config @/slave.yaml", ("slave.yaml", "expected 'master'")),
    "no such axis": ("--config @/slave.yaml --virtual-time --axis x", ("expected one of insertion",)),
}  # fmt: skip


@pytest.mark.parametrize(("arguments", "words"), BAD.values(), ids=BAD)
def test_bad_input_is_one_line(shell: Shell, arguments: str, words: tuple[str, ...]) -> None:
    files = {f"{name}.csv": GOOD for name in "abc"}
    files |= {"slave.yaml": SLAVE, "master.yaml": MASTER}
    shell.refused(f"investigate {arguments} --out @/out", words, files)
