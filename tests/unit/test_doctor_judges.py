"""What the doctor makes of what it measured: every check green, amber and red."""

from collections.abc import Callable
from datetime import date
from errno import EADDRINUSE, EADDRNOTAVAIL
from pathlib import Path

import pytest

from forefeel.common.settings import DaemonSettings
from forefeel.common.topics import Role
from forefeel.doctor.access import Tried, judge_access
from forefeel.doctor.calibrations import Calibrated, judge_calibration
from forefeel.doctor.certificates import Certificate, judge_certificate, judge_exposure
from forefeel.doctor.clocks import (
    Compared,
    Discipline,
    judge_clocks,
    judge_discipline,
    parse_chrony,
    parse_ptp,
)
from forefeel.doctor.devices import CanBus, Port, judge_can, judge_port, judge_probed, judge_running
from forefeel.doctor.findings import Finding, Level, worst
from forefeel.doctor.network import Bound, judge_endpoints, judge_listen, judge_reached
from forefeel.doctor.realtime import Kernel, Loop, judge_kernel, judge_loop
from forefeel.doctor.settings import judge_agreement, load_files
from forefeel.doctor.software import Package, judge_software
from forefeel.doctor.storage import Folder, judge_folder
from forefeel.probe.probe import Probed, Quantiles
from forefeel.reachability import Obstacle, Reached

MS = 1_000_000
TODAY = date(2026, 7, 1)
NO_ANSWER = Obstacle("no answer from a:1", "check the cable", silent=True)
LISTEN = ("tls/0.0.0.0:7447",)


def certificate(**changed: object) -> Certificate:
    usual = {"days_left": 300, "hosts": ("10.0.0.1",), "folder_mode": 0o700, "key_mode": 0o600}
    return Certificate("forefeel-cathlab-slave", "pki", **{**usual, **changed})  # type: ignore[arg-type]


def loop(**changed: object) -> Loop:
    usual = {"scheduling": "SCHED_FIFO 50", "memory": "memory locked", "ticks": 2000, "missed": 0}
    figures = {"p50_us": 20.0, "p99_us": 90.0, "max_us": 300.0}
    return Loop(**{**usual, **figures, **changed})  # type: ignore[arg-type]


def folder(**changed: object) -> Folder:
    usual = {"exists": True, "writable": True, "mode": 0o700, "free_mb": 5e4, "write_mb_s": 90.0}
    return Folder(Path("/var/lib/forefeel"), **{**usual, **changed})  # type: ignore[arg-type]


def transport(**settings: object) -> DaemonSettings:
    return DaemonSettings.model_validate({"transport": settings})


def probed(**changed: object) -> Probed:
    usual = {
        "axis": "insertion",
        "slot": "stage",
        "driver": "zaber_ascii",
        "where": "/dev/x",
        "verdict": "ready",
    }
    return Probed(**{**usual, **changed})  # type: ignore[arg-type]


Judged = Callable[[], list[Finding]]
ZENOH = Package("eclipse-zenoh", ">=1.10,<2", "1.10.2")
TABLE: list[tuple[str, Level, Judged]] = [
    # --- certificates ---
    ("exposed, loopback", "green", lambda: [judge_exposure(transport(listen=["tcp/127.0.0.1:1"]), "slave")]),
    ("exposed, secured", "green", lambda: [judge_exposure(transport(listen=LISTEN, pki="/pki"), "slave")]),
    ("exposed, plain", "red", lambda: [judge_exposure(transport(listen=["tcp/0.0.0.0:1"]), "slave")]),
    (
        "exposed, plain beside tls",
        "red",
        lambda: [judge_exposure(transport(listen=[*LISTEN, "tcp/0.0.0.0:1"], pki="/pki"), "slave")],
    ),
    ("certificate", "green", lambda: judge_certificate(certificate(), LISTEN)),
    ("certificate, 30 days", "green", lambda: judge_certificate(certificate(days_left=30), LISTEN)),
    ("certificate, 29 days", "amber", lambda: judge_certificate(certificate(days_left=29), LISTEN)),
    ("certificate expired", "red", lambda: judge_certificate(certificate(error="expired"), LISTEN)),
    ("certificate, its address", "green", lambda: judge_certificate(certificate(), ["tls/10.0.0.1:7447"])),
    ("certificate, other address", "red", lambda: judge_certificate(certificate(), ["tls/10.0.0.2:7447"])),
    ("certificate of no host", "red", lambda: judge_certificate(certificate(hosts=()), LISTEN)),
    ("certificate of a client", "green", lambda: judge_certificate(certificate(hosts=()), ())),
    ("certificate on loopback", "green", lambda: judge_certificate(certificate(hosts=()), ["tls/[::1]:1"])),
    ("key of a group", "amber", lambda: judge_certificate(certificate(key_mode=0o640), LISTEN)),
    ("key of everyone", "red", lambda: judge_certificate(certificate(key_mode=0o644), LISTEN)),
    ("folder of everyone", "red", lambda: judge_certificate(certificate(folder_mode=0o777), LISTEN)),
    ("authority's key here", "amber", lambda: judge_certificate(certificate(signs=True), LISTEN)),
    # --- access control ---
    ("rules work", "green", lambda: judge_access(Tried(own_passes=True), "slave")),
    ("rules not tried", "amber", lambda: judge_access(Tried(error="no certificate"), "slave")),
    ("own is refused", "red", lambda: judge_access(Tried(), "master")),
    ("forbidden passes", "red", lambda: judge_access(Tried(True, True), "master")),
    ("a stranger passes", "red", lambda: judge_access(Tried(True, False, True), "slave")),
    # --- network ---
    ("endpoints", "green", lambda: judge_endpoints(LISTEN, ())),
    ("no endpoint", "red", lambda: judge_endpoints((), ())),
    ("reached", "green", lambda: [judge_reached(Reached("tls/a:1", connect_s=1e-3, handshake_s=4e-3))]),
    ("not tried", "amber", lambda: [judge_reached(Reached("quic/a:1", tried=False))]),
    ("not reached", "red", lambda: [judge_reached(Reached("tcp/a:1", obstacle=NO_ANSWER))]),
    ("port free", "green", lambda: [judge_listen(Bound("tcp/a:1", 0), False)]),
    ("port ours", "green", lambda: [judge_listen(Bound("tcp/a:1", EADDRINUSE), True)]),
    ("port taken", "amber", lambda: [judge_listen(Bound("tcp/a:1", EADDRINUSE), False)]),
    ("port of another host", "red", lambda: [judge_listen(Bound("tcp/a:1", EADDRNOTAVAIL), True)]),
    # --- clocks ---
    ("clock good", "green", lambda: judge_clocks([Compared("slave", "x", True, 5 * MS, 999_999)])),
    ("clock acceptable", "green", lambda: judge_clocks([Compared("slave", "x", True, 5 * MS, 10 * MS)])),
    ("clock poor", "amber", lambda: judge_clocks([Compared("slave", "x", True, 5 * MS, 10 * MS + 1)])),
    ("clock, nobody", "amber", lambda: judge_clocks([])),
    ("clock, no session", "amber", lambda: judge_clocks([Compared("slave", "x", False, None, None)])),
    ("clock, uncompared", "red", lambda: judge_clocks([Compared("slave", "x", True, None, None)])),
    ("chrony", "green", lambda: judge_discipline([Discipline("chrony", 1e-4, True)])),
    ("chrony far off", "amber", lambda: judge_discipline([Discipline("chrony", -0.2, True)])),
    ("chrony alone", "red", lambda: judge_discipline([Discipline("chrony", 0.0, False)])),
    ("no chrony", "amber", lambda: judge_discipline([])),
    # --- real time ---
    ("loop", "green", lambda: judge_loop(loop(), 50)),
    ("loop, not wanted", "green", lambda: judge_loop(loop(scheduling="normal scheduling"), 0)),
    ("loop, not permitted", "amber", lambda: judge_loop(loop(scheduling="normal scheduling"), 50)),
    ("loop, not locked", "amber", lambda: judge_loop(loop(memory="memory not locked"), 50)),
    ("loop late", "amber", lambda: judge_loop(loop(p99_us=251.0), 50)),
    ("loop misses", "amber", lambda: judge_loop(loop(missed=3), 50)),
    ("loop too late", "red", lambda: judge_loop(loop(p99_us=1001.0), 50)),
    ("loop misses many", "red", lambda: judge_loop(loop(missed=21), 50)),
    ("no loop", "red", lambda: judge_loop(loop(ticks=0), 50)),
    ("kernel", "green", lambda: judge_kernel(Kernel(False, ("performance",), None))),
    ("kernel that tells nothing", "green", lambda: judge_kernel(Kernel(None, (), None))),
    ("kernel that saves", "amber", lambda: judge_kernel(Kernel(True, ("performance", "powersave"), "1"))),
    # --- devices ---
    ("port", "green", lambda: judge_port(Port("/dev/x", True, True, "dialout"))),
    ("port slow", "amber", lambda: judge_port(Port("/dev/x", True, True, "dialout", "latency timer 16 ms"))),
    ("port not ours", "red", lambda: judge_port(Port("/dev/x", True, False, "dialout"))),
    ("no port", "red", lambda: judge_port(Port("/dev/x", False, False))),
    ("bus", "green", lambda: [judge_can(CanBus("can0", True, "", 1_000_000, 1_000_000))]),
    ("bus of unknown speed", "amber", lambda: [judge_can(CanBus("can0", True, "", None, 1_000_000))]),
    ("bus of another speed", "red", lambda: [judge_can(CanBus("can0", True, "", 500_000, 1_000_000))]),
    ("bus down", "red", lambda: [judge_can(CanBus("can0", False, "ip link set can0 up", None, 1))]),
    ("no bus", "red", lambda: [judge_can(CanBus("can0", None, "", None, 1))]),
    ("device", "green", lambda: [judge_probed(probed(rate_hz=800.0, round_trip=Quantiles(0.1, 0.2)))]),
    ("device simulated", "green", lambda: [judge_probed(probed(verdict="simulated"))]),
    ("device with flaws", "amber", lambda: [judge_probed(probed(invalid=3))]),
    ("device busy", "amber", lambda: [judge_probed(probed(verdict="refused", error="/dev/x: busy"))]),
    ("device of the daemon", "amber", lambda: [judge_running("slave", 7)]),
    ("device silent", "red", lambda: [judge_probed(probed(verdict="failed", error="no answer"))]),
    # --- storage ---
    ("state", "green", lambda: judge_folder(folder())),
    ("state to come", "green", lambda: judge_folder(folder(exists=False, mode=None))),
    ("state that others read", "amber", lambda: judge_folder(folder(mode=0o755))),
    ("state that others write", "red", lambda: judge_folder(folder(mode=0o770))),
    ("state not ours", "red", lambda: judge_folder(folder(writable=False, write_mb_s=None))),
    ("disk filling", "amber", lambda: judge_folder(folder(free_mb=1999.0))),
    ("disk full", "red", lambda: judge_folder(folder(free_mb=199.0))),
    ("disk slow", "amber", lambda: judge_folder(folder(write_mb_s=4.0))),
    ("disk too slow", "red", lambda: judge_folder(folder(write_mb_s=0.9))),
    # --- software ---
    ("software", "green", lambda: judge_software((3, 11, 7), "0.1.0", [ZENOH])),
    ("Python newer", "amber", lambda: judge_software((3, 15, 0), "0.1.0", [ZENOH])),
    ("Python old", "red", lambda: judge_software((3, 10, 9), "0.1.0", [ZENOH])),
    ("not installed", "amber", lambda: judge_software((3, 11, 7), None, [])),
    ("package old", "red", lambda: judge_software((3, 11, 7), "0.1.0", [Package("numpy", ">=2", "1.26.4")])),
    ("package missing", "red", lambda: judge_software((3, 11, 7), "0.1.0", [Package("numpy", ">=2", None)])),
    # --- calibrations ---
    ("calibrated", "green", lambda: [judge_calibration(Calibrated("x", "c", date(2026, 6, 1), 365), TODAY)]),
    ("calibrated for long", "amber", lambda: [judge_calibration(Calibrated("x", "c", TODAY, 29), TODAY)]),
    ("last day", "amber", lambda: [judge_calibration(Calibrated("x", "c", date(2026, 6, 1), 30), TODAY)]),
    ("never calibrated", "amber", lambda: [judge_calibration(Calibrated("x", "c"), TODAY)]),
    ("no calibration", "red", lambda: [judge_calibration(Calibrated("x", "c", error="bad"), TODAY)]),
]  # fmt: skip


@pytest.mark.parametrize(("level", "judged"), [row[1:] for row in TABLE], ids=[row[0] for row in TABLE])
def test_a_check_says_what_it_found_and_what_to_do(level: Level, judged: Judged) -> None:
    found = judged()
    assert worst(found) == level
    for each in found:
        assert each.group
        assert each.found or not each.subject
        assert "\n" not in each.found + each.advice
        assert bool(each.advice) == (each.level != "green"), each


@pytest.mark.parametrize("group", sorted({finding.group for row in TABLE for finding in row[2]()}))
def test_every_group_of_checks_is_tested_in_every_colour(group: str) -> None:
    levels = {finding.level for row in TABLE for finding in row[2]() if finding.group == group}
    assert levels == ({"green", "amber", "red"})


def files(tmp_path: Path, slave: str = "", master: str = "") -> list[Path]:
    texts: dict[Role, str] = {"slave": slave, "master": master}
    for role, text in texts.items():
        (tmp_path / f"{role}.yaml").write_text(f"role: {role}\n{text}")
    return [tmp_path / f"{role}.yaml" for role in texts]


def test_ends_that_agree_are_green(tmp_path: Path) -> None:
    loaded, findings = load_files(files(tmp_path))
    assert [each.level for each in findings + judge_agreement(loaded)] == ["green"] * 3


def test_each_field_that_differs_is_named_with_both_values(tmp_path: Path) -> None:
    slave = "cell: a\naxes: [{limits: {max_force_n: 2.5}}]\n"
    master = "cell: a\naxes: [{limits: {workspace_m: [0.0, 0.1]}}]\n"
    loaded, _ = load_files(files(tmp_path, slave, master))
    found = {each.subject: each for each in judge_agreement(loaded)}
    assert set(found) == {"axis insertion, max_force_n", "axis insertion, workspace_m"}
    assert found["axis insertion, max_force_n"].found == "2.5 at the slave, 3.0 at the master"
    assert {each.level for each in found.values()} == {"red"}


def test_another_cell_and_an_axis_of_one_end_are_red(tmp_path: Path) -> None:
    slave, master = "cell: a\n", "cell: b\naxes: [{}, {name: rotation}]\n"
    loaded, _ = load_files(files(tmp_path, slave, master))
    found = {each.subject: each.found for each in judge_agreement(loaded)}
    assert found["axis insertion, cell"] == "a at the slave, b at the master"
    assert found["axis rotation"] == "at the master only"


def test_one_end_alone_is_not_compared(tmp_path: Path) -> None:
    loaded, _ = load_files(files(tmp_path)[:1])
    assert judge_agreement(loaded) == []


def test_a_file_with_a_mistake_is_red_and_the_other_is_looked_at(tmp_path: Path) -> None:
    loaded, findings = load_files(files(tmp_path, slave="cell: '*'\n"))
    assert [each.level for each in findings] == ["red", "green"]
    assert "slave.yaml:2: cell = '*'" in findings[0].found
    assert list(loaded) == ["master"]


CHRONY = (
    "C0A80001,ntp.lab,3,1751371200.1,-0.000012345,0.00001,0.00002,1.5,0.01,0.03,0.0005,0.0001,64.2,Normal\n"
)
PTP = """sending: GET TIME_STATUS_NP
\t0011.22ff.fe33-0 seq 0 RESPONSE MANAGEMENT TIME_STATUS_NP
\t\tmaster_offset              -1234
\t\tingress_time               1751371200000000000
\t\tgmPresent                  true
\t\tgmIdentity                 001122.fffe.334455
"""


def test_the_answers_of_chrony_and_ptp_are_read() -> None:
    assert parse_chrony(CHRONY) == Discipline("chrony", -0.000012345, True)
    assert parse_chrony(CHRONY.replace("Normal", "Not synchronised")) == Discipline(
        "chrony", -1.2345e-5, False
    )
    assert parse_ptp(PTP) == Discipline("PTP", -1234 * 1e-9, True)
    for nonsense in ("", "506 Cannot talk to daemon\n", "a,b,c,d,e,f,g,h,i,j,k,l,m,n"):
        assert parse_chrony(nonsense) is None
        assert parse_ptp(nonsense) is None
