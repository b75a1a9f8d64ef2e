"""A run keeps what it learned, and the next one with the same instrument and patient starts from it."""

from pathlib import Path

from forefeel.common.prior_file import load_prior
from forefeel.common.recording.mcap_reader import Run
from forefeel.loopback.plan import LoopbackOptions, make_plan
from forefeel.loopback.virtual import VirtualLoopback
from forefeel.report.model import RunReport
from forefeel.report.summary import summarise


def run(folder: Path, seed: int) -> RunReport:
    options = LoopbackOptions(
        impairment="paper", duration_s=12.0, seed=seed, prior_dir=folder / "priors", patient="B"
    )
    loop = VirtualLoopback(make_plan(options), seed)
    loop.run(lambda _done_s: None)
    path = folder / f"{seed}.mcap"
    loop.write(path)
    return summarise(Run(path))


def test_second_run_starts_from_the_first_and_predicts_from_the_first_stroke_on(tmp_path: Path) -> None:
    cold = run(tmp_path, 1)
    assert cold.model.prior == "none yet of catheter"
    stored = load_prior(tmp_path / "priors" / "catheter" / "B.json")
    assert stored is not None
    assert stored.contact_s > 5.0
    taught = run(tmp_path, 2)
    assert taught.model.prior == f"catheter, patient B: {stored.amount}"
    assert ratio(taught) < 0.25 < 0.6 * ratio(cold)


def ratio(report: RunReport) -> float:
    assert report.prediction.rms_n is not None
    assert report.zoh.rms_n is not None
    return report.prediction.rms_n / report.zoh.rms_n
