"""The page in a real browser, served by the real process, fed over real Zenoh."""

import json
import re
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.error import URLError
from urllib.parse import urlsplit
from urllib.request import urlopen

import numpy as np
import pytest

pytest.importorskip("nicegui")
pytest.importorskip("playwright")

from forefeel.common.topics import FORCE, HAPTICS, MASTER_STATE, SAFETY_EVENT, SLAVE_STATE
from forefeel.loopback.viewer import Watched
from tests.live_cell import Process, free_port
from tests.process.browser import Chromium, Served, Shown, Speaker, installed_chromium
from tests.unit.dashboard.said import CELL, HOSTILE, safety
from tests.unit.dashboard.test_replay import write
from tests.waiting import wait_until

Array = np.ndarray[tuple[int, int], np.dtype[np.float64]]
HOSTILE_AXIS = "<i>axis"
LEAST_HZ = 15.0
"""Half of what a page asks for: this machine may have other work. What was reached is printed."""

pytestmark = pytest.mark.timeout(180)


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with installed_chromium(tmp_path_factory.mktemp("chromium")) as found:
        yield found


@pytest.fixture
def speaker() -> Iterator[Speaker]:
    with Speaker() as found:
        yield found


def dashboard(folder: Path, speaker: Speaker, port: int | None = None) -> Served:
    return Served(folder, "dashboard", "--cell", CELL, "--connect", speaker.endpoint, port=port)


def test_what_the_page_shows_is_what_was_said(chromium: Chromium, speaker: Speaker, tmp_path: Path) -> None:
    speaker.changes = {
        HAPTICS.name: {"rendered_n": 0.123, "predicted_n": 0.456, "low_n": 0.4, "high_n": 0.5},
        FORCE.name: {"force_n": 0.789},
    }
    with dashboard(tmp_path, speaker) as served, Shown(chromium, served.url) as shown:
        shown.until(lambda: shown.text("measured") == "0.789", "the measured force")
        assert (shown.text("felt"), shown.text("predicted"), shown.text("delay")) == ("0.123", "0.456", "300")
        assert shown.text("band") == "95 %: 0.400 to 0.500"
        assert shown.text("leading") == "leads: friction, recent"
        names = "link", "lease", "safety", "deadman"
        shown.until(lambda: all(shown.light(name)[0] == "●" for name in names), "all lights")
        assert "armed" in shown.light("safety")
        assert "stiffness" in shown.page.locator('[data-id="parameters"]').inner_text()
        assert "limit velocity: asked 300 mm/s" in shown.page.locator('[data-id="events"]').inner_text()
        assert "Research software, not a medical device." in shown.page.locator("footer").inner_text()
        assert shown.page.locator('[data-id="force"] canvas').count() == 1
        shown.picture(tmp_path / "dashboard-1280.png")
        assert shown.errors == []
    print(f"screenshot {tmp_path / 'dashboard-1280.png'}")


def test_beyond_loopback_the_link_opens_the_page_and_its_token_leaves_the_address(
    chromium: Chromium, speaker: Speaker, tmp_path: Path
) -> None:
    words = ("--cell", CELL, "--connect", speaker.endpoint, "--address", "0.0.0.0")
    with Served(tmp_path, "dashboard", *words) as served:
        page = f"http://127.0.0.1:{served.port}/"
        with Shown(chromium, page) as stranger:
            assert "Not allowed without the token" in stranger.page.locator("body").inner_text()
        with Shown(chromium, f"{page}?{urlsplit(served.url).query}") as shown:
            shown.drawing()
            assert shown.page.url == page
            (cookie,) = shown.page.context.cookies()
            assert (cookie["httpOnly"], cookie["sameSite"]) == (True, "Strict")
            assert shown.ask("document.cookie") == ""
            shown.page.reload()
            shown.drawing()
            shown.picture(tmp_path / "dashboard-token.png")
            assert shown.errors == []
    print(f"screenshot {tmp_path / 'dashboard-token.png'}")


def _numbers(rows: list[list[float | None]]) -> Array:
    """Without the rows that break the line, where the machine paused."""
    found = np.array(rows, dtype=np.float64)
    return np.asarray(found[np.isfinite(found[:, :2]).all(axis=1)])


@pytest.mark.soak
def test_measured_forces_arrive_late_and_lie_on_their_prediction(
    chromium: Chromium,
    speaker: Speaker,
    tmp_path: Path,
) -> None:
    """`talk` measures just what was predicted for the same command, 300 ms later, with another clock."""
    with dashboard(tmp_path, speaker) as served, Shown(chromium, served.url) as shown:
        shown.drawing()
        shown.page.wait_for_timeout(3000)
        rows = shown.ask("({p: forefeel.traces.rows.predicted, m: forefeel.traces.rows.measured})")
    predicted, measured = _numbers(rows["p"]), _numbers(rows["m"])
    there = measured[:, 0] > predicted[0, 0]
    expected = np.interp(measured[there, 0], predicted[:, 0], predicted[:, 1])
    assert there.sum() > 100
    assert np.allclose(measured[there, 1], expected, atol=2e-3)
    assert predicted[-1, 0] - measured[-1, 0] == pytest.approx(0.3, abs=0.06)


def observed(
    chromium: Chromium, folder: Path, speaker: Speaker, warm_s: float, seconds: float
) -> tuple[float, ...]:
    """(updates/s, growth of the script in MB, growth of the server in MB) of `seconds`, after `warm_s`."""
    with dashboard(folder, speaker) as served, Shown(chromium, served.url) as shown:
        shown.drawing()
        shown.page.wait_for_timeout(1000 * warm_s)
        heap_mb, rss_mb, cpu_s = shown.heap_mb(), served.process.resident_mb(), served.cpu_s
        start_s = time.monotonic()
        rate_hz = shown.rate_hz(seconds)
        cpu = (served.cpu_s - cpu_s) / (time.monotonic() - start_s)
        grown = shown.heap_mb() - heap_mb, served.process.resident_mb() - rss_mb
        print(f"{rate_hz:.1f} updates/s; script {heap_mb:.1f} MB {grown[0]:+.1f}, server {rss_mb:.0f} MB "
              f"{grown[1]:+.1f}, {cpu:.0%} of a core")  # fmt: skip
    return rate_hz, *grown


@pytest.mark.soak
def test_thirty_updates_a_second(chromium: Chromium, speaker: Speaker, tmp_path: Path) -> None:
    """In the first minute page and server fill up with what they keep of it; then they stay as they are."""
    rate_hz, script_mb, server_mb = observed(chromium, tmp_path, speaker, 8.0, 10.0)
    assert rate_hz >= LEAST_HZ
    assert script_mb < 6.0
    assert server_mb < 8.0


@pytest.mark.soak
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("seconds", [600.0])
def test_ten_minutes_without_growth(
    chromium: Chromium,
    speaker: Speaker,
    tmp_path: Path,
    seconds: float,
) -> None:
    rate_hz, script_mb, server_mb = observed(chromium, tmp_path, speaker, 75.0, seconds)
    assert rate_hz >= LEAST_HZ
    assert script_mb < 2.0
    assert server_mb < 4.0


@pytest.mark.soak
def test_nothing_is_loaded_from_elsewhere(chromium: Chromium, speaker: Speaker, tmp_path: Path) -> None:
    with dashboard(tmp_path, speaker) as served, Shown(chromium, served.url) as shown:
        shown.drawing()
        hosts = {urlsplit(url).netloc for url in shown.asked if not url.startswith("data:")}
        assert hosts == {f"127.0.0.1:{served.port}"}
        assert len(shown.asked) > 10


def test_hostile_names_are_text(chromium: Chromium, tmp_path: Path) -> None:
    with Speaker((HOSTILE_AXIS, "rotation")) as speaker:
        speaker.changes = {SLAVE_STATE.name: {"reason": HOSTILE}, HAPTICS.name: {"leading": HOSTILE}}
        with dashboard(tmp_path, speaker) as served, Shown(chromium, served.url) as shown:
            shown.drawing()
            shown.page.locator('[data-id="axis"]').select_option(HOSTILE_AXIS)
            events = shown.page.locator('[data-id="events"]')

            def stands_there() -> bool:
                # a page's server is behind all else on the machine: of what it can not take in, some is lost
                speaker.say(SAFETY_EVENT, safety(reason=HOSTILE), HOSTILE_AXIS)
                return "onerror" in events.inner_text()

            shown.until(stands_there, "the event")
            shown.until(lambda: "onerror" in shown.light("safety"), "the reason")
            assert "<img src=x" in events.inner_text()
            assert HOSTILE_AXIS in shown.page.locator('[data-id="axis"]').inner_text()
            assert "<img" in shown.text("leading")
            assert shown.page.locator("img").count() == 0
            assert shown.page.locator(".ff i:not(.ff-figure i), .ff b > *").count() == 0
            assert shown.page.title() == "forefeel"
            assert shown.errors == []


@pytest.mark.soak
def test_two_viewers_each_with_its_own_axis(chromium: Chromium, tmp_path: Path) -> None:
    with (
        Speaker(("insertion", "rotation")) as speaker,
        dashboard(tmp_path, speaker) as served,
        Shown(chromium, served.url) as one,
        Shown(chromium, served.url, 1024, 768) as other,
    ):
        one.drawing()
        other.drawing()
        one.page.keyboard.press("a")
        one.page.keyboard.press(" ")
        one.page.wait_for_timeout(500)
        before = one.ask("forefeel.updates"), other.ask("forefeel.updates")
        other.page.wait_for_timeout(1000)
        assert one.ask("forefeel.updates") - before[0] <= 1
        assert other.ask("forefeel.updates") - before[1] > 5
        assert one.page.locator('[data-id="paused"]').is_visible()
        assert one.ask("forefeel.axis") != other.ask("forefeel.axis")
        other.picture(tmp_path / "dashboard-1024.png")


@pytest.mark.soak
def test_keys_zoom_pause_and_help(chromium: Chromium, speaker: Speaker, tmp_path: Path) -> None:
    with dashboard(tmp_path, speaker) as served, Shown(chromium, served.url) as shown:
        shown.drawing()
        ticks = shown.page.locator('[data-id="ticks"]')
        assert ticks.inner_text().split("\n")[0] == "−20 s"
        shown.page.keyboard.press("+")
        assert ticks.inner_text().split("\n")[0] == "−10 s"
        for _ in range(2):
            shown.page.keyboard.press("-")
        assert ticks.inner_text().split("\n")[0] == "−30 s"
        shown.page.keyboard.press("?")
        assert shown.page.locator("dialog").is_visible()
        shown.page.keyboard.press("Escape")
        assert not shown.page.locator("dialog").is_visible()
        shown.page.locator('[data-id="pause"]').click()
        assert shown.page.locator('[data-id="paused"]').is_visible()
        shown.page.keyboard.press(" ")
        assert not shown.page.locator('[data-id="paused"]').is_visible()


@pytest.mark.soak
def test_silence_is_said_and_ends(chromium: Chromium, speaker: Speaker, tmp_path: Path) -> None:
    with dashboard(tmp_path, speaker) as served, Shown(chromium, served.url) as shown:
        shown.drawing()
        speaker.silent = True
        silence = shown.page.locator('[data-id="silence"]')
        shown.until(silence.is_visible, "silence")
        said = silence.inner_text()
        assert "Cell cathlab: silent" in said
        assert re.search(r"since \d\d:\d\d:\d\d \(for \d", said)
        assert speaker.endpoint in said
        assert "silent" in shown.light("link")
        assert shown.text("felt") == "–"
        assert shown.text("energy") == "○ –"
        speaker.silent = False
        shown.until(lambda: not silence.is_visible(), "the end of the silence")
        shown.until(lambda: shown.text("felt") != "–", "the force")


@pytest.mark.soak
def test_the_page_comes_back_when_the_server_was_started_again(
    chromium: Chromium,
    speaker: Speaker,
    tmp_path: Path,
) -> None:
    first = dashboard(tmp_path, speaker)
    try:
        with Shown(chromium, first.url) as shown:
            shown.drawing()
            assert first.end() == 0
            shown.until(lambda: "no connection" in shown.text("connection"), "the loss")
            with dashboard(tmp_path, speaker, first.port):
                shown.until(lambda: shown.ask("window.forefeel?.lost_ms === null"), "the connection")
                shown.drawing()
                shown.until(lambda: shown.text("felt") != "–", "the force")
    finally:
        first.process.kill()


@pytest.mark.soak
def test_a_recording_in_the_same_page(chromium: Chromium, tmp_path: Path) -> None:
    path = write(tmp_path / "run.mcap", 6)
    with Served(tmp_path, "view", str(path)) as served, Shown(chromium, served.url) as shown:
        shown.drawing()
        if not shown.ask("forefeel.paused"):
            shown.page.keyboard.press(" ")
        shown.page.keyboard.press("Home")
        shown.until(lambda: shown.text("place").startswith("0:00.0"), "the begin")
        shown.page.keyboard.press("End")
        shown.until(lambda: shown.text("place").startswith("0:05.9"), "the end")
        shown.until(
            lambda: "no command" in shown.page.locator('[data-id="events"]').inner_text(), "the event"
        )
        shown.page.keyboard.press("ArrowLeft")
        shown.page.keyboard.press("ArrowLeft")
        shown.until(lambda: shown.text("place").startswith("0:03.9"), "2 s before the end")
        shown.until(
            lambda: "no command" not in shown.page.locator('[data-id="events"]').inner_text(), "no event"
        )
        begun_s = time.monotonic()
        shown.page.keyboard.press(" ")
        shown.until(lambda: shown.text("place").startswith("0:05.9"), "played to the end")
        assert 1.5 < time.monotonic() - begun_s < 4.0
        shown.until(lambda: shown.page.locator('[data-id="play"]').inner_text() == "▶", "the end of playing")
        shown.picture(tmp_path / "view-1280.png")
        assert shown.errors == []


def armed_share(out: Path) -> float:
    """Of a loopback: a host that is too slow fails a test, though not the command."""
    share = json.loads((out / "report.json").read_text())["armed_share"]
    assert isinstance(share, float)
    return share


@pytest.mark.soak
def test_a_loopback_is_shown_while_it_runs(chromium: Chromium, tmp_path: Path) -> None:
    out = tmp_path / "out"
    run = Process("loopback", tmp_path, "loopback", "--dashboard", "--duration", "150", "--out", str(out))
    try:
        wait_until(lambda: "dashboard at http" in run.log.read_text(), 60.0, "the address")
        (url,) = re.findall(r"dashboard at (\S+)", run.log.read_text())
        wait_until(lambda: url in (out / "dashboard.log").read_text(), 60.0, "the server")
        with Shown(chromium, url) as shown:
            shown.drawing()
            assert shown.text("cell") == "loopback"
            shown.until(lambda: "armed" in shown.light("safety"), "an armed slave")
        run.send(signal.SIGINT)
        assert run.process.wait(60) == 1
        assert "both ends stopped in order" in run.log.read_text()
    finally:
        run.kill()


@pytest.mark.soak
def test_a_dashboard_that_fails_fails_no_loopback(tmp_path: Path) -> None:
    """Where the run is started stands something else by the name of what it is made of."""
    (tmp_path / "nicegui.py").write_text("raise RuntimeError('broken on purpose')\n")
    out = tmp_path / "out"
    run = Process("loopback", tmp_path, "loopback", "--dashboard", "--duration", "10", "--out", str(out))
    try:
        assert run.process.wait(90) == 0, run.log.read_text()
    finally:
        run.kill()
    assert armed_share(out) > 0.9
    assert "broken on purpose" in (out / "dashboard.log").read_text()


@pytest.mark.soak
def test_an_unused_port_and_a_taken_one(speaker: Speaker, tmp_path: Path) -> None:
    with dashboard(tmp_path, speaker) as served:
        words = ("dashboard", "--cell", CELL, "--connect", speaker.endpoint, "--port", str(served.port))
        other = Process("other", tmp_path, *words)
        assert other.process.wait(30) == 2
        assert other.log.read_text() == (
            f"forefeel: --port {served.port} at 127.0.0.1: Address already in use; expected a free one\n"
        )
        assert served.end() == 0
    ended = Process("brief", tmp_path, *words[:-1], str(free_port()), "--duration", "0.5")
    assert ended.process.wait(30) == 0
    assert MASTER_STATE.name not in ended.log.read_text()


def test_who_opens_the_page_of_a_loopback_at_once_is_not_refused(speaker: Speaker, tmp_path: Path) -> None:
    said: list[str] = []
    watched = Watched(False, said.append)
    watched.start(CELL, [speaker.endpoint], tmp_path)
    try:
        (address,) = re.findall(r"http://\S+", said[0])
        with urlopen(address, timeout=30.0) as answer:
            assert b"forefeel" in answer.read()
    finally:
        watched.end()
    with pytest.raises(URLError):
        urlopen(address, timeout=30.0).close()
