"""One loopback run from its options to the ten lines."""

import shutil
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from forefeel.common.errors import ConfigurationError
from forefeel.files import fresh_folder
from forefeel.interrupt import ends_in_order, signal_flag
from forefeel.loopback.hardware import check_hardware, on_bench
from forefeel.loopback.plan import STATE, LoopbackOptions, Plan, make_plan
from forefeel.loopback.real import run_real
from forefeel.loopback.viewer import DashboardProcess
from forefeel.report.wording import felt_text
from forefeel.terminal import Show, answer, bar, say, suggest, warn

if TYPE_CHECKING:
    from forefeel.report.model import RunReport

RECORDING, REPORT = "recording.mcap", "report.html"
RUN_FILES = (
    RECORDING, "report.json", REPORT, "slave.yaml", "master.yaml", "slave.log", "master.log",
    "stage.log", "cell.log", "handle.log", "hub.log", STATE,
)  # fmt: skip


def run_loopback(
    options: LoopbackOptions, out: Path | None, overwrite: bool, virtual: bool, dashboard: bool, opens: bool
) -> None:
    """Runs a loopback: plans, runs both daemons, writes recording and report into `out`, or out/run-DATE, and
    prints the ten lines; a dashboard shows it, and then stays until the user ends it.

    Raises:
        InputError: the options can not be fulfilled; nothing was written.
        RunError: the run failed, was interrupted, or was never armed.
    """
    folder = out or Path("out") / f"run-{datetime.now():%Y%m%d-%H%M%S}"
    if virtual and dashboard:
        raise ConfigurationError("--dashboard: shows what runs in real time; expected no --virtual-time")
    with DashboardProcess(folder, opens, dashboard) as viewer:
        report = recorded_run(options, folder, viewer, overwrite, virtual)
        if viewer.url:
            say(f"{viewer.url} shows the run again, until {viewer.until}")
        from forefeel.report.page import ten_lines  # noqa: PLC0415 - as in `recorded_run`

        answer(*ten_lines(report, folder), document=report.to_json)
        judge(report)
        suggest("diagnose", folder / RECORDING, out=folder / "diagnosis", overwrite=overwrite)
        pages = {"report": (folder / REPORT).absolute()}
        viewer.stay(felt_text(report), folder / RECORDING, pages)


def judge(report: "RunReport") -> None:
    """Prints warnings of faults of the slave and of a host too slow for 1 kHz, if any.

    Raises:
        RunError: the slave was never armed.
    """
    from forefeel.loopback.outcome import amber_lines, require_armed  # noqa: PLC0415 - as in `recorded_run`

    require_armed(report)
    for remark in amber_lines(report):
        warn(remark)


def recorded_run(
    options: LoopbackOptions, folder: Path, viewer: DashboardProcess, overwrite: bool, virtual: bool = False
) -> "RunReport":
    """Plans, runs, and writes recording and report into the folder, where it deletes the files of an earlier
    run, if it may `overwrite`; returns the report, prints notes but not the ten lines. Raises as
    `run_loopback`, but not where the slave was never armed. An interrupted run leaves its recording, too.
    """
    with ends_in_order("loopback", folder) as written:
        check_hardware(options.hardware, options.recording is not None, virtual)
        plan = make_plan(options)
        plan.slave_settings()
        plan.master_settings()
        fresh_folder(folder, RUN_FILES, "an earlier run", overwrite)
        if prior := options.prior_dir:
            try:
                prior.mkdir(parents=True, exist_ok=True, mode=0o700)
            except OSError as error:
                reason = f"--prior-dir {prior}: {error.strerror}; expected a folder"
                raise ConfigurationError(reason) from error
        for path in (folder / name for name in RUN_FILES):
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
        for note in plan.notes:
            say(note)
        viewer.serve()
        scene = viewer.scene.model_copy(update={"vessel": plan.vessel()})
        viewer.show(scene)
        progress = bar(plan.expected_s, "{task.completed:5.1f} / {task.total:.1f} s")
        if virtual:
            with progress as show:
                _run_virtual(plan, options.seed, folder / RECORDING, written, show)
        else:
            with TemporaryDirectory(prefix="forefeel-") as ports:  # short, for sockets have short names
                plan, emulators = on_bench(plan, options.hardware, Path(ports), folder, options.seed)
                at = viewer.endpoints if viewer.url else ()
                after = scene.model_copy(update={"waits": "The run has ended. Its report is being written"})
                run_real(plan, folder, progress, emulators, at, lambda: viewer.show(after))
            written.append(RECORDING)
        from forefeel.report.page import write_report  # noqa: PLC0415 - as above

        return write_report(folder / RECORDING, folder)


def _run_virtual(plan: Plan, seed: int, path: Path, written: list[str], show: Show) -> None:
    """Runs in virtual time and writes the recording as it goes, also of a run that was interrupted; adds its
    name to `written`, or deletes it where it is empty. KeyboardInterrupt: a signal came.
    """
    from forefeel.loopback.virtual import VirtualLoopback  # noqa: PLC0415 - both daemons, which start themselves else

    loop = VirtualLoopback(plan, seed)
    with signal_flag() as stop:
        try:
            with loop.recording(path) as write_on:

                def look(done_s: float) -> None:
                    show(done_s, "virtual time")
                    write_on()
                    stop.check()

                loop.run(look)
        finally:
            if loop.messages:
                written.append(path.name)
            else:
                path.unlink(missing_ok=True)
