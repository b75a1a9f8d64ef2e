"""`forefeel report`: the report of a run that was recorded before."""

from pathlib import Path

from rich.console import Console

from common.recording.mcap_reader import read_run
from forefeel.files import fresh_folder
from forefeel.interrupt import ends_in_order
from forefeel.report.model import RunReport
from forefeel.report.page import FILES, make_pages, write_pages
from forefeel.report.text import ten_lines


def run_report(recording: Path, out: Path, overwrite: bool) -> RunReport:
    """Reads the recording, writes report.json and report.html, prints the ten lines.

    Raises:
        InputError: the recording or the folder can not be used; nothing was written.
        RunError: interrupted, or the report can not be written.
    """
    console = Console(stderr=True, highlight=False)
    with ends_in_order("report", out) as written:
        with console.status("reading the recording"):
            report, pages = make_pages(read_run(recording))
        folder = fresh_folder(out, FILES, "an earlier report", overwrite)
        write_pages(pages, folder)
        written.extend(FILES)
    for line in ten_lines(report, folder):
        print(line)
    return report
