"""What the doctor measures, on this host: files, sockets, processes, Zenoh sessions of its own."""

import errno
import fcntl
import os
import pty
import socket
from contextlib import closing
from dataclasses import replace
from datetime import date, timedelta
from pathlib import Path

import pytest
import yaml

from forefeel.common.clock import now_utc
from forefeel.common.settings import DaemonSettings
from forefeel.common.transport.pki import read_identity
from forefeel.common.transport.security import Party, secured
from forefeel.doctor.access import Tried, try_access
from forefeel.doctor.calibrations import judge_calibration, read_calibration
from forefeel.doctor.certificates import find_identity, read_folder
from forefeel.doctor.devices import can_buses, examine_port, judge_probed, probe_devices
from forefeel.doctor.network import try_listen
from forefeel.doctor.realtime import measure_loop, read_kernel
from forefeel.doctor.software import judge_software, python_version, read_packages
from forefeel.doctor.storage import examine_folder
from forefeel.probe.configured import configured
from forefeel.slave.settings import SlaveSettings
from tests.secured import make_pki

CELL = "cathlab"
TODAY = date(2026, 7, 1)


@pytest.fixture(scope="module")
def pki(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("certificates") / "pki"
    make_pki(folder, [CELL], {"slave": ["10.0.0.1"]}, days=100)
    return folder


# --- certificates ---


def test_a_folder_of_certificates_is_read(pki: Path) -> None:
    found = read_folder(pki, "slave", CELL)
    assert (found.error, found.hosts, found.key_mode, found.folder_mode) == ("", ("10.0.0.1",), 0o600, 0o700)
    assert found.days_left == 99
    assert found.signs


def test_an_expired_certificate_and_that_of_another_cell_are_errors(tmp_path: Path, pki: Path) -> None:
    make_pki(tmp_path / "old", [CELL], now=now_utc() - timedelta(days=11), days=10)
    assert "expired" in read_folder(tmp_path / "old", "slave", CELL).error
    assert "forefeel-cathlab-slave" in read_folder(pki, "slave", "other").error
    assert "slave.crt" in read_folder(tmp_path / "none", "slave", CELL).error
    settings = DaemonSettings.model_validate({"cell": CELL, "transport": {"pki": tmp_path / "old"}})
    assert find_identity(settings, "slave") is None


# --- access control ---


def test_the_rules_let_through_what_a_role_may_say_and_nothing_else(pki: Path) -> None:
    identity = read_identity(pki, Party("slave", (CELL,)), now_utc()).identity
    assert try_access("slave", CELL, identity) == Tried(own_passes=True)


def test_rules_that_are_off_are_noticed(pki: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    original = secured
    monkeypatch.setattr(
        "forefeel.doctor.access.secured",
        lambda party, files: {**original(party, files), "access_control": {"enabled": False}},
    )
    identity = read_identity(pki, Party("master", (CELL,)), now_utc()).identity
    assert try_access("master", CELL, identity) == Tried(True, True, True)


def test_files_that_are_none_are_an_error_and_not_an_exception(pki: Path, tmp_path: Path) -> None:
    identity = read_identity(pki, Party("slave", (CELL,)), now_utc()).identity
    broken = tmp_path / "key"
    broken.write_text("no key")
    assert try_access("slave", CELL, replace(identity, key=broken)).error


# --- network ---


def test_an_address_that_is_taken_or_not_ours_can_not_be_listened_on() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert try_listen(f"tcp/127.0.0.1:{port}").error == errno.EADDRINUSE
    assert try_listen(f"tcp/127.0.0.1:{port}").error == 0
    assert try_listen(f"tls/192.0.2.1:{port}").error == errno.EADDRNOTAVAIL


# --- real time ---


def test_the_loop_is_measured_in_a_process_of_its_own() -> None:
    before = os.sched_getscheduler(0)
    found = measure_loop(0, 0.2)
    assert found.ticks + found.missed >= 150
    assert found.scheduling == "normal scheduling (priority 0 configured)"
    assert found.max_us >= found.p99_us >= found.p50_us > 0
    assert os.sched_getscheduler(0) == before


def test_the_kernel_is_asked(tmp_path: Path) -> None:
    (tmp_path / "kernel").mkdir()
    (tmp_path / "kernel" / "realtime").write_text("1\n")
    cpu = tmp_path / "devices" / "system" / "cpu"
    for number, governor in enumerate(("performance", "powersave")):
        (cpu / f"cpu{number}" / "cpufreq").mkdir(parents=True)
        (cpu / f"cpu{number}" / "cpufreq" / "scaling_governor").write_text(f"{governor}\n")
    (cpu / "isolated").write_text("2-3\n")
    found = read_kernel(tmp_path)
    assert (found.preempt_rt, found.governors, found.isolated) == (True, ("performance", "powersave"), "2-3")
    nothing = read_kernel(tmp_path / "none")
    assert (nothing.governors, nothing.isolated) == ((), None)


# --- devices ---


def slave(**axis: object) -> SlaveSettings:
    return SlaveSettings.model_validate({"axes": [axis]})


ZABER = {"driver": "zaber_ascii", "microstep_m": 1e-7, "travel_m": [-0.01, 0.13]}


def test_a_port_is_looked_at_without_being_opened(tmp_path: Path) -> None:
    controller, device = pty.openpty()
    with closing(os.fdopen(controller)), closing(os.fdopen(device)):
        found = examine_port(os.ttyname(device))
        assert (found.exists, found.permitted, found.warning) == (True, True, "")
        assert found.group
    (tmp_path / "file").write_text("")
    assert not examine_port(str(tmp_path / "file")).permitted
    assert not examine_port(str(tmp_path / "none")).exists


def test_a_device_that_does_not_answer_is_red_and_one_that_another_holds_amber() -> None:
    controller, device = pty.openpty()
    with closing(os.fdopen(controller)), closing(os.fdopen(device)):
        stage = configured(slave(stage={**ZABER, "port": os.ttyname(device)}))[:1]
        fcntl.flock(device, fcntl.LOCK_EX)
        (found,) = probe_devices(stage)
        assert judge_probed(found).level == "amber"
    (found,) = probe_devices(stage)
    assert judge_probed(found).level == "red"


def test_a_can_interface_that_is_configured_and_absent_is_found_out() -> None:
    can = {"interface": "socketcan", "channel": "nocan0", "bitrate": 500_000}
    cell = {"driver": "cia404", "can": can, "node_id": 2, "full_scale_n": 10.0}
    (bus,) = can_buses(configured(slave(load_cell=cell)))
    assert (bus.name, bus.up, bus.wanted) == ("nocan0", None, 500_000)
    assert can_buses(configured(slave())) == []


def test_the_calibration_that_the_settings_name_is_read(tmp_path: Path) -> None:
    text = """format: forefeel.stage_calibration/1
driver: zaber_ascii
serial: "123"
date: 2026-05-01
zero: 0.0
native_per_m: 1.0e+7
travel_m: [-0.01, 0.13]
repeatability_m: 1.0e-6
"""
    path = tmp_path / "stage.yaml"
    path.write_text(text)
    named = {**ZABER, "port": "/dev/x", "calibration": str(path)}
    stage, _, cell = configured(slave(stage=named))
    found = read_calibration(stage, TODAY)
    assert found is not None
    assert (str(found.made), found.valid_days, found.error) == ("2026-05-01", 365, "")
    assert read_calibration(cell, TODAY) is None  # simulated
    found = read_calibration(stage, date(2027, 5, 31))
    assert found is not None
    assert "out of date by 30 days" in found.error
    path.write_text(text.replace("1.0e+7", "1.0e+6"))
    found = read_calibration(stage, TODAY)
    assert found is not None
    assert "native_per_m = 1e+06: expected 1e+07 within 1%" in found.error
    path.write_text("date: never\n")
    found = read_calibration(stage, TODAY)
    assert found is not None
    assert str(path) in found.error
    bare = read_calibration(configured(slave(stage={**ZABER, "port": "/dev/x"}))[0], TODAY)
    assert bare is not None
    assert bare.made is None


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"gain_n": 0.0}, "gain_n = 0.0"),
        ({"gain_n": -1.0}, "gain_n = -1.0"),
        ({"gain_n": 1e12}, "gain_n = 1e+12: expected 0.5 to 2"),
        ({"zero": 11.0}, "zero = 11: expected at most 10 native units"),
        ({"date": "2999-01-01"}, "date = 2999-01-01: expected at most today, 2026-07-01"),
        ({"serial": "C-2"}, "serial = 'C-2': expected 'C-1'"),
    ],
)
def test_a_calibration_that_is_none_of_the_cell_is_red(
    tmp_path: Path, change: dict[str, object], expected: str
) -> None:
    path = tmp_path / "cell.yaml"
    values = {
        "format": "forefeel.load_cell_calibration/1", "driver": "bota_serial", "serial": "C-1",
        "date": "2026-06-01", "gain_n": 1.0, "zero": 0.5, "residual_n": 0.0, "hysteresis_n": 0.0,
        "range_n": [0.0, 1.0], "points": [],
    }  # fmt: skip
    named = {"driver": "bota_serial", "port": "/dev/x", "full_scale_n": 10.0, "serial": "C-1"}
    for fits, changes in ((True, {}), (False, change)):
        path.write_text(yaml.safe_dump({**values, **changes}))
        _, _, cell = configured(slave(load_cell={**named, "calibration": str(path)}))
        found = read_calibration(cell, TODAY)
        assert found is not None
        judged = judge_calibration(found, TODAY)
        assert judged.level == ("green" if fits else "red")
        assert fits or expected in judged.found


# --- storage, software ---


def test_a_state_folder_is_measured_and_left_as_it_was(tmp_path: Path) -> None:
    folder = tmp_path / "state"
    ahead = examine_folder(folder, 100_000)
    assert (ahead.exists, ahead.mode) == (False, None)
    assert not folder.exists()
    folder.mkdir(mode=0o700)
    found = examine_folder(folder, 100_000)
    assert (found.exists, found.writable, found.mode) == (True, True, 0o700)
    assert found.write_mb_s is not None
    assert found.write_mb_s > 0
    assert list(folder.iterdir()) == []


def test_this_environment_is_as_required() -> None:
    own, packages = read_packages()
    assert {each.name for each in packages} >= {"eclipse-zenoh", "numpy", "typer"}
    assert not {each.name for each in packages} & {"pytest", "padasip"}  # extras
    assert all(each.level == "green" for each in judge_software(python_version(), own, packages))
    assert read_packages("no-such-distribution") == (None, [])
