"""A question with the motion asked for, or the answer to it: in words, as pictures, as the texts of files."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from io import StringIO

import numpy as np

from forefeel.common.causes.catalogue import words
from forefeel.common.events.console import printable
from forefeel.common.events.text import quantity, shown_unit, units_of
from forefeel.common.recording.recording import Recording
from forefeel.common.yaml_file import dump_mapping
from forefeel.diagnosis.excitation import RATE_HZ, Limits
from forefeel.diagnosis.forecast import Forecast
from forefeel.diagnosis.investigation import Investigation, Judged
from forefeel.report.drawing import DOTTED, AxisUnit, Figure, band, line, panel, spec
from forefeel.report.wording import DISCLAIMER
from forefeel.results.confirmation_text import confirmation_lines
from forefeel.results.curves import LEFT, MODEL, near
from forefeel.results.page import render_page
from forefeel.results.task import finite, model_of
from forefeel.results.verdict_text import answer as diagnosis_lines
from forefeel.results.verdict_text import answer_lines as diagnosis_parts
from forefeel.results.verdict_text import headline, labelled

MOTION, QUESTION, ANSWER, MODEL_YAML = "motion.csv", "question.json", "answer.json", "model.yaml"
QUESTION_PAGE, ANSWER_PAGE = "question.html", "answer.html"
QUESTION_FILES, ANSWER_FILES = (MOTION, QUESTION, QUESTION_PAGE), (MODEL_YAML, ANSWER, ANSWER_PAGE)
_SCHEMA = "forefeel.investigation/1"
_OF_QUESTION = {"Rivals", "Nearest", "Follows", "Would show"}
_GRID_S = 0.02
_COLOURS = (LEFT, MODEL, "good", "warn", "bad", "ink")


def question_lines(asked: Investigation) -> list[str]:
    """Lines for the terminal: what the question leaves open, the motion to record, its forecasts."""
    question, diagnosed, limits = asked.question, asked.diagnosed, asked.limits
    name = printable(question.name)
    with units_of(question.columns):
        lines = [("Verdict", f"{name}: its force is flat but for noise, everything is open")]
        if diagnosed is not None:
            diagnosis, label = diagnosed.diagnosis, ""
            lines = [("Verdict", f"{diagnosis.verdict}. {headline(diagnosis)}")]
            for head, text in diagnosis_parts(diagnosis, None):
                label = head or label
                if label in _OF_QUESTION:
                    lines.append((head, text))
        lines += [("Motion", _motion_words(asked.motion, limits))]
        foretold = [
            f"{_rival(forecast)}: up to {quantity(forecast.most_n, 'N')}" for forecast in asked.forecasts
        ]
        lines += [("" if i else "Forecast", text) for i, text in enumerate(foretold)]
        start = quantity(float(asked.motion.position_m[0]), "m")
        lines.append(
            ("Record", f"{MOTION} on the bench, from {start} on: time, position, force, at 100 Hz or more")
        )
    return [*labelled(lines), DISCLAIMER]


def answer_lines(judged: Judged) -> list[str]:
    """Lines for the terminal: the diagnosis that stands, its confirmation on the other recording and, where
    it names no cause, the range, speed and acceleration that its recording reached.
    """
    recording, diagnosis = judged.diagnosed.recording, judged.diagnosed.diagnosis
    *lines, disclaimer = diagnosis_lines(recording, diagnosis, None)
    if judged.refused is not None:  # it explained the answer, and is told below
        lines = [line for line in lines if not line.startswith("Nearest")]
    with units_of(recording.columns):
        lines += labelled(_confirmed(judged))
        if judged.of == "question":
            lines.append(
                "Question    its verdict stands: its model holds on the answer, which names none that does"
            )
        if not diagnosis.names_causes:
            reached = Limits.reached(judged.diagnosed.analysis.regression.signals)
            lines.append(f"Reached     {_limits_text(reached)}: what shows beyond that was not seen")
    return [*lines, disclaimer]


def motion_text(motion: Recording) -> str:
    """A motion as CSV, its position in m, or in rad within `units_of` a rotation."""
    table, columns = StringIO(), np.column_stack([motion.time_s, motion.position_m])
    np.savetxt(table, columns, "%.9g", ",", header=f"time_s,position_{shown_unit('m')}", comments="")
    return table.getvalue()


def question_texts(asked: Investigation) -> dict[str, str]:
    """Texts of `QUESTION_FILES` by their names; without the page where there is no diagnosis."""
    with units_of(asked.question.columns):
        texts = {MOTION: motion_text(asked.motion), QUESTION: _document(asked, None)}
        if asked.diagnosed is not None:
            texts[QUESTION_PAGE] = render_page(
                asked.question, asked.diagnosed, None, asked=_figures(asked, None)
            )
    return texts


def answer_texts(asked: Investigation, answer: Recording, judged: Judged) -> dict[str, str]:
    """Texts of `ANSWER_FILES` by their names."""
    diagnosed, recording = judged.diagnosed, judged.diagnosed.recording
    model = model_of(diagnosed)
    with units_of(recording.columns):
        figures = _figures(asked, answer)
        html = render_page(recording, diagnosed, None, replay=judged.replay, asked=figures)
    return {
        MODEL_YAML: dump_mapping(model.to_mapping()), ANSWER: _document(asked, judged), ANSWER_PAGE: html
    }  # fmt: skip


def _confirmed(judged: Judged) -> list[tuple[str, str]]:
    """Lines on the confirmation, before them one on refused causes; empty where no cause was named."""
    if judged.replay is None:
        named = judged.diagnosed.diagnosis.names_causes
        return [("Not told", "the question can not be simulated by this model")] if named else []
    lines = confirmation_lines(judged.replay)
    if judged.refused is None:
        return lines
    refused = " and ".join(words(cause.name, cause.column) for cause in judged.refused.causes)
    return [("Refused", f"{refused}: it does not hold on the question"), *lines]


def _rival(forecast: Forecast) -> str:
    return " and ".join(map(words, forecast.causes)) or "the simulation alone"


def _limits_text(limits: Limits) -> str:
    """Text of range, speed and acceleration; the force is left out."""
    low, high, speed = (
        quantity(limits.low_m, "m"),
        quantity(limits.high_m, "m"),
        quantity(limits.speed_m_s, "m/s"),
    )
    return f"{low} to {high}, up to {speed} and {limits.acceleration_m_s2:.3g} {shown_unit('m')}/s²"


def _motion_words(motion: Recording, limits: Limits) -> str:
    return f"{motion.duration_s:.1f} s within {_limits_text(limits)}"


def _document(asked: Investigation, judged: Judged | None) -> str:
    """Text of question.json; with `judged` that of answer.json."""
    question = asked.diagnosed
    document: Mapping[str, object] = {
        "schema": _SCHEMA,
        "limits": asdict(asked.limits),
        "duration_s": asked.motion.duration_s,
        "question": question.diagnosis.to_mapping() if question else None,
        "forecasts": [{"causes": forecast.causes, "most_n": forecast.most_n} for forecast in asked.forecasts],
        "answer": None,
    }
    if judged is not None:
        replay, refused = judged.replay, judged.refused
        document = {
            **document,
            "answer": judged.diagnosed.diagnosis.to_mapping(),
            "of": judged.of,
            "refused": None if refused is None else [cause.name for cause in refused.causes],
            "confirmation": None if replay is None else asdict(replay.confirmation),
        }
    return json.dumps(finite(document), indent=2, allow_nan=False) + "\n"


def _began_s(motion: Recording, made: Recording) -> float:
    """Time in s of the recording of a motion at which it began: where the two correlate most."""
    t = np.arange(made.time_s[0], made.time_s[-1], _GRID_S)
    x = np.interp(t, made.time_s, made.position_m)
    asked = motion.position_m[:: round(_GRID_S * RATE_HZ)]
    likeness = np.correlate(x - np.mean(x), asked - np.mean(asked), "full")
    return float(t[0] + (int(np.argmax(likeness)) - len(asked) + 1) * _GRID_S)


def _figures(asked: Investigation, answer: Recording | None) -> list[Figure]:
    """Figures of the motion asked for, with the one made, and of the force that each rival foretells, with
    the measured one; the second only with forecasts, what was made only with an answer.
    """
    motion, foretold = asked.motion, asked.forecasts
    unit = AxisUnit("position", "m", motion.position_m)
    lines = [line("asked", MODEL, motion.time_s, unit(motion.position_m))]
    if answer is not None:
        made_s = answer.time_s - _began_s(motion, answer)
        lines.append(line("made", "measured", made_s, unit(answer.position_m), 0.25))
    ends = unit(np.array([asked.limits.low_m, asked.limits.high_m]))
    range_m = band("range", "soft", motion.time_s[[0, -1]], *np.repeat(ends[:, None], 2, axis=1))
    above = spec([panel(unit.label, lines=lines, bands=[range_m])], unit="s")
    figures = [Figure("Motion within its range", _motion_words(motion, asked.limits), 240, (above,))]
    if not foretold:
        return figures
    unit, forces_n = AxisUnit("force", "N", *(forecast.force_n for forecast in foretold)), []
    lines, bands = [], []
    if answer is not None and answer.force_n is not None:
        forces_n.append(answer.force_n)
        lines.append(line("measured", "measured", made_s, unit(answer.force_n), 0.25, **DOTTED))
    for forecast, colour in zip(foretold, _COLOURS, strict=False):
        lines.append(line(_rival(forecast), colour, forecast.t, unit(forecast.force_n), 0.25))
        bands.append(band("", colour, forecast.t, unit(forecast.low_n), unit(forecast.high_n), 0.25))
    y = near(unit, *forces_n, *(forecast.force_n for forecast in foretold))
    drawn = spec([panel(unit.label, y, lines=lines, bands=bands)], unit="s")
    caption = "By what the first recording tells of each, with the 95 % interval of its parameters."
    return [*figures, Figure("What each rival says of it", caption, 300, (drawn,))]
