"""The live page of a real run, judged by what a person sees and does; then the replay that it becomes."""

import re
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from forefeel.common.error_size import Floats
from tests.browser import Shown, installed_chromium
from tests.live_cell import Process
from tests.system.rows import Result
from tests.waiting import PATIENCE_S, wait_until

_LINK = re.compile(r"dashboard at (http://\S+)/\n")
_RUN_S = 90
_LATE_S = 0.06  # by which the ghost may differ from the delay shown
_GRID_S = 0.01


def page_seen(folder: Path) -> Result:
    words = "loopback", "--dashboard", "--impairment", "paper", "--duration", f"{_RUN_S}", "--out", "run"
    process = Process("loopback", folder, *words)
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
            failures = [*_live(shown, url), *_stopped(shown), *_ended(shown), *shown.errors]
    finally:
        process.kill()
    return Result(figures, failures)


def _live(shown: Shown, url: str) -> Iterator[str]:
    late_s = abs(_ghost_s(shown) - float(shown.text("delay")) * 1e-3)
    yield from _unless(late_s < _LATE_S, f"the ghost is not late by the delay shown, but {late_s:.3f} s off")
    box = shown.page.locator('[data-id="force"]').bounding_box()
    assert box is not None
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.4 * box["height"]
    shown.page.mouse.move(x, y)
    shown.page.wait_for_timeout(300)
    yield from _unless(shown.ask("forefeel.charts.hover !== null"), "no values under the pointer")
    shown.page.mouse.wheel(0, -300)
    shown.page.wait_for_timeout(300)
    yield from _unless(shown.ask("forefeel.window_s") < 20, "the wheel does not zoom")
    shown.page.mouse.down()
    shown.page.mouse.move(x + 80, y, steps=4)
    shown.page.mouse.up()
    yield from _unless(shown.ask("forefeel.paused && forefeel.window_s < 10"), "a drag shows no stretch")
    shown.page.mouse.dblclick(x, y)
    yield from _unless(
        shown.ask("!forefeel.paused && forefeel.window_s === 20"), "a double click is not back"
    )
    dark = {shown.ask("getComputedStyle(document.body).backgroundColor")}
    shown.page.locator('[data-id="theme"]').click()
    dark.add(shown.ask("getComputedStyle(document.body).backgroundColor"))
    yield from _unless(len(dark) == 2, "dark and light look the same")
    for width in (1280, 1024, 820, 390):
        shown.page.set_viewport_size({"width": width, "height": 800})
        seen = shown.ask("document.documentElement.scrollWidth")
        yield from _unless(seen == width, f"{seen} px of a page on {width}")
    shown.page.set_viewport_size({"width": 1280, "height": 800})
    yield from _unless(_foreign(url) == 403, "a page of another site may stop")
    before_m = _tip_m(shown)
    shown.until(lambda: abs(_tip_m(shown) - before_m) > 1e-3, "the motion of the instrument")


def _stopped(shown: Shown) -> Iterator[str]:
    shown.page.locator('[data-id="stop"]').click()
    shown.until(lambda: "page, from 127.0.0.1" in shown.text("banner"), "the banner")
    yield from _unless(
        "forefeel clear" in shown.text("banner-more"), "the banner does not say what clears it"
    )
    shown.page.wait_for_timeout(1000)
    before_m = _tip_m(shown)
    shown.page.wait_for_timeout(2000)
    moved_m = abs(_tip_m(shown) - before_m)
    yield from _unless(moved_m < 1e-4, f"the instrument moves after the stop, by {moved_m:.4f} m")


def _ended(shown: Shown) -> Iterator[str]:
    shown.until(lambda: shown.text("scene").startswith("Ended"), "the end of the run")
    yield from _unless(shown.text("connection") == "", f"an alarm at the end: {shown.text('connection')}")
    shown.page.reload()
    shown.until(lambda: shown.ask("forefeel.traces.rows.measured?.length > 10"), "the replay")
    yield from _unless(not shown.page.locator('[data-id="stop"]').is_visible(), "a replay has a stop button")
    with shown.page.context.expect_page() as opened:
        shown.page.locator('[data-id="pages"] a').first.click()
    opened.value.wait_for_load_state()
    yield from _unless("report" in opened.value.title(), "no report behind the link")


def _tip_m(shown: Shown) -> float:
    """Of the instrument in the picture, as soon as there is one: a gap may end the trace."""
    tip_mm: list[float] = []

    def seen() -> bool:
        known = shown.ask("forefeel.charts.drawn.tip_mm")
        tip_mm.extend([] if known is None else [known])
        return known is not None

    shown.until(seen, "the instrument")
    return 1e-3 * tip_mm[-1]


def _ghost_s(shown: Shown) -> float:
    """By how much the late force lags the measured one: where the two differ least."""
    late, measured = (
        np.array(shown.ask(f"forefeel.traces.rows.{name}"), dtype=float) for name in ("late", "measured")
    )
    late, measured = (rows[np.isfinite(rows[:, 1])] for rows in (late, measured))
    t = np.arange(measured[0, 0] + 1.0, min(late[-1, 0], measured[-1, 0]), _GRID_S)
    lags = np.arange(0.0, 0.8, _GRID_S)

    def error(lag_s: float) -> float:
        gap: Floats = np.interp(t, late[:, 0], late[:, 1]) - np.interp(
            t - lag_s, measured[:, 0], measured[:, 1]
        )
        return float(np.mean(gap**2))

    return float(lags[np.argmin([error(lag_s) for lag_s in lags.tolist()])])


def _trace(shown: Shown, name: str) -> Floats:
    rows: Floats = np.array(shown.ask(f"forefeel.traces.rows.{name}"), dtype=np.float64)
    return rows[np.isfinite(rows[:, 1])]


def _foreign(url: str) -> int:
    asked = urllib.request.Request(f"{url}/stop", method="POST", headers={"Origin": "http://elsewhere"})
    try:
        with urllib.request.urlopen(asked) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return error.code


def _unless(met: object, failure: str) -> Iterator[str]:
    if not met:
        yield failure
