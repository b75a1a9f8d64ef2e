"""The page of a diagnosis, and the curves that its pictures show."""

from dataclasses import replace
from string import Formatter

import numpy as np
import pytest

from forefeel.common.causes.candidate import base_name
from forefeel.common.causes.catalogue import CANDIDATES, words
from forefeel.common.causes.registry import OWN
from forefeel.diagnosis.analysis import Analysis
from forefeel.diagnosis.diagnose import Diagnosed, diagnose
from forefeel.diagnosis.prediction import Across
from forefeel.diagnosis.verdict import Cause, Interval, ModelError, NextMotion
from forefeel.results.curves import Curves, force_of_cause, response, since_reversal
from forefeel.results.page import render_page, worst_stretch
from forefeel.results.pictures import Component, picture, sensor_picture
from forefeel.results.verdict_text import answer, equation
from tests.unit.diagnosis_samples import FRICTION_N, made
from tests.unit.model_samples import effect, model
from tests.unit.page_checks import check_page


@pytest.fixture(scope="module")
def rubbing() -> Diagnosed:
    """Dry friction, and a name that a page must not take for its own."""
    return diagnose(made(8.0, friction_n=FRICTION_N, name="<b>rub & run</b>"))


def with_model(analysis: Analysis, name: str) -> Curves:
    """The analysis as if the search had ended at that one cause."""
    grid = [(1.3,)] if name == "pulsation" else CANDIDATES[name].grid(analysis.regression.extent)
    shape = grid[len(grid) // 2] if grid else ()  # this motion is too short for a weight
    fit = analysis.regression.fit({name: shape})
    return Curves.of(replace(analysis, fit=fit), None)


def test_page_shows_each_cause_and_escapes_names(rubbing: Diagnosed) -> None:
    recording = rubbing.analysis.recording
    page = render_page(recording, rubbing, None)
    assert "<h3>coulomb_friction" in page
    check_page(page, figures=6)
    assert "&lt;b&gt;rub &amp; run&lt;/b&gt;" in page
    assert "<b>rub" not in page


def test_rivals_are_listed_and_not_named_as_cause(rubbing: Diagnosed) -> None:
    less = replace(
        rubbing.diagnosis, verdict="not_separable", causes=(), rivals=(("coulomb_friction", "backlash"),),
        next_motion=NextMotion("strokes of several amplitudes", 40.0),
    )  # fmt: skip
    recording = rubbing.analysis.recording
    page, lines = (
        render_page(recording, replace(rubbing, diagnosis=less), None),
        answer(recording, less, None),
    )
    for text in (page, "\n".join(lines)):
        assert "backlash" in text
        assert "strokes of several amplitudes" in text
    assert not any(line.startswith(("Cause", "Extended")) for line in lines)


def test_picture_or_prediction_that_fails_is_one_line(
    rubbing: Diagnosed, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> object:
        raise IndexError("no stroke")

    monkeypatch.setattr("forefeel.results.page.picture", broken)
    monkeypatch.setattr("forefeel.results.pictures.density", broken)
    monkeypatch.setattr("forefeel.results.page.strokes_in_band", broken)
    page = render_page(rubbing.recording, rubbing, "ValueError: no arrival")
    check_page(page, figures=6)
    assert page.count("IndexError: no stroke") == 3
    lines = answer(rubbing.recording, rubbing.diagnosis, "ValueError: no arrival")
    assert "Predicted   failed: ValueError: no arrival" in lines
    assert "ValueError: no arrival" in page


def test_answer_has_cause_prediction_and_caution(rubbing: Diagnosed) -> None:
    across = Across(0.3, 0.2, 0.05, 0.02, 0.0, 20.0)
    found = replace(rubbing.diagnosis, flags=("non_uniform",))
    lines = answer(rubbing.analysis.recording, found, across)
    assert any("prediction: {model: model.yaml}" in line for line in lines)
    starts = {line.split()[0] for line in lines}
    assert {"Verdict", "Simulation", "Cause", "Extended", "Model", "Predicted", "Caution", "Next"} <= starts
    assert max(map(len, lines)) < 120


@pytest.mark.parametrize(
    ("zoh_n", "after_n", "compared"), [(0.2, 0.051, "the same"), (0.2, 0.0855, "71 %"), (0.02, 0.06, "20 %")]
)
def test_model_that_predicts_no_better_is_not_advised(
    rubbing: Diagnosed, zoh_n: float, after_n: float, compared: str
) -> None:
    across = Across(0.3, zoh_n, 0.05, after_n, 12.0, 32.0)
    text = "\n".join(answer(rubbing.recording, rubbing.diagnosis, across))
    assert "300 ms ahead, 12 to 32 s, rms" in text
    assert compared in text and "forefeel master" not in text


def test_equation_holds_all_causes(rubbing: Diagnosed) -> None:
    (first,) = rubbing.diagnosis.causes
    causes = {
        "bias": {"force_n": -0.5},
        "asymmetric_damping": {"forward_n_s_m": 1.0, "backward_n_s_m": 2.0},
        "sensor_lag": {"time_constant_s": 0.012},
        "stress_relaxation": {"stiffness_n_m": 5.0, "time_constant_s": 0.1},
        "backlash": {"width_m": 3e-4},
    }
    listed = tuple(
        replace(first, name=name, parameters={key: Interval(v, v, v) for key, v in values.items()})
        for name, values in causes.items()
    )
    model = ModelError(0.05, {"stiffness_n_m": 60.0, "damping_n_s_m": 3.0}, 75.0)
    found = equation(replace(rubbing.diagnosis, causes=listed, extended=model))
    assert "f = 60 x - 0.5 + 1 max(x', 0) + 2 min(x', 0) + 5 z" in found
    assert all(part in found for part in ("z' = x' - z/0.1", "0.012 s", "0.0003 m"))


def test_every_cause_has_words_and_known_parameters() -> None:
    for name in map(base_name, CANDIDATES):
        assert words(name) == OWN[name].words.format(column="another column") != ""
    for name, kind in OWN.items():
        known = {p.name for p in kind.parameters} | set(kind.shorthands) | {"exponential_n", "length_m"}
        for text in kind.equation:
            assert {field for _, field, _, _ in Formatter().parse(text) if field} <= known, name


@pytest.mark.parametrize("name", [name for name in CANDIDATES if "with_column" not in name])
def test_every_cause_of_the_motion_has_its_picture(rubbing: Diagnosed, name: str) -> None:
    figure = picture(with_model(rubbing.analysis, name), name)
    assert all(len(line["rows"]) > 10 for spec in figure.specs for line in spec["panels"][0]["lines"])


@pytest.mark.parametrize("name", ["mains_hum", "sensor_spikes"])
def test_fault_of_the_sensor_is_shown_on_the_readings(rubbing: Diagnosed, name: str) -> None:
    figure = sensor_picture(rubbing.analysis, Cause.on_readings(name, {}, "words", 0.01))
    recorded, compared = figure.specs[0]["panels"][0]["lines"]
    assert len(recorded["rows"]) == len(compared["rows"]) > 10


def test_what_the_picture_of_friction_shows_is_its_jump(rubbing: Diagnosed) -> None:
    curves = Curves.of(rubbing.analysis, None)
    of = Component(curves, "coulomb_friction:smooth")
    v, fast = of.v[2], np.abs(of.v[2]) > 5e-3
    assert of.cause_n[fast] == pytest.approx(FRICTION_N * np.sign(v[fast]), rel=0.2)
    assert of.left[fast] == pytest.approx(of.cause_n[fast], abs=0.02)


def test_the_shares_of_the_causes_and_mass_damper_spring_are_the_whole_model(rubbing: Diagnosed) -> None:
    regression = rubbing.analysis.regression
    fit = regression.fit({"coulomb_friction": (), "bias": (), "stress_relaxation": (0.3,)})
    base = regression.block(fit.model, "", ()) @ fit.of("")
    shares = [force_of_cause(regression, fit, name) for name in fit.model]
    assert base + sum(shares) == pytest.approx(regression.predicted(fit), abs=1e-9)


def test_the_share_of_a_delay_is_what_it_changes(rubbing: Diagnosed) -> None:
    regression = rubbing.analysis.regression
    fit = regression.fit({"time_delay": (0.02,)})
    alone = regression.block({}, "", ()) @ fit.of("")
    assert force_of_cause(regression, fit, "time_delay") == pytest.approx(
        regression.predicted(fit) - alone, abs=1e-9
    )


def test_a_late_force_turns_the_phase_evenly(rubbing: Diagnosed, monkeypatch: pytest.MonkeyPatch) -> None:
    regression = rubbing.analysis.regression
    fit = regression.fit({"time_delay": (0.02,)})
    monkeypatch.setattr(regression.signals, "force", regression.predicted(fit))
    frequency, ratio = response(regression, fit, "time_delay")
    slow = frequency < 5.0
    assert np.count_nonzero(slow) > 3
    slope = float(frequency[slow] @ np.angle(ratio[slow])) / float(frequency[slow] @ frequency[slow])
    assert slope == pytest.approx(-2.0 * np.pi * 0.02, rel=0.2)


def test_a_tremor_is_no_reversal_and_a_stroke_is(rubbing: Diagnosed) -> None:
    t = rubbing.analysis.regression.signals.t
    x = 0.01 * np.abs((0.5 * t) % 2.0 - 1.0) + 2e-4 * np.sin(40.0 * t)
    direction, since = since_reversal(replace(Curves.of(rubbing.analysis, None), x=x), 1e-3)
    turns = np.flatnonzero(np.diff(direction) != 0.0)
    assert t[turns[1:4]] == pytest.approx([2.0, 4.0, 6.0], abs=0.2)
    assert since.max() == pytest.approx(0.01, rel=0.1)
    assert np.all(since >= 0.0)


def test_the_worst_stretch_is_where_the_error_is(rubbing: Diagnosed) -> None:
    curves = Curves.of(rubbing.analysis, None)
    bad = curves.after + np.where((curves.t > 5.0) & (curves.t < 5.8), 1.0, 0.0)
    start, end = worst_stretch(curves.t, bad, 1.0)
    assert start < 5.5 < end


def test_a_given_simulation_is_what_the_force_is_compared_with(rubbing: Diagnosed) -> None:
    parameters = {"mass_kg": 0.02, "damping_n_s_m": 0.8, "stiffness_n_m": 40.0}
    given = model(effect("mass_damper_spring", **parameters))
    curves = Curves.of(rubbing.analysis, given)
    fast = np.abs(curves.v[curves.rows]) > 5e-3
    size = np.abs(curves.before[curves.rows][fast])
    assert size == pytest.approx(np.full(len(size), FRICTION_N), abs=0.03)
    assert "the given model" in render_page(rubbing.analysis.recording, rubbing, None, given)
