"""`forefeel record` beside an end that speaks, and beside nobody."""

import socket
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from common.clock import MonotonicClock
from common.codec import encode
from common.recording.mcap_reader import read_run
from common.topics import FORCE
from common.transport.settings import TransportSettings
from common.transport.zenoh_bus import ZenohTransport
from tests.unit.recording_samples import force


def test_a_recording_of_nobody_is_no_recording(
    run: Callable[[Sequence[str]], int],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.setattr("forefeel.record._REMIND_S", 0.2)
    line = f"record --connect tcp/127.0.0.1:9 --out {tmp_path}/run.mcap --duration 0.5"
    assert run(line.split()) == 1
    _, *waiting, last = capsys.readouterr().err.splitlines()
    assert waiting == ["nobody heard yet at tcp/127.0.0.1:9 (0 s)"] * len(waiting) != []
    assert last == (
        f"forefeel: {tmp_path}/run.mcap: nothing was recorded, "
        "nobody of cell cell was heard at tcp/127.0.0.1:9"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_recording_says_what_it_holds_and_what_it_could_not_write(
    run: Callable[[Sequence[str]], int], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    clock, ended = MonotonicClock(), threading.Event()
    slave = ZenohTransport.open(TransportSettings(listen=(endpoint,)), clock, lambda _: None)
    put = slave.publisher(FORCE.key("cell", "insertion"), FORCE.qos)

    def speak() -> None:
        while not ended.wait(0.01):
            put(encode(force(1)))
            put(b"nonsense")

    thread = threading.Thread(target=speak)
    thread.start()
    try:
        assert run(f"record --connect {endpoint} --out {tmp_path}/run.mcap --duration 2".split()) == 0
    finally:
        ended.set()
        thread.join()
        slave.close()
    said = capsys.readouterr().err.splitlines()[-1]
    recorded = read_run(tmp_path / "run.mcap")
    malformed = int(recorded.metadata["recorder"]["malformed"])
    assert malformed > 0
    assert said == (
        f"{tmp_path}/run.mcap: closed, {recorded.count('insertion', FORCE)} messages, {malformed} malformed"
    )
