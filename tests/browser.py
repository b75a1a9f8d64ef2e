"""A browser, the live page as a process, and a cell that speaks to it over real Zenoh."""

import os
import re
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Playwright, sync_playwright

from forefeel.common.clock import MonotonicClock
from forefeel.common.codec import encode
from forefeel.common.messages import Message
from forefeel.common.topics import BY_NAME, Topic
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_bus import ZenohTransport
from tests.live_cell import Process, free_port
from tests.unit.dashboard.talk import CELL, MS, Spoken, talk
from tests.waiting import PATIENCE_S, wait_until

CHROMIUM = Path("/usr/bin/chromium")
LINK = re.compile(r" at (http://\S+); Ctrl-C")
_TICKS_AT_ONCE = 5
_FEW_FRAMES_MS = 200


class Chromium:
    """Debian's chromium; as root without what lets it raise its own priority."""

    def __init__(self, driver: Playwright, folder: Path) -> None:
        self._driver, self._start, self._pid = driver, folder / "chromium", folder / "pid"
        self._arguments = ["--disable-gpu"]  # a machine of tests has none, and would play one in software
        drop = ""
        if os.geteuid() == 0:
            drop = "setpriv --bounding-set -sys_nice "
            self._arguments.append("--no-sandbox")
        self._start.write_text(f'#!/bin/sh\necho $$ > {self._pid}\nexec {drop}{CHROMIUM} "$@"\n')
        self._start.chmod(0o755)

    def launch(self) -> tuple[Browser, int]:
        """A browser of its own and its process group."""
        found = self._driver.chromium.launch(executable_path=str(self._start), args=self._arguments)
        return found, int(self._pid.read_text())


@contextmanager
def installed_chromium(folder: Path) -> Iterator[Chromium]:
    """As it is started; skips where it is missing."""
    if not CHROMIUM.exists():
        pytest.skip(f"{CHROMIUM} is missing: apt-get install chromium")
    with sync_playwright() as driver:
        yield Chromium(driver, folder)


class Speaker:
    """A slave and a master in one: what `talk` says, by the clock. `changes`: fields of messages by topic."""

    def __init__(self, axes: tuple[str, ...] = ("insertion",)) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.changes: dict[str, dict[str, Any]] = {}
        self.silent = False
        self._axes, self._ended = axes, threading.Event()
        clock = MonotonicClock()
        self.transport = ZenohTransport.open(
            TransportSettings(listen=(self.endpoint,)), clock, lambda _: None
        )
        self._puts: dict[str, Any] = {}
        self._thread = threading.Thread(target=self._speak, name="speaker")

    def __enter__(self) -> "Speaker":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self.transport.close()

    def say(self, topic: Topic[Any], message: Message, axis: str = "insertion") -> None:
        """One message, at once."""
        key = topic.key(CELL, axis)
        if key not in self._puts:
            self._puts[key] = self.transport.publisher(key, topic.qos)
        self._puts[key](encode(message))

    def _speak(self) -> None:
        start_ns, said = time.monotonic_ns(), 1
        while not self._ended.wait(_TICKS_AT_ONCE * 1e-3):
            due = (time.monotonic_ns() - start_ns) // MS
            for spoken in talk(said, due, start_ns):
                if not self.silent:
                    self._pass_on(spoken)
            said = max(said, due)

    def _pass_on(self, spoken: Spoken) -> None:
        topic, message, _ = spoken
        changes = self.changes.get(topic.name)
        changed = message.model_copy(update=changes) if changes else message
        for axis in self._axes:
            self.say(BY_NAME[topic.name], changed, axis)


class Served:
    """`forefeel dashboard` or `forefeel view` as a process."""

    def __init__(self, folder: Path, *words: str) -> None:
        self.port = free_port()
        self.process = Process(f"served-{self.port}", folder, *words, "--port", str(self.port))
        wait_until(lambda: LINK.search(self.process.text), PATIENCE_S, "the link of the page")
        self.url = LINK.findall(self.process.text)[0]

    def __enter__(self) -> "Served":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()


class Shown:
    """One open page, in a browser of its own.

    At the end the browser is killed, not asked to close its page: chromium was seen never to answer that.
    """

    def __init__(self, chromium: Chromium, url: str) -> None:
        self._browser, self._group = chromium.launch()
        self.page = self._browser.new_page(viewport={"width": 1280, "height": 800})
        self.page.set_default_timeout(1e3 * PATIENCE_S)  # the server behind all others loads the page, too
        self.asked: set[str] = set()
        self.errors: list[str] = []
        self.page.on("request", lambda request: self.asked.add(request.url))
        self.page.on("websocket", lambda socket: self.asked.add(socket.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(url)

    def __enter__(self) -> "Shown":
        return self

    def __exit__(self, *_: object) -> None:
        os.killpg(self._group, signal.SIGKILL)
        self._browser.close()

    def text(self, field: str) -> str:
        """What stands there."""
        return str(self.page.locator(f'[data-field="{field}"]').first.inner_text())

    def light(self, name: str) -> str:
        return str(self.page.locator(f'[data-light="{name}"]').inner_text(timeout=1e3 * PATIENCE_S))

    def ask(self, script: str) -> Any:  # noqa: ANN401 - whatever the script gives
        return self.page.evaluate(script)

    def until(self, condition: Callable[[], object], what: str, timeout_s: float = PATIENCE_S) -> None:
        """Waits while the page goes on; AssertionError when it does not come."""
        end_s = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < end_s, f"not within {timeout_s:g} s: {what}; {self._state()}"
            self.page.wait_for_timeout(_FEW_FRAMES_MS)

    def _state(self) -> str:
        """What the page knows of itself, for who reads why a test failed."""
        known = "facts", "axes", "updates", "drawn", "lost_ms", "silence", "paused"
        own = self.ask(f"window.forefeel && {list(known)}.map((each) => [each, window.forefeel[each]])")
        lights = self.page.locator("[data-light]").all_inner_texts()
        return f"the page: {own}; lights {lights}; errors {self.errors}"

    def drawing(self) -> None:
        """Until it shows what comes."""
        self.until(lambda: self.ask("window.forefeel?.updates > 5"), "updates")

    def rate_hz(self, seconds: float) -> float:
        """Updates drawn a second."""
        start_s, before = time.monotonic(), self.ask("forefeel.drawn")
        self.page.wait_for_timeout(1000 * seconds)
        drawn = self.ask("forefeel.drawn") - before
        return float(drawn) / (time.monotonic() - start_s)

    def heap_mb(self) -> float:
        """The script's memory after a collection."""
        session = self.page.context.new_cdp_session(self.page)
        session.send("HeapProfiler.collectGarbage")
        session.send("Performance.enable")
        metrics = {each["name"]: each["value"] for each in session.send("Performance.getMetrics")["metrics"]}
        session.detach()
        return float(metrics["JSHeapUsedSize"]) / 2**20
