"""`forefeel record` beside an end that speaks, and beside nobody."""

import re
import signal
import socket
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from datetime import date
from pathlib import Path

import pytest
import yaml

from forefeel.common.clock import MonotonicClock
from forefeel.common.codec import encode
from forefeel.common.recording.mcap_reader import read_run
from forefeel.common.topics import CALIBRATION, FORCE
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_bus import ZenohTransport
from tests.process.test_processes import Daemon, free_endpoint
from tests.unit.recording_samples import force
from tests.waiting import wait_until
from tests.witness import Witness


def test_a_recording_of_nobody_is_no_recording(
    run: Callable[[Sequence[str]], int],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    witness: Witness,
) -> None:
    monkeypatch.setattr("forefeel.waiting.EVERY_NS", 200_000_000)
    line = f"record --connect tcp/127.0.0.1:9 --out {tmp_path}/run.mcap --duration 0.5"
    assert run(line.split()) == 1
    _, *waiting, last = capsys.readouterr().err.splitlines()
    refused = r"nobody heard yet: 127\.0\.0\.1:9 refuses the connection: start the daemon there \((\S+) s\)"
    found = [re.fullmatch(refused, line) for line in waiting]
    assert None not in found
    with witness.timely(0.3):
        assert found
        assert all(float(each[1]) < 1.0 for each in found if each)
    assert last == (
        f"forefeel: {tmp_path}/run.mcap: nothing was recorded, nobody of cell cell was heard at 127.0.0.1:9"
    )
    assert list(tmp_path.iterdir()) == []


def kill(daemons: list[Daemon]) -> None:
    for daemon in daemons:
        daemon.process.kill()


@pytest.mark.soak
def test_a_recorder_that_joins_late_gets_the_calibration_that_the_slave_has_loaded(
    run: Callable[[Sequence[str]], int], tmp_path: Path
) -> None:
    """Four processes in the field, three here: the emulated cell and the slave by themselves."""
    endpoint, config = free_endpoint(), tmp_path / "slave.yaml"
    port = tmp_path / "cell"
    calibration = {
        "format": "forefeel.load_cell_calibration/1", "driver": "bota_serial", "serial": "B-7",
        "date": date.today(), "gain_n": 1.02, "zero": -0.25, "residual_n": 0.001, "hysteresis_n": 0.002,
        "range_n": [0.0, 3.0], "points": [[0.0, 0.0], [1.0, 1.02]],
    }  # fmt: skip
    (tmp_path / "calibration.yaml").write_text(yaml.safe_dump(calibration))
    cell = {
        "driver": "bota_serial", "port": str(port), "full_scale_n": 10.0, "rate_hz": 100, "serial": "B-7",
        "calibration": "calibration.yaml",
    }  # fmt: skip
    slave = {"transport": {"listen": [endpoint]}, "axes": [{"load_cell": cell}]}
    config.write_text(yaml.safe_dump({"role": "slave", **slave}))
    (tmp_path / "words").mkdir()
    words = ["--config", str(config)]
    processes = [Daemon(tmp_path / "words", "emulate", "bota_serial", *words)]
    with ExitStack() as left:  # none outlives the test, however that ends
        left.callback(kill, processes)
        wait_until(lambda: processes[0].says("bota_serial on"))
        processes.append(Daemon(tmp_path / "words", "slave", *words))
        wait_until(lambda: processes[1].says("waiting for a master"))
        out = tmp_path / "run.mcap"
        assert run(f"record --connect {endpoint} --out {out} --duration 2.5".split()) == 0
        ended = [process.end(signal.SIGTERM)[0] for process in reversed(processes)]
    assert ended == [0, 0]
    told = list(read_run(out).messages("insertion", CALIBRATION))
    assert {(t.slot, t.driver, t.serial, t.gain_n, t.zero, t.date) for t in told} == {
        ("load_cell", "bota_serial", "B-7", 1.02, -0.25, date.today().isoformat())
    }
    assert 1 <= len(told) <= 2


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
