"""What a session starts from, and when what it learned is kept."""

from datetime import date
from math import nan
from pathlib import Path

import pytest

from forefeel.common.estimation.contact_prior import ContactPrior
from forefeel.common.estimation.learner import Learner
from forefeel.common.prior_file import load_prior
from forefeel.master.prior import keep, load, objection, suspicion
from forefeel.master.settings import PredictionSettings

LEARNED = ContactPrior(("mass_damper_spring.stiffness_n_m",), (7.5,), ((0.01,),), 12.0)
DAY = date(2025, 3, 1)


class Session(Learner):
    """One that has predicted with this ratio, and learned this."""

    ratio, contact_s = 0.0, 12.0
    learned: ContactPrior | None = None

    def __init__(self, ratio: float, learned: ContactPrior | None = LEARNED) -> None:
        self.ratio, self.learned = ratio, learned


def wanted(folder: Path, patient: str = "A") -> PredictionSettings:
    return PredictionSettings(prior_dir=folder, instrument="catheter", patient=patient)


@pytest.mark.parametrize(
    ("contact_s", "faulted", "ratio", "word"),
    [
        (5.0, False, 0.5, None),
        (5.0, False, 1.0, None),
        (4.9, False, 0.5, "4.9 s of contact"),
        (5.0, True, 0.5, "fault"),
        (5.0, False, 1.1, "zero-order hold"),
        (5.0, False, nan, "zero-order hold"),
    ],
)
def test_objection(contact_s: float, faulted: bool, ratio: float, word: str | None) -> None:
    found = objection(contact_s, ratio, faulted)
    assert found is None if word is None else word in (found or "")


@pytest.mark.parametrize(("gain", "says"), [(1.0, ""), (1.5, ""), (2.0, "2 times"), (0.5, "0.5 times")])
def test_gain_off_by_two_is_a_suspicion(gain: float, says: str) -> None:
    """An offset of the cell counts for nothing."""
    names = "mass_damper_spring.stiffness_n_m", "coulomb_friction.force_n", "bias.force_n"
    covariance = (0.01, 5e-4, 0.0), (5e-4, 1e-4, 0.0), (0.0, 0.0, 1e-6)
    session = Session(0.5, ContactPrior(names, (7.5 * gain, 0.1 * gain, 0.3), covariance, 12.0))
    session.prior = ContactPrior(names, (7.5, 0.1, 0.0), covariance, 12.0)
    assert says in suspicion(session)
    assert bool(says) is bool(suspicion(session))


def test_what_one_session_keeps_the_next_starts_from(tmp_path: Path) -> None:
    assert load(wanted(tmp_path), False) == (None, "none yet of catheter")
    assert keep(wanted(tmp_path), Session(0.5), False, DAY).startswith("kept: catheter, patient A")
    own, origin = load(wanted(tmp_path), False)
    assert own is not None and own.values == pytest.approx(LEARNED.values)
    assert origin == "catheter, patient A: 1 session, 12 s of contact"
    cold, why = load(wanted(tmp_path, "B"), False)
    assert cold is None and "another patient, A" in why
    other, origin = load(wanted(tmp_path, "B"), True)
    assert other is not None and other.standard_deviations > own.standard_deviations
    assert origin.startswith("catheter, of another patient, A")


def test_bad_session_changes_nothing(tmp_path: Path) -> None:
    keep(wanted(tmp_path), Session(0.5), False, DAY)
    before = load_prior(tmp_path / "catheter" / "A.json")
    for bad, faulted in ((Session(0.5), True), (Session(1.5), False), (Session(0.5, None), False)):
        assert keep(wanted(tmp_path), bad, faulted, DAY).startswith("not kept: ")
    assert load_prior(tmp_path / "catheter" / "A.json") == before


def test_spoiled_file_is_a_cold_start_that_says_why(tmp_path: Path) -> None:
    path = tmp_path / "catheter" / "A.json"
    path.parent.mkdir()
    path.write_text("{")
    assert load(wanted(tmp_path), False) == (None, f"none, refused: {path}: not JSON; expected a prior")
    assert keep(wanted(tmp_path), Session(0.5), False, DAY).startswith(f"not kept: {path}: ")
    assert path.read_text() == "{"


def test_without_a_folder_nothing_is_kept(tmp_path: Path) -> None:
    nobody = PredictionSettings(instrument="catheter", patient="A")
    assert load(nobody, False) == (None, "")
    assert keep(nobody, Session(0.5), False, DAY) == ""
