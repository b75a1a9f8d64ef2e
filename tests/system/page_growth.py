"""The live page for long: neither its script nor its server grows."""

from pathlib import Path

from tests.browser import Served, Shown, Speaker, installed_chromium
from tests.system.rows import Result
from tests.unit.dashboard.talk import CELL

_WARM_S = 75.0
"""In the first minute page and server fill up with what they keep."""
_MOST_SCRIPT_MB, _MOST_SERVER_MB = 2.0, 4.0
_LEAST_HZ = 15.0
"""Half of what a page asks for."""


def page_without_growth(seconds: float, folder: Path) -> Result:
    """`seconds`: after the first that fill it."""
    with (
        Speaker() as speaker,
        installed_chromium(folder) as chromium,
        Served(folder, "dashboard", "--cell", CELL, "--connect", speaker.endpoint) as served,
        Shown(chromium, served.url) as shown,
    ):
        shown.drawing()
        shown.page.wait_for_timeout(1000 * _WARM_S)
        heap_mb, resident_mb = shown.heap_mb(), served.process.resident_mb()
        rate_hz = shown.rate_hz(seconds)
        script_mb, server_mb = shown.heap_mb() - heap_mb, served.process.resident_mb() - resident_mb
        errors = [*shown.errors]
    figures = f"{rate_hz:.1f} updates/s, script {script_mb:+.1f} MB, server {server_mb:+.1f} MB"
    met = rate_hz >= _LEAST_HZ and script_mb < _MOST_SCRIPT_MB and server_mb < _MOST_SERVER_MB
    required = f"required {_LEAST_HZ:g} updates/s, {_MOST_SCRIPT_MB:g} MB, {_MOST_SERVER_MB:g} MB"
    return Result(figures, [*errors, *([] if met else [required])])
