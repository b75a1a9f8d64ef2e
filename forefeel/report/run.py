"""`forefeel report`: the report of a run that was recorded before."""

from pathlib import Path

from forefeel.common.recording.mcap_reader import read_run
from forefeel.files import fresh_folder, write_all
from forefeel.interrupt import ends_in_order
from forefeel.report.model import RunReport
from forefeel.report.page import FILES, make_pages, ten_lines
from forefeel.terminal import answer, stages


def run_report(recording: Path, out: Path, overwrite: bool) -> RunReport:
    """Reads the recording, writes report.json and report.html, prints the ten lines.

    Raises:
        InputError: the recording or the folder can not be used; nothing was written.
        RunError: interrupted, or the report can not be written.
    """
    with ends_in_order("report", out) as written:
        with stages("report") as tell:
            tell("reading the recording")
            report, pages = make_pages(read_run(recording))
        fresh_folder(out, FILES, "an earlier report", overwrite)
        write_all(out, pages, written)
    answer(*ten_lines(report, out), document=report.to_json)
    return report
