"""`forefeel doctor` as a person and a script use it; once for real, with a slave that answers."""

import json
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from forefeel.common.bus import Bus
from forefeel.common.clock import MonotonicClock
from forefeel.common.messages import Grip, SafetyState, SlaveState
from forefeel.common.topics import SLAVE_STATE
from forefeel.common.transport.security import Party
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_bus import ZenohTransport
from forefeel.daemon_settings import load_daemon
from forefeel.doctor import examine as examining
from forefeel.doctor.findings import Finding
from forefeel.probe.configured import ConfiguredDevice
from forefeel.probe.probe import Probed
from tests.secured import make_pki

Run = Callable[[Sequence[str]], int]


@contextmanager
def slave_in_session(endpoint: str, pki: Path) -> Iterator[None]:
    """Publishes the state of a slave whose clock is compared to 0.2 ms."""
    clock, ended = MonotonicClock(), threading.Event()
    settings = TransportSettings(listen=(endpoint,), pki=pki)
    transport = ZenohTransport.open(settings, clock, lambda _: None, Party("slave", ("cathlab",)))
    publisher = Bus(transport, "cathlab", "insertion", clock).publisher(SLAVE_STATE)

    def publish() -> None:
        while not ended.wait(0.02):
            publisher.send(
                SlaveState(
                    **publisher.header(7, clock.now_ns()),
                    state=SafetyState.READY,
                    reason="",
                    position_m=0.0,
                    velocity_m_s=0.0,
                    gripper=Grip.CLOSED,
                    stops=0,
                    clock_offset_ns=1_500_000,
                    clock_bound_ns=200_000,
                    counters={},
                )
            )

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        transport.close()


def test_a_host_is_looked_at_for_real(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr("forefeel.doctor.realtime.SECONDS", 0.5)
    make_pki(tmp_path / "pki", ["cathlab"], {"slave": ["10.0.0.1"]}, days=100)
    with socket.create_server(("127.0.0.1", 0)) as probe:
        endpoint = f"tls/127.0.0.1:{probe.getsockname()[1]}"
    common = "cell: cathlab\nrealtime: {priority: 0}\ntransport: {pki: pki, "
    (tmp_path / "master.yaml").write_text(f"role: master\n{common}connect: ['{endpoint}']}}\n")
    with slave_in_session(endpoint, tmp_path / "pki"):
        code = run(["doctor", "--config", str(tmp_path / "master.yaml"), "--json"])
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert found["schema"] == "forefeel.doctor/1"
    lines = {(each["group"], each["subject"]): each for each in found["findings"]}
    green = {place for place, each in lines.items() if each["level"] == "green"}
    assert green >= {
        ("settings", "master.yaml"),
        ("certificates", "master's traffic"),
        ("certificates", "forefeel-cathlab-master"),
        ("certificates", "forefeel-cathlab-master, key"),
        ("access control", "master says master/command"),
        ("access control", "master says slave/force"),
        ("access control", "another master speaks to it"),
        ("network", endpoint),
        ("clock", "slave, axis insertion"),
        ("real time", "scheduling"),
        ("storage", "state folder"),
        ("software", "forefeel"),
    }
    assert lines["clock", "slave, axis insertion"]["found"] == "offset 1.500 ms, known to 0.200 ms: good"
    assert lines["certificates", "authority"]["level"] == "amber"  # ca.key lies there
    assert found["counts"] == {
        level: sum(each["level"] == level for each in found["findings"])
        for level in ("green", "amber", "red")
    }
    assert code == (found["worst"] == "red")


FOUND = [
    Finding("settings", "slave.yaml", "green", "loads"),
    Finding("clock", "x", "amber", "poor", "wait"),
    Finding("network", "y", "red", "no [answer]", "start it"),
]


@pytest.mark.parametrize(("count", "code"), [(0, 0), (1, 0), (2, 0), (3, 1)])
def test_red_alone_fails(
    run: Run, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, count: int, code: int
) -> None:
    monkeypatch.setattr("forefeel.doctor.run.examine", lambda *_: FOUND[:count])
    assert run(["doctor"]) == code
    out = capsys.readouterr().out
    assert f"{min(count, 1)} green, {int(count > 1)} amber, {int(count > 2)} red" in out
    assert ("no [answer]" in out) == (count == 3)
    assert run(["doctor", "--json"]) == code
    document = json.loads(capsys.readouterr().out)
    assert [each["level"] for each in document["findings"]] == ["green", "amber", "red"][:count]
    assert document["worst"] == (["green", "green", "amber", "red"][count])


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["none.yaml"], "none.yaml: no such file"),
        (["a.yaml", "b.yaml"], "another slave"),
        (["."], "no such file"),
    ],
)
def test_wrong_input_is_one_line_and_exit_2(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str], names: list[str], words: str
) -> None:
    for name in ("a.yaml", "b.yaml"):
        (tmp_path / name).write_text("role: slave\n")
    arguments = [word for name in names for word in ("--config", str(tmp_path / name))]
    assert run(["doctor", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert words in error


def test_devices_are_left_to_the_daemon_that_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = "{driver: zaber_ascii, port: /dev/none, microstep_m: 1.0e-7, travel_m: [-0.01, 0.13]}"
    path = tmp_path / "slave.yaml"
    path.write_text(f"role: slave\naxes: [{{stage: {stage}}}]\n")
    asked = list[ConfiguredDevice]()

    def probe(found: Sequence[ConfiguredDevice]) -> list[Probed]:
        asked.extend(found)
        return []

    monkeypatch.setattr("forefeel.doctor.devices.probe_devices", probe)
    settings = load_daemon(path)
    for process in (4711, None):
        end = examining.End("slave", settings, tmp_path, process)
        levels = {each.subject: each.level for each in examining._devices(end)}
        assert levels["/dev/none"] == "red"
        assert ("slave's devices" in levels) == (process is not None)
        assert bool(asked) == (process is None)
