"""A browser, a process that serves the page, and a cell that speaks over real Zenoh."""

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
from playwright.sync_api import Browser, sync_playwright

from forefeel.common.clock import MonotonicClock
from forefeel.common.codec import encode
from forefeel.common.messages import Message
from forefeel.common.topics import BY_NAME, Topic
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_bus import ZenohTransport
from tests.dashboard.said import CELL, MS, Spoken, talk
from tests.live_cell import Process, free_port
from tests.waiting import wait_until

CHROMIUM = Path("/usr/bin/chromium")
LINK = re.compile(r" at (http://\S+); Ctrl-C")
_TICKS_AT_ONCE = 5
_FEW_FRAMES_MS = 200


@contextmanager
def browser(folder: Path) -> Iterator[Browser]:
    """Debian's chromium, below what is tested and above other work of the machine, which would starve it; as
    root without what lets it raise its own priority.
    """
    if not CHROMIUM.exists():
        pytest.skip(f"{CHROMIUM} is missing: apt-get install chromium")
    root = os.geteuid() == 0
    start = folder / "chromium"
    drop = "setpriv --bounding-set -sys_nice " if root else ""
    start.write_text(f'#!/bin/sh\nexec {drop}nice -n 5 {CHROMIUM} "$@"\n')
    start.chmod(0o755)
    with sync_playwright() as driver:
        found = driver.chromium.launch(executable_path=str(start), args=["--no-sandbox"] if root else [])
        try:
            yield found
        finally:
            found.close()


class Speaker:
    """A slave and a master in one: what `talk` says, by the clock. `changes`: fields of messages by topic."""

    def __init__(self, axes: tuple[str, ...] = ("insertion",)) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.changes: dict[str, dict[str, Any]] = {}
        self.silent = False
        self._axes, self._ended = axes, threading.Event()
        clock = MonotonicClock()
        self._transport = ZenohTransport.open(
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
        self._transport.close()

    def say(self, topic: Topic[Any], message: Message, axis: str = "insertion") -> None:
        """One message, at once."""
        key = topic.key(CELL, axis)
        if key not in self._puts:
            self._puts[key] = self._transport.publisher(key, topic.qos)
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

    def __init__(self, folder: Path, *words: str, port: int | None = None) -> None:
        self.port = port or free_port()
        self.process = Process(f"served-{self.port}", folder, *words, "--port", str(self.port))
        wait_until(lambda: LINK.search(self.process.log.read_text()), 30.0, "the link of the page")
        self.url = LINK.findall(self.process.log.read_text())[0]

    def __enter__(self) -> "Served":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()

    def end(self) -> int:
        """As Ctrl-C and systemd end it; its exit code."""
        self.process.send(signal.SIGTERM)
        return self.process.process.wait(20)

    @property
    def cpu_s(self) -> float:
        fields = Path(f"/proc/{self.process.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class Shown:
    """One open page."""

    def __init__(self, chromium: Browser, url: str, width: int = 1280, height: int = 800) -> None:
        self.context = chromium.new_context(viewport={"width": width, "height": height})
        self.page = self.context.new_page()
        self.asked: set[str] = set()
        self.errors: list[str] = []
        self.page.on("request", lambda request: self.asked.add(request.url))
        self.page.on("websocket", lambda socket: self.asked.add(socket.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(url)

    def __enter__(self) -> "Shown":
        return self

    def __exit__(self, *_: object) -> None:
        self.context.close()

    def text(self, field: str) -> str:
        """What stands there."""
        return str(self.page.locator(f'[data-field="{field}"]').first.inner_text())

    def light(self, name: str) -> str:
        return str(self.page.locator(f'[data-light="{name}"]').inner_text(timeout=60_000))

    def ask(self, script: str) -> Any:  # noqa: ANN401 - whatever the script gives
        return self.page.evaluate(script)

    def until(self, condition: Callable[[], object], what: str, timeout_s: float = 20.0) -> None:
        """Waits while the page goes on; AssertionError when it does not come."""
        end_s = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < end_s, f"not within {timeout_s:g} s: {what}; errors {self.errors}"
            self.page.wait_for_timeout(_FEW_FRAMES_MS)

    def picture(self, path: Path) -> None:
        """As it looks now."""
        path.write_bytes(self.page.screenshot())

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
        session = self.context.new_cdp_session(self.page)
        session.send("HeapProfiler.collectGarbage")
        session.send("Performance.enable")
        metrics = {each["name"]: each["value"] for each in session.send("Performance.getMetrics")["metrics"]}
        session.detach()
        return float(metrics["JSHeapUsedSize"]) / 2**20
