"""report.json and report.html of a run."""

from collections.abc import Mapping
from pathlib import Path

from forefeel.common.recording.mcap_reader import Run, read_run
from forefeel.files import write_all
from forefeel.report.figures import axis_drawings, loop_drawings
from forefeel.report.model import RunReport
from forefeel.report.summary import last_timing, summarise
from forefeel.report.template import render
from forefeel.report.traces import axis_traces

FILES = ("report.json", "report.html")


def write_report(run_path: Path, out_dir: Path) -> RunReport:
    """Writes report.json and report.html of a recorded run into `out_dir`, each whole or not at all.

    The same recording gives the same bytes.

    Raises:
        RecordingError: the recording can not be read.
        RunError: the files can not be written.
    """
    report, pages = make_pages(read_run(run_path))
    write_all(out_dir, pages, [])
    return report


def make_pages(run: Run) -> tuple[RunReport, Mapping[str, str]]:
    """The report of a run, and the text of each of `FILES`.

    Raises:
        RecordingError: a message in the run is not what its topic carries.
    """
    report = summarise(run)
    texts = report.to_json(), render_page(report, run)
    return report, dict(zip(FILES, texts, strict=True))


def render_page(report: RunReport, run: Run) -> str:
    """The report with figures as one HTML file that needs nothing else."""
    return render(
        "report/page.html.j2",
        report=report,
        drawings={axis: axis_drawings(axis, axis_traces(run, axis)) for axis in run.axes},
        loops=loop_drawings({role: last_timing(run, role) for role in ("master", "slave")}),
    )
