"""`forefeel prior` as a person uses it."""

import json
from collections.abc import Callable, Sequence
from datetime import date
from pathlib import Path

import pytest

from forefeel.common.estimation.contact_prior import ContactPrior
from forefeel.common.prior_file import keep_prior
from tests.commands.command_line import refused

Run = Callable[[Sequence[str]], int]
LEARNED = ContactPrior(("mass_damper_spring.stiffness_n_m",), (7.5,), ((0.01,),), 12.0)
OF_B = ["--instrument", "catheter", "--patient", "B"]


@pytest.fixture(autouse=True)
def priors(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.chdir(tmp_path)
    for patient in "AB":
        keep_prior(tmp_path / "priors", "catheter", patient, LEARNED, date(2025, 3, 1))
    return tmp_path / "priors" / "catheter"


def test_list_shows_each_and_names_the_spoiled(
    run: Run, capsys: pytest.CaptureFixture[str], priors: Path
) -> None:
    (priors / "A.json").write_text("{")
    assert run(["prior", "list", "--dir", "priors", "--json"]) == 0
    shown = capsys.readouterr()
    expected = {
        "instrument": "catheter",
        "patient": "B",
        "date": "2025-03-01",
        "contact_s": 12.0,
        "sessions": 1,
    }
    assert json.loads(shown.out) == [expected]
    assert shown.err.count("\n") == 1
    assert "A.json" in shown.err
    assert run(["prior", "list", "--dir", "priors"]) == 0
    assert "2025-03-01" in capsys.readouterr().out


def test_show_gives_values_with_deviations(run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["prior", "show", "--dir", "priors", *OF_B, "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)["parameters"]
    assert (found["name"], found["value"]) == (LEARNED.names[0], 7.5)
    assert found["standard_deviation"] == pytest.approx(0.1)


def test_forget_removes_one_and_then_refuses(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, priors: Path
) -> None:
    (priors / "B.json").write_text("spoiled")
    assert run(["prior", "forget", "--dir", "priors", *OF_B]) == 0
    assert [path.name for path in priors.iterdir()] == ["A.json"]
    capsys.readouterr()
    for command in ("forget", "show"):
        line = f"prior {command} --dir priors {' '.join(OF_B)}"
        refused(run, capsys, tmp_path, line, ("B.json", "No such file"), {})


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("prior list --dir none", ("--dir none", "folder")),
        ("prior forget --dir priors --instrument ../priors --patient B", ("instrument = '../priors'",)),
        ("prior show --dir priors --instrument catheter --patient B.json", ("patient = 'B.json'",)),
        ("prior forget --dir priors --instrument catheter", ("--patient",)),
    ],
)
def test_bad_input_is_one_line(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, line: str, words: tuple[str, ...]
) -> None:
    refused(run, capsys, tmp_path, line, words, {})
