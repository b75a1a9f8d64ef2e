"""report.json and report.html of a run."""

from pathlib import Path

from common.recording.mcap_reader import Run, read_run
from forefeel.files import write_whole
from forefeel.report.figures import axis_drawings, loop_drawings
from forefeel.report.model import RunReport
from forefeel.report.summary import last_timing, summarise
from forefeel.report.template import render
from forefeel.report.traces import axis_traces


def write_report(run_path: Path, out_dir: Path) -> RunReport:
    """Writes report.json and report.html of a recorded run into `out_dir`, each whole or not at all.

    The same recording gives the same bytes.

    Raises:
        RecordingError: the recording can not be read.
        RunError: the files can not be written.
    """
    run = read_run(run_path)
    report = summarise(run)
    page = render_page(report, run)
    write_whole(out_dir / "report.json", report.to_json())
    write_whole(out_dir / "report.html", page)
    return report


def render_page(report: RunReport, run: Run) -> str:
    """The report with figures as one HTML file that needs nothing else."""
    return render(
        "report/page.html.j2",
        report=report,
        drawings={axis: axis_drawings(axis, axis_traces(run, axis)) for axis in run.axes},
        loops=loop_drawings({role: last_timing(run, role) for role in ("master", "slave")}),
    )
