"""One loopback run from its options to the ten lines."""

import shutil
from contextlib import nullcontext
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from forefeel.common.errors import ConfigurationError
from forefeel.dashboard.chapter import Chapter
from forefeel.files import fresh_folder
from forefeel.interrupt import ends_in_order, heeded
from forefeel.loopback.hardware import SIMULATED, check_hardware, on_bench
from forefeel.loopback.outcome import amber_line, require_armed
from forefeel.loopback.plan import STATE, LoopbackOptions, Plan, make_plan
from forefeel.loopback.real import Progress as Show
from forefeel.loopback.real import run_real
from forefeel.loopback.viewer import DashboardProcess
from forefeel.loopback.virtual import VirtualLoopback
from forefeel.report.page import ten_lines, write_report
from forefeel.report.summary import RunReport
from forefeel.terminal import answer, progress, say, stages, warn

RECORDING, REPORT = "recording.mcap", "report.html"
_OURS = (
    RECORDING, "report.json", REPORT, "slave.yaml", "master.yaml", "slave.log", "master.log",
    "stage.log", "cell.log", "handle.log", "hub.log", STATE,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class How:
    """How a run is done: what becomes of earlier results, in which time, and whether somebody looks on."""

    overwrite: bool = False
    virtual: bool = False
    dashboard: bool = False
    opens: bool = False


def run_loopback(options: LoopbackOptions, out: Path | None, how: How) -> RunReport:
    """Plans, runs, reports, prints the ten lines.

    Raises:
        InputError: the options can not be fulfilled; nothing was written.
        RunError: the run failed, was interrupted, or was never armed.
    """
    folder = out or Path("out") / f"run-{datetime.now():%Y%m%d-%H%M%S}"
    if how.virtual and how.dashboard:
        raise ConfigurationError("--dashboard: shows what runs in real time; expected no --virtual-time")
    viewer = DashboardProcess(folder, how.opens, say) if how.dashboard else None
    with viewer or nullcontext():
        report = recorded_run(options, folder, how, viewer)
        if viewer is not None and viewer.url:
            say(f"{viewer.url} shows the run again, until {viewer.until}")
        answer(*ten_lines(report, folder), document=report.to_json)
        judge(report)
        if viewer is not None:
            pages = {"report": (folder / REPORT).absolute()}
            viewer.stay(Chapter(head="The run has ended", recording=folder / RECORDING, pages=pages))
    return report


def judge(report: RunReport) -> None:
    """Warns where this host was too slow.

    Raises:
        RunError: the slave was never armed.
    """
    require_armed(report)
    if remark := amber_line(report):
        warn(remark)


def recorded_run(
    options: LoopbackOptions, folder: Path, how: How, viewer: DashboardProcess | None
) -> RunReport:
    """The same without a word but what is going on."""
    with ends_in_order("loopback", folder) as written:
        return _run_in(folder, options, how, written, viewer)


def _run_in(
    folder: Path, options: LoopbackOptions, how: How, written: list[str], viewer: DashboardProcess | None
) -> RunReport:
    check_hardware(options.hardware, options.recording is not None, how.virtual)
    plan = make_plan(options)
    plan.slave_settings()
    plan.master_settings()
    fresh_folder(folder, _OURS, "an earlier run", how.overwrite)
    if options.prior_dir is not None:
        _make_prior_dir(options.prior_dir)
    for path in (folder / name for name in _OURS):
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    for note in plan.notes:
        say(note)
    if viewer is not None:
        viewer.start()
        viewer.tell(viewer.chapter.model_copy(update={"vessel": plan.vessel()}))
    with _progress() as bar:
        task = bar.add_task("starting", total=plan.expected_s)
        _run(plan, options, folder, how.virtual, written, _shown(bar, task, plan), viewer)
    with stages("loopback") as tell:
        tell("writing the report")
        return write_report(folder / RECORDING, folder)


def _make_prior_dir(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        raise ConfigurationError(f"--prior-dir {folder}: {error.strerror}; expected a folder") from error


def _shown(bar: Progress, task: TaskID, plan: Plan) -> Show:
    def show(done_s: float, what: str) -> None:
        bar.update(task, completed=min(done_s, plan.expected_s), description=what)

    return show


def _run(
    plan: Plan,
    options: LoopbackOptions,
    folder: Path,
    virtual: bool,
    written: list[str],
    show: Show,
    viewer: DashboardProcess | None,
) -> None:
    """Leaves the recording, also of a run that was interrupted."""
    if options.hardware != SIMULATED:
        with TemporaryDirectory(prefix="forefeel-") as ports:  # short, for sockets have short names
            bench = on_bench(plan, options.hardware, Path(ports), folder, options.seed)
            run_real(bench.plan, folder, show, bench.emulators, viewer)
        written.append(RECORDING)
    elif not virtual:
        run_real(plan, folder, show, viewer=viewer)
        written.append(RECORDING)
    else:
        _run_virtual(VirtualLoopback(plan, options.seed), folder / RECORDING, written, show)
    show(plan.expected_s, "done")


def _run_virtual(loop: VirtualLoopback, path: Path, written: list[str], show: Show) -> None:
    with heeded() as stop:
        try:
            with loop.recording(path) as write_on:

                def look(done_s: float) -> None:
                    show(done_s, "virtual time")
                    write_on()
                    stop.check()

                loop.run(look)
        finally:
            if loop.payloads:
                written.append(path.name)
            else:
                path.unlink(missing_ok=True)


def _progress() -> Progress:
    return progress(
        TextColumn("{task.description:>12}"),
        BarColumn(bar_width=40),
        TextColumn("{task.completed:5.1f} / {task.total:.1f} s"),
        TimeRemainingColumn(),
    )
