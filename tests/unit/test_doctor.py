"""`forefeel doctor`: every check green, amber and red, on a host that answers as the test says."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from unittest.mock import create_autospec

import pytest

from forefeel.doctor import checks as doctor
from forefeel.doctor.checks import LEVELS, Finding, Level
from forefeel.doctor.host import CellStates, ClockState, Disk, HostProbe, LoopCheck
from forefeel.master.settings import MasterSettings
from forefeel.probe.probe import Probed
from forefeel.reachability import Obstacle, Reached
from forefeel.slave.settings import SlaveSettings
from tests.secured import make_pki

Run = Callable[[Sequence[str]], int]
NOW = datetime(2026, 7, 1, tzinfo=UTC)
LISTEN = ("tls/0.0.0.0:7447",)
MS = 1_000_000
ZABER = {"driver": "zaber_ascii", "port": "/dev/x", "microstep_m": 1e-7, "travel_m": [-0.01, 0.13]}
READY = Probed("insertion", "stage", "zaber_ascii", "/dev/x", "ready", rate_hz=800.0)

LOOP = LoopCheck("SCHED_FIFO 50", "memory locked", 2000, 0, 20.0, 90.0, 300.0)
REACHED = Reached("tls/a:1", connect_s=1e-3, handshake_s=4e-3)
HEARD = CellStates([ClockState("slave", "insertion", True, 5 * MS, MS // 2)])
DISK = Disk(True, 0o700, 5e10)


def host(**found: object) -> Any:  # noqa: ANN401 - in place of a HostProbe
    """A host on which all is green but what is given, by the probe that finds it."""
    green: dict[str, object] = {
        "now": NOW, "running": None, "latched": {}, "loop": LOOP, "reach": REACHED, "states": HEARD,
        "probe": READY, "disk": DISK,
    }  # fmt: skip
    fake = create_autospec(HostProbe, instance=True)
    for name, answer in {**green, **found}.items():
        getattr(fake, name).return_value = answer
    return fake


def worst(found: Iterator[Finding]) -> Level:
    """Of findings that are whole: one line each, with advice where they are not green."""
    levels: list[Level] = ["green"]
    for each in found:
        assert each.group
        assert each.found
        assert "\n" not in each.found + each.advice
        assert bool(each.advice) == (each.level != "green"), each
        levels.append(each.level)
    return max(levels, key=LEVELS.index)


OPERATOR = {"driver": "operator"}


def network(mode: str = "peer", **changed: object) -> Iterator[Finding]:
    transport = {"connect": ["tcp/a:1"], "mode": mode}
    settings = MasterSettings.model_validate({"transport": transport, "axes": [{"handle": OPERATOR}]})
    return doctor.check_network(settings, host(**changed))


def clock(offset_ns: int | None, bound_ns: int | None, session: bool = True) -> Iterator[Finding]:
    return doctor.check_clocks(CellStates([ClockState("slave", "x", session, offset_ns, bound_ns)]))


def devices(section: dict[str, Any], **changed: object) -> Iterator[Finding]:
    settings = SlaveSettings.model_validate({"axes": [section]})
    probes = host(**changed)
    return doctor.check_devices(settings, probes.running(None), probes)


def loop(priority: int = 50, **changed: object) -> Iterator[Finding]:
    return doctor.check_loop(replace(LOOP, **changed), priority)  # type: ignore[arg-type]


def disk(writable: bool, mode: int | None, free_bytes: float) -> Iterator[Finding]:
    found = Disk(writable, mode, free_bytes)
    return doctor.check_disk(Path("/var/lib/forefeel"), host(disk=found))


def latch(**latched: str) -> Iterator[Finding]:
    cell = {"driver": "bota_serial", "port": "/dev/y", "full_scale_n": 10.0}
    settings = SlaveSettings.model_validate(
        {"axes": [{**STAGE, "load_cell": cell | {"filter_lag_s": 0.001, "pushes_only": True}}]}
    )
    return doctor.check_latch(settings, latched)


NO_ANSWER = Reached("tcp/a:1", obstacle=Obstacle("no answer from a:1", "check the cable"))
STAGE = {"stage": ZABER, "load_cell": {"driver": "simulated"}, "gripper": {"driver": "simulated"}}
TABLE: list[tuple[str, Level, Callable[[], Iterator[Finding]]]] = [
    ("reached", "green", network),
    ("not tried", "amber", lambda: network(reach=Reached("tcp/a:1"))),
    ("not reached", "red", lambda: network(reach=NO_ANSWER)),
    ("router for a peer", "red", lambda: network(states=CellStates(hint="a router answers there"))),
    ("nobody heard", "amber", lambda: network(states=CellStates(error="no router answers"))),
    ("no endpoint", "red", lambda: doctor.check_network(SlaveSettings(), host())),
    ("clock good", "green", lambda: clock(5 * MS, 999_999)),
    ("clock acceptable", "green", lambda: clock(5 * MS, 10 * MS)),
    ("clock poor", "amber", lambda: clock(5 * MS, 10 * MS + 1)),
    ("clock without session", "amber", lambda: clock(None, None, session=False)),
    ("clock not compared", "red", lambda: clock(None, None)),
    ("loop", "green", loop),
    ("loop without priority", "green", lambda: loop(0, scheduling="normal scheduling")),
    ("loop not permitted", "amber", lambda: loop(scheduling="normal scheduling")),
    ("loop not locked", "amber", lambda: loop(memory="memory not locked")),
    ("loop late", "amber", lambda: loop(p99_us=251.0)),
    ("loop misses", "amber", lambda: loop(missed=3)),
    ("loop too late", "red", lambda: loop(p99_us=1001.0)),
    ("loop misses many", "red", lambda: loop(missed=21)),
    ("no loop", "red", lambda: loop(ticks=0)),
    ("simulated", "green", lambda: devices({})),
    ("device", "green", lambda: devices(STAGE)),
    ("port slow", "amber", lambda: devices(STAGE, probe=replace(READY, warning="timer 16 ms"))),
    ("device with flaws", "amber", lambda: devices(STAGE, probe=replace(READY, invalid=3))),
    ("busy", "amber", lambda: devices(STAGE, probe=replace(READY, verdict="refused", error="busy"))),
    ("without", "amber", lambda: doctor.check_caveats(SlaveSettings.model_validate({"axes": [STAGE]}))),
    ("without anything", "green", lambda: doctor.check_caveats(SlaveSettings())),
    ("silent", "red", lambda: devices(STAGE, probe=replace(READY, verdict="failed", error="no answer"))),
    ("daemon runs", "amber", lambda: devices(STAGE, running=7, probe=replace(READY, verdict="failed"))),
    ("latched", "red", lambda: latch(insertion="load cell pulls in the first contact")),
    ("sign not told", "green", latch),
    ("state", "green", lambda: disk(True, 0o700, 5e10)),
    ("state to come", "green", lambda: disk(True, None, 5e10)),
    ("state that others read", "amber", lambda: disk(True, 0o755, 5e10)),
    ("state that others write", "red", lambda: disk(True, 0o770, 5e10)),
    ("state not ours", "red", lambda: disk(False, None, 5e10)),
    ("disk filling", "amber", lambda: disk(True, 0o700, 1.9e9)),
    ("disk full", "red", lambda: disk(True, 0o700, 1.9e8)),
]


@pytest.mark.parametrize(("level", "check"), [row[1:] for row in TABLE], ids=[row[0] for row in TABLE])
def test_check_is_as_bad_as_what_it_finds(level: Level, check: Callable[[], Iterator[Finding]]) -> None:
    assert worst(check()) == level


@pytest.mark.parametrize(
    ("transport", "days", "level"),
    [
        ({"listen": ["tcp/127.0.0.1:1"]}, 0, "green"),
        ({"listen": ["tcp/0.0.0.0:1"]}, 0, "red"),
        ({"listen": LISTEN, "pki": "pki"}, 0, "green"),
        ({"listen": [*LISTEN, "tcp/0.0.0.0:1"], "pki": "pki"}, 0, "red"),
        ({"listen": ["tls/10.0.0.1:7447"], "pki": "pki"}, 0, "green"),
        ({"listen": ["tls/10.0.0.2:7447"], "pki": "pki"}, 0, "red"),
        ({"listen": LISTEN, "pki": "pki"}, 70, "green"),
        ({"listen": LISTEN, "pki": "pki"}, 71, "amber"),
        ({"listen": LISTEN, "pki": "pki"}, 101, "red"),
        ({"listen": LISTEN, "pki": "none"}, 0, "red"),
    ],
)
def test_certificates_are_valid_and_name_the_host(
    tmp_path: Path, transport: dict[str, Any], days: int, level: Level
) -> None:
    make_pki(tmp_path / "pki", ["c"], {"slave": ["10.0.0.1"]}, NOW, 100)
    (tmp_path / "pki" / "ca.key").unlink()
    if "pki" in transport:
        transport = {**transport, "pki": tmp_path / transport["pki"]}
    settings = SlaveSettings.model_validate({"cell": "c", "transport": transport})
    assert worst(doctor.check_certificates(settings, host(now=NOW + timedelta(days=days)))) == level


def test_clocks_are_asked_over_the_daemons_own_way() -> None:
    probes = host()
    both_ways = {"connect": ["tcp/a:1"], "listen": ["tcp/0.0.0.0:7447"]}
    for transport in (both_ways, {"mode": "client", "connect": ["tcp/a:1"]}):
        list(doctor.check_network(SlaveSettings.model_validate({"transport": transport}), probes))
    peer, client = (asked.args[0] for asked in probes.states.call_args_list)
    assert (peer.mode, peer.connect, peer.listen) == ("peer", ("tcp/a:1", "tcp/127.0.0.1:7447"), ())
    assert (client.mode, client.connect) == ("client", ("tcp/a:1",))


def test_sign_of_a_cell_is_told_by_what_the_last_run_latched_or_not_at_all(tmp_path: Path) -> None:
    reason = "load cell pulls in the first contact: its sign is wrong; change load_cell.sign"
    (tmp_path / "latched.json").write_text(json.dumps({"latched": {"insertion": reason}}))
    assert [each.found for each in latch(**HostProbe().latched(tmp_path))] == [f"latched: {reason}"]
    (unknown,) = latch(**HostProbe().latched(tmp_path / "none"))
    assert unknown.found.startswith("not told without a motion")


def test_a_state_folder_that_one_may_not_look_at_is_judged_by_the_one_around_it(tmp_path: Path) -> None:
    found = HostProbe().disk(tmp_path / ("a" * 300) / "slave")  # as of no permission, which root always has
    assert (found.writable, found.mode) == (True, None)


def test_a_state_folder_is_not_made_in_a_file(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert not HostProbe().disk(tmp_path / "file" / "slave").writable


@pytest.mark.parametrize(("reached", "code"), [(REACHED, 0), (NO_ANSWER, 1)])
def test_red_alone_fails(
    run: Run,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    reached: Reached,
    code: int,
) -> None:
    monkeypatch.setattr("forefeel.doctor.host.HostProbe", lambda: host(reach=reached))
    (tmp_path / "master.yaml").write_text("role: master\ntransport: {connect: ['tcp/127.0.0.1:9']}\n")
    line = ["doctor", "--config", str(tmp_path / "master.yaml")]
    assert run(line) == code
    assert "free space" in capsys.readouterr().out
    assert run([*line, "--json"]) == code
    document = json.loads(capsys.readouterr().out)
    levels = [each["level"] for each in document["findings"]]
    assert document["worst"] == ("red" if code else "green")
    assert document["counts"] == {level: levels.count(level) for level in LEVELS}
    groups = {each["group"] for each in document["findings"]}
    assert groups == {"certificates", "network", "clock", "devices", "disk", "versions", "real time"}
