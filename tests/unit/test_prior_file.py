"""Priors as files: what is written, merged, handed to another patient, and refused."""

import json
import os
import stat
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import pytest

from forefeel.common.errors import ConfigurationError, RunError
from forefeel.common.estimation.contact_prior import ContactPrior, widened
from forefeel.common.prior_file import StoredPrior, keep_prior, load_prior, nearest, prior_path
from tests.unit.failing import refusing

SPRING, CONTACT = "mass_damper_spring.stiffness_n_m", "contact_loss.contact_position_m"
DAY = date(2025, 3, 1)
LEARNED = ContactPrior((SPRING, CONTACT), (7.5, 0.008), ((0.01, 1e-6), (1e-6, 1e-8)), 12.0)


def keep(folder: Path, patient: str = "A", learned: ContactPrior = LEARNED, day: date = DAY) -> StoredPrior:
    return keep_prior(folder, "catheter", patient, learned, day)


def test_own_prior_comes_back_with_the_spread_of_a_session(tmp_path: Path) -> None:
    stored = keep(tmp_path)
    assert load_prior(tmp_path / "catheter" / "A.json") == stored
    found = nearest(tmp_path, "catheter", "A")
    assert found is not None
    assert found.prior.names == LEARNED.names
    assert found.prior.values == pytest.approx(LEARNED.values)
    expected = widened(LEARNED, 1.0).standard_deviations
    assert found.prior.standard_deviations == pytest.approx(expected)
    assert found.origin == "catheter, patient A: 1 session, 12 s of contact"


def test_another_patient_starts_from_the_newest_widened_another_instrument_from_none(tmp_path: Path) -> None:
    keep(tmp_path, "old", day=date(2024, 1, 1))
    newest = keep(tmp_path, "new", ContactPrior((SPRING,), (3.0,), ((0.01,),), 8.0)).prior()
    keep_prior(tmp_path, "guidewire", "C", LEARNED, date(2026, 1, 1))
    found = nearest(tmp_path, "catheter", "B")
    assert found is not None
    assert found.prior.values == newest.values
    assert found.prior.standard_deviations[0] > widened(newest, 1.5).standard_deviations[0]
    assert found.origin == "catheter, of another patient, new: 1 session, 8 s of contact"
    assert found.patient == "new"
    assert nearest(tmp_path, "stent", "A") is nearest(tmp_path / "none", "catheter", "A") is None


def test_next_session_takes_the_place_of_what_it_started_from(tmp_path: Path) -> None:
    keep(tmp_path)
    later = ContactPrior((SPRING, CONTACT), (9.5, 0.010), ((0.01, 0.0), (0.0, 1e-8)), 20.0)
    both = keep(tmp_path, learned=later, day=date(2025, 3, 2))
    assert (both.sessions, both.contact_s, both.date) == (2, 20.0, date(2025, 3, 2))
    assert (both.names, both.values, both.covariance) == (later.names, later.values, later.covariance)


def test_file_and_folders_are_for_the_owner_alone(tmp_path: Path) -> None:
    folder = tmp_path / "priors"
    before = os.umask(0)
    try:
        keep(folder)
    finally:
        os.umask(before)
    modes = [stat.S_IMODE(path.stat().st_mode) for path in (folder, *sorted(folder.rglob("*")))]
    assert modes == [0o700, 0o700, 0o600]


@pytest.mark.parametrize("fails", ["replace", "fsync"])
def test_broken_write_keeps_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fails: str) -> None:
    keep(tmp_path)
    path = tmp_path / "catheter" / "A.json"
    before = path.read_bytes()
    monkeypatch.setattr(os, fails, refusing(OSError(28, "No space left on device")))
    with pytest.raises(RunError, match=r"A\.json: No space left on device"):
        keep(tmp_path)
    assert list(path.parent.iterdir()) == [path]
    assert path.read_bytes() == before


@pytest.mark.parametrize("key", ["", "a.b", "a/b", "..", "a\n", "ä", "x" * 65])
def test_key_of_other_characters_is_refused(tmp_path: Path, key: str) -> None:
    with pytest.raises(ConfigurationError, match="instrument"):
        prior_path(tmp_path, key, "A")
    with pytest.raises(ConfigurationError, match="patient"):
        prior_path(tmp_path, "catheter", key)


def changed(**fields: Any) -> Callable[[dict[str, Any]], str]:  # noqa: ANN401 - any JSON
    return lambda document: json.dumps({**document, **fields})


SPOILED: dict[str, Callable[[dict[str, Any]], str]] = {
    "half of it": lambda document: json.dumps(document)[:80],
    "empty": lambda _: "",
    "a list": lambda _: "[]",
    "brackets": lambda _: "[" * 100_000,
    "large": lambda document: json.dumps(document) + " " * 300_000,
    "foreign": changed(schema="forefeel.model/1"),
    "another patient": changed(patient="B"),
    "a key of its own": changed(colour="red"),
    "nan": changed(values=[float("nan"), 0.008]),
    "beyond any float": changed(values=[10**400, 0.008]),
    "text": changed(values=["soft" * 10_000, 0.008]),
    "one value": changed(values=[7.5]),
    "a name twice": changed(names=[SPRING, SPRING]),
    "asymmetric": changed(covariance=[[1.0, 0.5], [0.1, 1.0]]),
    "indefinite": changed(covariance=[[1.0, 2.0], [2.0, 1.0]]),
    "infinite": changed(covariance=[[float("inf"), 0.0], [0.0, 1.0]]),
    "not square": changed(covariance=[[1.0, 0.0]]),
    "no time": changed(contact_s=-1.0),
}


@pytest.mark.parametrize("spoil", SPOILED.values(), ids=SPOILED)
def test_spoiled_file_is_refused_and_kept(tmp_path: Path, spoil: Callable[[dict[str, Any]], str]) -> None:
    keep(tmp_path)
    path = tmp_path / "catheter" / "A.json"
    text = spoil(json.loads(path.read_text()))
    path.write_text(text)
    for act in (lambda: nearest(tmp_path, "catheter", "A"), lambda: keep(tmp_path)):
        with pytest.raises(ConfigurationError) as refused:
            act()
        assert str(refused.value).startswith(f"{path}: ")
        assert "\n" not in str(refused.value)
        assert len(str(refused.value)) < len(str(path)) + 300
    assert path.read_text() == text
