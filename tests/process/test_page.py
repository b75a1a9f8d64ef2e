"""The live page in a real browser, served by the real process, fed over real Zenoh."""

import re
from pathlib import Path
from urllib.parse import urlsplit

import pytest

pytest.importorskip("playwright")

from forefeel.common.codec import decode
from forefeel.common.messages import EmergencyStop, SafetyState
from forefeel.common.topics import EMERGENCY_STOP, FORCE, HAPTICS, SAFETY_EVENT, SHAPE, SLAVE_STATE
from forefeel.report.page import write_report
from tests.browser import Served, Shown, Speaker, installed_chromium
from tests.messages import usual
from tests.unit.dashboard.talk import CELL, HOSTILE
from tests.unit.report_run import write_known_run
from tests.waiting import wait_until

HOSTILE_AXIS, LATE = "<i>axis", "the late force has 689 mN"
VESSEL = f"""
axis: "{HOSTILE_AXIS}"
tip_mm: 5
instrument_radius_mm: 0.9
lumen_radius_mm: {{0: 3, 40: 0.8, 80: 2}}
landmarks_mm: {{"<b>stenosis": 40}}
"""


def test_page_shows_forces_hostile_text_and_silence(tmp_path: Path) -> None:
    with Speaker((HOSTILE_AXIS,)) as speaker:
        speaker.changes = {
            HAPTICS.name: {"rendered_n": 0.123, "predicted_n": 0.456},
            FORCE.name: {"force_n": 0.789},
            SLAVE_STATE.name: {"reason": HOSTILE},
        }
        vessel = tmp_path / "vessel.yaml"
        vessel.write_text(VESSEL)
        words = "dashboard", "--cell", CELL, "--connect", speaker.endpoint, "--vessel", str(vessel)
        with (
            installed_chromium(tmp_path) as chromium,
            Served(tmp_path, *words) as served,
            Shown(chromium, served.url) as shown,
        ):
            check_values(shown)
            check_picture(shown, speaker)
            check_hostile_text(shown, speaker)
            hosts = {urlsplit(url).netloc for url in shown.asked if not url.startswith("data:")}
            assert hosts == {f"127.0.0.1:{served.port}"}
            speaker.silent = True
            silence = shown.page.locator('[data-id="silence"]')
            shown.until(silence.is_visible, "silence")
            assert f"Cell {CELL}: silent" in silence.inner_text()
            assert shown.text("felt") == "–"
            speaker.silent = False
            shown.until(lambda: not silence.is_visible(), "the end of the silence")
            shown.until(lambda: shown.text("felt") == "0.123", "the force")
            check_stop(shown, speaker)
            assert shown.errors == []


def check_values(shown: Shown) -> None:
    shown.until(lambda: shown.text("measured") == "0.100", "the late force")
    assert (shown.text("felt"), shown.text("predicted")) == ("0.123", "0.456")
    names = "link", "lease", "safety", "deadman"
    shown.until(lambda: all(shown.light(name)[0] == "●" for name in names), "all lights")
    assert "armed" in shown.light("safety")
    shown.until(lambda: (shown.text("gain"), shown.text("gain-more")) == ("333", LATE), "the gain")
    height = """document.querySelector('[data-id="force"]').clientHeight"""
    assert shown.ask(height) >= 350  # of which the legend and the time take 50
    for width in (390, 820, 1024, 1280):
        shown.page.set_viewport_size({"width": width, "height": 800})
        assert shown.ask("document.documentElement.scrollWidth") == width


def check_picture(shown: Shown, speaker: Speaker) -> None:
    """The tip moves as the stage reports, late by the delay that is shown."""
    pixels = """document.querySelector('[data-id="picture"]').toDataURL()"""
    before = shown.ask(pixels)
    speaker.changes[FORCE.name]["position_m"] = 0.03
    shown.until(lambda: shown.ask("forefeel.charts.drawn.tip_mm") == 35.0, "the tip")
    assert shown.ask(pixels) != before
    assert str(shown.ask("forefeel.charts.drawn.late_ms")) == shown.text("delay")
    straight = shown.ask(pixels)

    def bent() -> bool:
        speaker.say(SHAPE, usual(SHAPE), HOSTILE_AXIS)
        return bool(shown.ask("forefeel.charts.drawn.shape_mm?.at(-1)[1] === 3"))

    shown.until(bent, "the shape")
    assert shown.ask(pixels) != straight


def check_stop(shown: Shown, speaker: Speaker) -> None:
    """One press reaches the axis; the slave's reason stands in the banner, with what clears it."""

    def stopped(payload: bytes, _receive_ns: int) -> None:
        reason = decode(EmergencyStop, payload).reason
        speaker.changes[SLAVE_STATE.name] = {"state": SafetyState.ESTOPPED, "reason": reason}

    speaker.transport.subscribe(EMERGENCY_STOP.key(CELL, HOSTILE_AXIS), stopped)
    shown.page.locator('[data-id="stop"]').click()
    shown.until(lambda: "page, from 127.0.0.1" in shown.text("banner"), "the banner")
    assert "forefeel clear" in shown.text("banner-more")


def check_hostile_text(shown: Shown, speaker: Speaker) -> None:
    """Names and reasons from the network stand on the page as text."""
    events = shown.page.locator('[data-id="events"]')

    def stands_there() -> bool:
        speaker.say(SAFETY_EVENT, usual(SAFETY_EVENT, reason=HOSTILE), HOSTILE_AXIS)
        return "<img src=x onerror" in events.inner_text()

    shown.until(stands_there, "the event")
    shown.until(lambda: "onerror" in shown.light("safety"), "the reason")
    assert HOSTILE_AXIS in shown.page.locator('[data-id="axis"]').inner_text()
    assert shown.page.locator("img").count() == 0
    assert shown.page.title() == "forefeel"


def test_report_in_a_browser_shows_values_and_a_part(tmp_path: Path) -> None:
    write_known_run(tmp_path / "run.mcap", reason=HOSTILE)
    write_report(tmp_path / "run.mcap", tmp_path)
    url = (tmp_path / "report.html").as_uri()
    with installed_chromium(tmp_path) as chromium, Shown(chromium, url) as shown:
        picture = shown.page.locator('canvas[aria-label="Force"]')
        script = "document.querySelector('canvas[aria-label=Force]').toDataURL()"
        shown.page.wait_for_function(
            "document.querySelector('canvas[aria-label=Force]').width > 300"
        )  # drawn
        seen = [shown.ask(script)]
        picture.hover(position={"x": 500, "y": 200})
        wait_until(lambda: shown.ask(script) not in seen)
        seen.append(shown.ask(script))
        picture.drag_to(picture, source_position={"x": 300, "y": 200}, target_position={"x": 500, "y": 200})
        shown.page.mouse.move(0, 0)
        wait_until(lambda: shown.ask(script) not in seen)
        picture.dblclick(position={"x": 500, "y": 200})
        shown.page.mouse.move(0, 0)
        wait_until(lambda: shown.ask(script) == seen[0])
        assert (shown.errors, shown.asked) == ([], {url})
        assert len(re.findall(rb"/Type */Page\b", shown.page.pdf(format="A4"))) == 1
