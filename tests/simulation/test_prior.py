"""A run keeps what it learned, and the next one with the same instrument and patient starts from it."""

from pathlib import Path
from typing import Any

from forefeel.common.prior_file import load_prior
from forefeel.loopback.plan import LoopbackOptions, make_plan
from forefeel.report.model import RunReport
from forefeel.report.summary import summarise
from tests.looped import recorded


def run(folder: Path, seed: int, **changed: Any) -> RunReport:  # noqa: ANN401 - options
    asked = {"duration_s": 10.0, "patient": "B", **changed}
    options = LoopbackOptions(impairment="paper", seed=seed, prior_dir=folder / "priors", **asked)
    return summarise(recorded(make_plan(options), folder / f"{seed}.mcap", seed))


def test_second_run_starts_from_the_first_and_predicts_from_the_first_stroke_on(tmp_path: Path) -> None:
    cold = run(tmp_path, 1)
    assert cold.model.prior == "none yet of catheter"
    stored = load_prior(tmp_path / "priors" / "catheter" / "B.json")
    assert stored is not None
    assert stored.contact_s > 5.0
    taught = run(tmp_path, 2, duration_s=4.0)
    assert taught.model.prior == f"catheter, patient B: {stored.amount}"
    assert ratio(taught) < 0.25 < 0.6 * ratio(cold)
    for accept_prior, begins in ((False, "none; to start from"), (True, "catheter, of another patient, B")):
        other = run(tmp_path, 3 + accept_prior, duration_s=1.0, patient="C", accept_prior=accept_prior)
        assert other.model.prior is not None and other.model.prior.startswith(begins)


def ratio(report: RunReport) -> float:
    assert report.prediction.rms_n is not None
    assert report.zoh.rms_n is not None
    return report.prediction.rms_n / report.zoh.rms_n
