"""report.json and report.html of a run."""

import os
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from common.errors import RunError
from common.recording.mcap_reader import Run, read_run
from forefeel.report import wording
from forefeel.report.figures import Drawing, axis_drawings, loop_drawings
from forefeel.report.model import RunReport
from forefeel.report.summary import last_timing, summarise
from forefeel.report.text import DISCLAIMER
from forefeel.report.traces import axis_traces

_WORDS = "quantity", "micros", "share", "ratio", "number", "verdict"


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
    _write(out_dir / "report.json", report.to_json())
    _write(out_dir / "report.html", page)
    return report


def render_page(report: RunReport, run: Run) -> str:
    """The report with figures as one HTML file that needs nothing else."""
    environment = Environment(
        loader=PackageLoader("forefeel", "report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals.update(
        svg=_svg,
        disclaimer=DISCLAIMER,
        **{name: getattr(wording, name) for name in _WORDS},
    )
    return environment.get_template("page.html.j2").render(
        report=report,
        drawings={axis: axis_drawings(axis, axis_traces(run, axis)) for axis in run.axes},
        loops=loop_drawings({role: last_timing(run, role) for role in ("master", "slave")}),
    )


def _svg(drawing: Drawing) -> Markup:
    """Not escaped: matplotlib has escaped what the drawing says."""
    return Markup(drawing.svg)


def _write(path: Path, text: str) -> None:
    """Beside the file, then in its place: a reader sees the old file or the new one."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise RunError(f"{path}: {error.strerror or error}, the report is not written") from error
