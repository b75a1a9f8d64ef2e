"""The demo: a run in a vessel with hidden causes, the diagnosis, a run that knows them."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import starmap
from pathlib import Path
from shutil import rmtree

from forefeel.common.causes.model import SCHEMA
from forefeel.common.errors import ConfigurationError
from forefeel.common.events.text import quantity
from forefeel.common.yaml_file import dump_mapping
from forefeel.dashboard.scene import Scene
from forefeel.diagnosis.verdict import Cause, Diagnosis
from forefeel.files import fresh_folder, write_all
from forefeel.interrupt import ends_in_order
from forefeel.loopback.plan import LoopbackOptions
from forefeel.loopback.run import RECORDING, REPORT, RUN_FILES, judge, recorded_run
from forefeel.loopback.viewer import DashboardProcess
from forefeel.report.model import RunReport
from forefeel.report.wording import DISCLAIMER, felt_text, plain_value, shown, split_unit
from forefeel.results.folder import EARLIER, save
from forefeel.results.run import draw, stages
from forefeel.results.task import FILES, MODEL, PAGE, Task, examine
from forefeel.terminal import say, show

Effects = Mapping[str, Mapping[str, float]]

RUN_S = 30.0
VESSEL: Effects = {"mass_damper_spring": {"mass_kg": 0.01, "damping_n_s_m": 0.0, "stiffness_n_m": 7.5}}
HIDDEN: Effects = {
    "presliding_hysteresis": {"force_n": 0.08, "stiffness_n_m": 250.0},
    "asymmetric_damping": {"forward_n_s_m": 6.0, "backward_n_s_m": 0.5},
}


def run_demo(viewer: DashboardProcess, out: Path, seed: int, duration_s: float = RUN_S) -> None:
    """Runs a loopback with hidden effects, diagnoses it, and runs a second one with what was learned, both at
    300 ms of round trip with a live page; prints ten lines, and keeps the page until the viewer ends.
    `duration_s`: of each run.

    `out` has the second run; `out/first` the first, `out/diagnosis` its diagnosis. The second run starts with
    the model of the diagnosis, or, where that names nothing hidden, with the first run's prior. The prior of
    an earlier demo is deleted.

    Raises:
        InputError: the folder can not be used, or holds such files and is not of a demo.
        RunError: a run failed, was interrupted, or its slave was never armed.
    """
    first_out, diagnosis_out = out / "first", out / "diagnosis"
    vessel, hidden, prior = out / "vessel.yaml", out / "hidden.yaml", out / "prior"
    ours = *RUN_FILES, vessel.name, prior.name, first_out.name, diagnosis_out.name
    if not hidden.exists() and any((out / name).exists() for name in ours):
        raise ConfigurationError(f"--out {out}: holds what no demo has made; expected another folder")
    with ends_in_order("demo", out) as written:
        write_all(out, {file.name: _model(file.stem) for file in (vessel, hidden)}, written)
        rmtree(prior, ignore_errors=True)  # of an earlier demo: the first run is cold
        options = LoopbackOptions(
            seed, "paper", duration_s=duration_s, slave_model=vessel, hide=hidden, prior_dir=prior
        )
        pages: dict[str, Path] = {}

        def tell(head: str, recording: Path | None = None) -> None:
            say(head)
            viewer.show(Scene(head=head, recording=recording, pages=pages))

        tell(f"1 of 3: {duration_s:g} s in a vessel that nothing is known of, 300 ms away")
        first = recorded_run(options, first_out, viewer, overwrite=True)
        written.append(f"first/{RECORDING}")
        judge(first)
        pages["first run"] = first_out / REPORT
        tell("2 of 3: what did the contact model lack? The diagnosis looks for it", first_out / RECORDING)
        diagnosis = _diagnose(first_out / RECORDING, diagnosis_out)
        pages["diagnosis"] = diagnosis_out / PAGE
        tell(f"3 of 3: the same vessel, starting with {_start_text(diagnosis)}")
        knowing = replace(options, seed=seed + 1)
        if _hidden_causes(diagnosis):
            knowing = replace(knowing, master_model=diagnosis_out / MODEL, prior_dir=None)
        second = recorded_run(knowing, out, viewer, overwrite=True)
        judge(second)
    again = f"{viewer.url} shows both runs again, report and diagnosis, until {viewer.until}"
    lines = _lines(first, diagnosis, second, out, again if viewer.url else "none")
    before_n = first.transparency and quantity(first.transparency.felt.rms_n, "N")
    felt = f"{felt_text(second)}; {before_n} in the first run"
    show(*lines, DISCLAIMER, f"Felt        {felt}")
    pages["second run"] = out / REPORT
    viewer.stay(felt, out / RECORDING, pages)


def _model(name: str) -> str:
    effects = VESSEL if name == "vessel" else HIDDEN
    listed = [{"effect": effect, "parameters": dict(values)} for effect, values in effects.items()]
    return dump_mapping({"schema": SCHEMA, "name": name, "effects": listed})


def _diagnose(recording: Path, folder: Path) -> Diagnosis:
    fresh_folder(folder, FILES, EARLIER, overwrite=True)
    result, page = examine(Task(recording), stages("diagnosis"))
    save(folder, result, [])
    draw(page, "diagnosis", folder, [])
    return result.diagnosis


def _lines(first: RunReport, diagnosis: Diagnosis, second: RunReport, out: Path, page: str) -> list[str]:
    """Lines for the terminal: both runs, what was hidden and named, files, `page` (as text), next command."""
    away = quantity(first.delay_s.p50, "s")
    hidden = (f"{name}: {', '.join(map(_value, values, values.values()))}" for name, values in HIDDEN.items())
    return [
        f"First run   {away} away, nothing known: {felt_text(first)}",
        f"Hidden      {'; '.join(hidden)}",
        f"Diagnosis   {_diagnosis_text(diagnosis)}",
        f"Second run  starts with {_start_text(diagnosis)}",
        f"Files       report.html, report.json, {RECORDING} in {out}; first and diagnosis beside them",
        f"Page        {page}",
        f"Next        forefeel diagnose {out / RECORDING} --out {out / 'again'}, or your.csv in its place",
    ]


def _hidden_causes(diagnosis: Diagnosis) -> list[Cause]:
    return [cause for cause in diagnosis.causes if cause.name in HIDDEN]


def _start_text(diagnosis: Diagnosis) -> str:
    return "the model of the diagnosis" if _hidden_causes(diagnosis) else "what the first run has learned"


def _diagnosis_text(diagnosis: Diagnosis) -> str:
    """Text on how many hidden causes the diagnosis named, with their parameters; if none, the verdict."""
    named = _hidden_causes(diagnosis)
    if not named:
        return f"{diagnosis.verdict}; it names nothing that was hidden"
    values = (f"{c.name}: {', '.join(map(str, starmap(shown, c.parameters.items())))}" for c in named)
    how_many = "all of it" if len(named) == len(HIDDEN) else f"{len(named)} of {len(HIDDEN)}"
    return f"names {how_many}, {'; '.join(values)}"


def _value(name: str, value: float) -> str:
    return f"{split_unit(name)[0]} {plain_value(name, value)}"
