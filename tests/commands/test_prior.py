"""`forefeel prior` as a person uses it."""

import json
from collections.abc import Callable, Sequence
from datetime import date
from pathlib import Path

import pytest

from forefeel.common.estimation.contact_prior import ContactPrior
from forefeel.common.prior_file import keep_prior

Run = Callable[[Sequence[str]], int]
LEARNED = ContactPrior(("mass_damper_spring.stiffness_n_m",), (7.5,), ((0.01,),), 12.0)


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
    assert run(["prior", "list", "--dir", "none"]) == 2
