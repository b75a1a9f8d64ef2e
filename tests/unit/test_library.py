"""The front of the library: its names, and what they give."""

import json
import sys
from dataclasses import FrozenInstanceError
from pathlib import Path

import numpy as np
import pytest

import forefeel as ff
from forefeel.common.codec import encode
from forefeel.common.errors import RecordingError
from forefeel.common.topics import SLAVE_STATE
from forefeel.common.transport.settings import TransportSettings
from forefeel.diagnosis.signals import Signals
from forefeel.estop.network import StopSender
from forefeel.library import PageFigure
from tests.messages import usual
from tests.unit.asked_bench import LIMITS, recorded, stroke
from tests.unit.diagnosis_samples import FRICTION_N, made, put

NAMES = {
    "Axis", "Cause", "Cell", "Confirmation", "Diagnosis", "Evaluation", "ForefeelError", "Investigation",
    "Limits", "Model", "Predictor", "Recording", "UnclearError", "__version__", "connect", "diagnose",
    "diagnose_folder", "evaluate", "investigate", "load",
}  # fmt: skip
NOTEBOOK = Path(__file__).parents[2] / "docs/examples/library.ipynb"


@pytest.fixture(scope="module")
def found() -> ff.Diagnosis:
    return ff.diagnose(made(friction_n=FRICTION_N))


def test_front_has_the_names_that_are_promised() -> None:
    assert set(ff.__all__) == NAMES == set(dir(ff))
    assert all(getattr(ff, name) is not None for name in NAMES)
    with pytest.raises(AttributeError, match="daignose"):
        _ = ff.daignose


def test_diagnosis_prints_verdict_cause_and_gain(found: ff.Diagnosis) -> None:
    assert (found.verdict, [cause.name for cause in found.causes]) == ("cause_found", ["coulomb_friction"])
    lines = str(found).splitlines()
    assert len(lines) <= 10
    assert [line.split(" ")[0] for line in lines[1:5]] == ["Verdict", "Simulation", "Cause", "Extended"]
    with pytest.raises(FrozenInstanceError):
        found.lines = ()  # type: ignore[misc]


def test_simulation_leaves_of_its_own_recording_what_the_answer_says() -> None:
    """A joint by its encoder, with jittered stamps that do not start at 0, whose torque is the reaction."""
    rng = np.random.default_rng(5)
    t = np.arange(1500) / 100.0 + np.clip(rng.normal(size=1500), -1.5, 1.5) * 1e-3
    x, v, a = np.zeros((3, len(t)))
    for hz, size in ((0.2, 0.8), (0.5, 0.3), (1.3, 0.05)):
        w = 2.0 * np.pi * hz
        x, v, a = x + size * np.sin(w * t), v + w * size * np.cos(w * t), a - w * w * size * np.sin(w * t)
    torque = 0.3 * a + 2.0 * v + 1.2 * np.sign(v) + 0.5 + 0.1 * rng.normal(size=len(t))
    joint = ff.Recording("joint", t + 100.0, np.round(x / 1e-4) * 1e-4, -torque, "joint")
    d = ff.diagnose(joint, as_is=True)
    assert "coulomb_friction" in [cause.name for cause in d.causes]
    left_n = joint.force_n - d.model.simulate(joint).force_n  # type: ignore[operator]
    in_band = Signals(joint, left_n, d.details.analysis.regression.signals.cutoff_hz, np.zeros(len(t), bool))
    rms_n = np.sqrt(np.mean(in_band.force[in_band.rows] ** 2))
    assert rms_n < 1.02 * d.details.analysis.residual_rms_n < 1.02 * d.details.diagnosis.held_out.rmse_after_n


def test_model_of_one_recording_is_confirmed_on_another(found: ff.Diagnosis) -> None:
    confirmation = found.confirm(made(6.0, friction_n=FRICTION_N, bias_n=0.3, name="other"))
    assert (confirmation.verdict, confirmation.ratio < 1.6) == ("confirmed", True)
    assert len(str(confirmation).splitlines()) <= 3


def test_motion_is_asked_for_and_its_answer_judged() -> None:
    asked = ff.investigate(ff.diagnose(recorded(stroke())), limits=LIMITS, seconds=10.0)
    assert "\nRivals      coulomb_friction: " in str(asked)
    answer = asked.judge(recorded(asked.motion.position_m, seed=2))
    assert [cause.name for cause in answer.causes] == ["coulomb_friction"]
    assert answer.confirmation is not None and answer.confirmation.verdict == "confirmed"
    assert "\nConfirmed " in str(answer)


def test_plot_shows_measured_simulated_and_extended_force(found: ff.Diagnosis) -> None:
    figure = found.plot()
    assert not isinstance(figure, PageFigure)
    above, below = figure.axes
    assert [line.get_label() for line in above.lines] == ["measured", "simulation", "extended"]
    simulated, extended = (np.std(line.get_ydata()) for line in below.lines)  # type: ignore[arg-type]
    assert extended < 0.2 * simulated


def test_evaluation_beats_the_newest_late_force() -> None:
    evaluation = ff.evaluate(made(12.0, friction_n=FRICTION_N), delay_s=0.3)
    assert evaluation.ratio is not None
    assert evaluation.ratio < 0.5
    assert str(evaluation).splitlines()[0] == "0.3 s late"


def test_doubt_says_which_arguments_answer_it() -> None:
    recording = made(friction_n=FRICTION_N)
    table = {"Time": recording.time_s, "Weg": recording.position_m, "Force (N)": recording.force_n}
    with pytest.raises(ff.UnclearError) as raised:
        ff.load(table)
    assert str(raised.value).endswith("then add: time='s:Time', position='m:Weg'")
    assert raised.value.columns == {"time": "s:Time", "position": "m:Weg"}
    assert ff.load(table, **raised.value.columns).taken == "time s:Time, position m:Weg, force N:Force (N)"


def test_folder_gives_each_diagnosis_or_its_refusal(tmp_path: Path) -> None:
    put(tmp_path / "friction.csv", made(friction_n=FRICTION_N))
    (tmp_path / "empty.csv").touch()
    results = {file.name: found for file, found in ff.diagnose_folder(tmp_path)}
    assert set(results) == {"friction.csv", "empty.csv"}
    assert isinstance(results["friction.csv"], ff.Diagnosis)
    assert str(results["empty.csv"]).endswith("empty.csv: empty file, expected a recording")


def test_notebook_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    assert isinstance(names["d"], ff.Diagnosis)
    assert names["d"].verdict == "cause_found"


def test_arrays_of_time_position_and_force_are_a_recording() -> None:
    sample = made(friction_n=FRICTION_N)
    assert sample.force_n is not None
    columns = sample.time_s, sample.position_m, sample.force_n
    frame = np.rec.fromarrays(columns, formats="f8,f8,f8", names=("Time (s)", "Position (m)", "Force (N)"))
    for found in (ff.load(*columns), ff.load(np.column_stack(columns)), ff.load(frame)):
        assert found.force_n is not None
        np.testing.assert_array_equal(found.force_n, sample.force_n)
    assert ff.load(*columns[:2]).force_n is None


@pytest.mark.parametrize("given", [(3,), (np.zeros((4, 7)),), (np.zeros(3), np.zeros(4)), ([1, 2], "a")])
def test_other_arrays_are_refused_in_one_line(given: tuple[object, ...]) -> None:
    with pytest.raises(ff.ForefeelError, match="expected a file, columns by name, or time in s") as raised:
        ff.load(*given)
    assert len(str(raised.value).splitlines()) == 1


def test_a_recording_says_what_it_holds() -> None:
    lines = str(made(friction_n=FRICTION_N)).splitlines()
    assert [line.split()[0] for line in lines] == ["Recording", "Samples", "Position", "Force"]
    assert made()._repr_html_().count("<tr>") == 4


def test_without_matplotlib_the_page_has_the_figure(
    found: ff.Diagnosis, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    figure = found.plot()
    assert isinstance(figure, PageFigure)
    figure.savefig(tmp_path / "d.html")
    assert "extended by the causes" in (tmp_path / "d.html").read_text(encoding="utf-8")
    assert figure._repr_html_().startswith("<iframe")
    with pytest.raises(ff.ForefeelError, match="pip install"):
        figure.savefig(tmp_path / "d.png")


def test_a_stop_is_of_every_axis_that_is_known_of(monkeypatch: pytest.MonkeyPatch) -> None:
    def confirmed(_sender: StopSender, axes: tuple[str, ...], _reason: str) -> dict[str, str]:
        return dict.fromkeys(axes, "estopped")

    monkeypatch.setattr("forefeel.cell.stop_over_network", confirmed)
    cell = ff.Cell(StopSender(TransportSettings(), "master", "cell", axes=("a", "b")), ["state"])
    cell.hear(SLAVE_STATE.key("cell", "a"), encode(usual(SLAVE_STATE)), 0)
    assert cell.stop() == {"a": "estopped", "b": "estopped"}


def test_no_recording_has_no_diagnosis() -> None:
    with pytest.raises(RecordingError, match="no recording"):
        ff.diagnose([])
