"""The live page: a real run and its replay, judged by what a person sees and does; and whether it grows."""

import re
import urllib.error
import urllib.request
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np

from forefeel.common.error_size import Floats
from tests.browser import Served, Shown, Speaker, installed_chromium
from tests.live_cell import Process
from tests.system.rows import Result
from tests.unit.dashboard.talk import CELL
from tests.waiting import PATIENCE_S, wait_until

_LINK = re.compile(r"dashboard at (http://\S+)/\n")
_RUN_S = 90
_LATE_S = 0.06  # by which the ghost may differ from the delay shown
_GRID_S = 0.01
_WARM_S = 75.0
"""In the first minute page and server fill up with what they keep."""
_MOST_SCRIPT_MB, _MOST_SERVER_MB = 2.0, 4.0
_LEAST_HZ = 15.0
"""Half of what a page asks for."""
Claims = Iterator[tuple[str, object]]
"""What a person sees, and whether it is so."""


def page_seen(folder: Path) -> Result:
    line = f"loopback --dashboard --impairment paper --duration {_RUN_S} --out run"
    process = Process("loopback", folder, *line.split())
    try:
        wait_until(lambda: _LINK.search(process.text), PATIENCE_S, "the link of the page")
        url = _LINK.findall(process.text)[0]
        with installed_chromium(folder) as chromium, Shown(chromium, url) as shown:
            shown.until(lambda: shown.text("gain") != "–", "the gain")
            shown.page.wait_for_timeout(12_000)  # a stroke and a half
            figures = (
                f"ghost {_ghost_s(shown):.3f} s late, {shown.text('delay')} ms shown; "
                f"error {shown.text('gain')} mN, {shown.text('gain-more')}"
            )
            claims = chain(_live(shown, url), _stopped(shown), _ended(shown))
            failures = [f"not so: {claim}" for claim, met in claims if not met]
            failures += shown.errors
    finally:
        process.kill()
    return Result(figures, failures)


def _live(shown: Shown, url: str) -> Claims:
    late_s = abs(_ghost_s(shown) - float(shown.text("delay")) * 1e-3)
    yield f"the ghost is late by the delay shown, but for {late_s:.3f} s", late_s < _LATE_S
    box = shown.page.locator('[data-id="force"]').bounding_box()
    assert box is not None
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.4 * box["height"]
    shown.page.mouse.move(x, y)
    shown.page.wait_for_timeout(300)
    yield "there are values under the pointer", shown.ask("forefeel.charts.hover !== null")
    shown.page.mouse.wheel(0, -300)
    shown.page.wait_for_timeout(300)
    yield "the wheel zooms", shown.ask("forefeel.window_s") < 20
    shown.page.mouse.down()
    shown.page.mouse.move(x + 80, y, steps=4)
    shown.page.mouse.up()
    yield "a drag shows a stretch", shown.ask("forefeel.paused && forefeel.window_s < 10")
    shown.page.mouse.dblclick(x, y)
    yield "a double click is back", shown.ask("!forefeel.paused && forefeel.window_s === 20")
    before = shown.ask("getComputedStyle(document.body).backgroundColor")
    shown.page.locator('[data-id="theme"]').click()
    after = shown.ask("getComputedStyle(document.body).backgroundColor")
    yield "dark and light look different", before != after
    for width in (1280, 1024, 820, 390):
        shown.page.set_viewport_size({"width": width, "height": 800})
        scrolled = shown.ask("document.documentElement.scrollWidth")
        yield f"a page on {width} px has {scrolled}", scrolled == width
    shown.page.set_viewport_size({"width": 1280, "height": 800})
    yield "a page of another site may not stop", _foreign(url) == 403
    before_m = _tip_m(shown)
    shown.until(lambda: abs(_tip_m(shown) - before_m) > 1e-3, "the motion of the instrument")


def _stopped(shown: Shown) -> Claims:
    shown.page.locator('[data-id="stop"]').click()
    shown.until(lambda: "page, from 127.0.0.1" in shown.text("banner"), "the banner")
    yield "the banner says what clears it", "forefeel clear" in shown.text("banner-more")
    shown.page.wait_for_timeout(1000)
    before_m = _tip_m(shown)
    shown.page.wait_for_timeout(2000)
    moved_m = abs(_tip_m(shown) - before_m)
    yield f"the instrument rests after the stop, but for {moved_m:.4f} m", moved_m < 1e-4


def _ended(shown: Shown) -> Claims:
    shown.until(lambda: shown.text("scene").startswith("Ended"), "the end of the run")
    yield f"no alarm at the end: {shown.text('connection')}", shown.text("connection") == ""
    shown.page.reload()
    shown.until(lambda: shown.ask("forefeel.traces.rows.measured?.length > 10"), "the replay")
    yield "a replay has no stop button", not shown.page.locator('[data-id="stop"]').is_visible()
    with shown.page.context.expect_page() as opened:
        shown.page.locator('[data-id="pages"] a').first.click()
    opened.value.wait_for_load_state()
    yield "the link leads to the report", "report" in opened.value.title()


def _tip_m(shown: Shown) -> float:
    """Where the tip of the instrument is in the picture, once there is one: a gap may end the trace."""
    tips_mm: list[float] = []

    def drawn() -> bool:
        tip_mm = shown.ask("forefeel.charts.drawn.tip_mm")
        tips_mm.extend([] if tip_mm is None else [tip_mm])
        return tip_mm is not None

    shown.until(drawn, "the instrument")
    return 1e-3 * tips_mm[-1]


def _ghost_s(shown: Shown) -> float:
    """By how much the late force lags the measured one: where the two differ least."""
    late, measured = _trace(shown, "late"), _trace(shown, "measured")
    t = np.arange(measured[0, 0] + 1.0, min(late[-1, 0], measured[-1, 0]), _GRID_S)
    late_n, lags_s = np.interp(t, late[:, 0], late[:, 1]), np.arange(0.0, 0.8, _GRID_S)
    gaps_n = [late_n - np.interp(t - lag_s, measured[:, 0], measured[:, 1]) for lag_s in lags_s]
    return float(lags_s[np.argmin(np.mean(np.square(gaps_n), axis=1))])


def _trace(shown: Shown, name: str) -> Floats:
    rows: Floats = np.array(shown.ask(f"forefeel.traces.rows.{name}"), dtype=np.float64)
    return rows[np.isfinite(rows[:, 1])]


def _foreign(url: str) -> int:
    """Status of a stop that a page of another site asks for."""
    asked = urllib.request.Request(f"{url}/stop", method="POST", headers={"Origin": "http://elsewhere"})
    try:
        with urllib.request.urlopen(asked) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return error.code


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
