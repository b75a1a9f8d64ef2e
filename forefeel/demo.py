"""The demo: a run in a vessel with a cause that nobody told of, its diagnosis, a second run that knows it."""

from dataclasses import replace
from pathlib import Path
from shutil import rmtree

from forefeel.common.causes.model import SCHEMA
from forefeel.common.events.text import quantity
from forefeel.common.yaml_file import dump_mapping
from forefeel.diagnose.examine import FILES, Task, examine
from forefeel.diagnose.folder import EARLIER, save
from forefeel.diagnose.run import LONG, draw
from forefeel.diagnosis.verdict import Cause, Diagnosis
from forefeel.files import fresh_folder, write_all
from forefeel.interrupt import ends_in_order
from forefeel.loopback.plan import LoopbackOptions
from forefeel.loopback.run import RECORDING, How, judge, recorded_run
from forefeel.report.summary import RunReport
from forefeel.report.transparency import Transparency
from forefeel.report.wording import DISCLAIMER, shown
from forefeel.terminal import say, show, stages

RUN_S = 30.0
HIDDEN = "asymmetric_damping"
_MODEL = {
    "schema": SCHEMA,
    "name": "hidden",
    "effects": [{"effect": HIDDEN, "parameters": {"forward_n_s_m": 6.0, "backward_n_s_m": 0.5}}],
}
_TOLD = "6 N s/m on the way in, 0.5 on the way out"


def run_demo(out: Path, seed: int, port: int, opens: bool, duration_s: float = RUN_S) -> None:
    """Both runs at 300 ms of round trip with a live page, the diagnosis between them, and ten lines.

    `out` has the second run; `out/first` the first, `out/diagnosis` what it taught. The second run starts
    with the model of the diagnosis, or, where that does not name what was hidden, with the first run's prior.

    Raises:
        InputError: the folder or the port can not be used.
        RunError: a run failed, or was interrupted.
    """
    hidden, prior = out / "hidden.yaml", out / "prior"
    how = How(True, dashboard=True, opens=opens, port=port)
    with ends_in_order("demo", out) as written:
        fresh_folder(out, (), "an earlier demo", overwrite=True)
        write_all(out, {hidden.name: dump_mapping(_MODEL)}, written)
        rmtree(prior, ignore_errors=True)  # of an earlier demo: the first run is cold
        options = LoopbackOptions(seed, "paper", duration_s=duration_s, hide=hidden, prior_dir=prior)
        say(f"1 of 3: {duration_s:g} s in a vessel that nothing is known of, 300 ms away")
        first = recorded_run(options, out / "first", how)
        judge(first)
        say("2 of 3: what did the contact model lack?")
        found = _diagnosed(out / "first" / RECORDING, out / "diagnosis")
        say(f"3 of 3: {duration_s:g} s in the same vessel, starting with what is known of it now")
        knowing = replace(options, seed=seed + 1)
        if _named(found):
            knowing = replace(knowing, master_model=out / "diagnosis" / "model.yaml", prior_dir=None)
        second = recorded_run(knowing, out, replace(how, opens=False))
        judge(second)
    show(*_lines(first, found, second, out))


def _diagnosed(recording: Path, folder: Path) -> Diagnosis:
    fresh_folder(folder, FILES, EARLIER, overwrite=True)
    with stages("diagnosis", LONG) as tell:
        result, page = examine(Task(recording), tell)
    save(folder, result, [])
    draw(page, "diagnosis", folder, [])
    return result.diagnosis


def _lines(first: RunReport, found: Diagnosis, second: RunReport, out: Path) -> list[str]:
    before, after = (run.transparency or Transparency() for run in (first, second))
    late, felt, now = (quantity(error.rms_n, "N") for error in (before.held, before.felt, after.felt))
    known = "that model" if _named(found) else "what the first run has learned"
    last = f"Felt error  {late} if the late force were shown; {felt} in the first run; {now} now"
    return [
        f"First run   {quantity(first.delay_s.p50, 's')} away, nothing known: {_within(before)}",
        *_causes(found),
        f"Second run  starts with {known}: {_within(after)}",
        f"Files       report.html, report.json, {RECORDING} in {out}",
        f"            report.html, model.yaml of the diagnosis in {out / 'diagnosis'}",
        f"Next        forefeel view {out / RECORDING}; forefeel diagnose your.csv",
        DISCLAIMER,
        last if after.ratio is None else f"{last}, {after.ratio:.2f} of the late force's",
    ]


def _within(score: Transparency) -> str:
    share = "unknown" if score.within_jnd is None else f"{score.within_jnd:.0%}"
    return f"{share} of the time no hand could tell the felt force from the true one"


def _named(found: Diagnosis) -> bool:
    return HIDDEN in {cause.name for cause in found.causes}


def _causes(found: Diagnosis) -> list[str]:
    named = {cause.name: cause for cause in found.causes}
    if not _named(found):
        return [f"Diagnosis   {found.verdict}; what was hidden, {HIDDEN} ({_TOLD}), it does not name"]
    others = ", ".join(name for name in named if name != HIDDEN)
    return [
        f"Diagnosis   names what was hidden: {_cause(named[HIDDEN])}",
        f"            hidden were {_TOLD}" + (f"; beside it {others}" if others else ""),
    ]


def _cause(cause: Cause) -> str:
    return f"{cause.name}, {'; '.join(str(shown(name, value)) for name, value in cause.parameters.items())}"
