"""The units, by systemd's own tools, and what must stand in them whatever those say."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from forefeel.common.settings import RealtimeSettings

DEPLOY = Path(__file__).parents[2] / "deploy"
UNITS = sorted((DEPLOY / "systemd").glob("*.service"))
NAMES = {
    "forefeel-slave@.service",
    "forefeel-master@.service",
    "forefeel-recorder@.service",
    "forefeel-router.service",
}
MOST_EXPOSED = 2.2
INSTALLED = "/opt/forefeel/bin/forefeel"


def directives(unit: Path) -> dict[str, list[str]]:
    """Each directive with the values of its lines."""
    found: dict[str, list[str]] = {}
    for line in unit.read_text().splitlines():
        name, sign, value = line.partition("=")
        if sign and not line.startswith("#"):
            found.setdefault(name, []).append(value)
    return found


def systemd_analyze() -> str:
    tool = shutil.which("systemd-analyze")
    if tool is None:
        pytest.skip("systemd-analyze is not installed (Debian package systemd)")
    return tool


@pytest.fixture
def instances(tmp_path: Path) -> dict[str, Path]:
    """Each unit as it would be started, of a program that is there."""
    found = {}
    for unit in UNITS:
        path = tmp_path / unit.name.replace("@.", "@cathlab.")
        path.write_text(unit.read_text().replace(INSTALLED, sys.executable))
        found[unit.name] = path
    return found


@pytest.mark.parametrize("name", sorted(NAMES))
def test_systemd_finds_nothing_to_complain_of(name: str, instances: dict[str, Path]) -> None:
    command = [systemd_analyze(), "verify", "--man=no", str(instances[name])]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert (done.returncode, done.stdout + done.stderr) == (0, "")


@pytest.mark.parametrize("name", sorted(NAMES))
def test_the_exposure_is_low(
    name: str, instances: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    command = [systemd_analyze(), "security", "--offline=true", "--no-pager", str(instances[name])]
    environment = {**os.environ, "LC_ALL": "C.UTF-8"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False, env=environment)
    found = re.search(r"Overall exposure level for \S+: ([\d.]+)", done.stdout)
    assert found, done.stdout + done.stderr
    with capsys.disabled():
        print(f" {name}: exposure {found[1]}", end="")
    assert float(found[1]) <= MOST_EXPOSED


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_systemd_watches_each_of_them_and_permits_what_the_daemon_asks_for(unit: Path) -> None:
    found = directives(unit)
    assert found["Type"] == ["notify"]
    assert 0 < int(found["WatchdogSec"][0]) <= 10
    assert found["User"] == ["forefeel"]
    assert "AF_UNIX" in found["RestrictAddressFamilies"][0].split()  # sd_notify and the control socket
    assert found["StateDirectoryMode"] == ["0700"]
    realtime = "slave" in unit.name or "master" in unit.name
    assert ("LimitRTPRIO" in found) == ("LimitMEMLOCK" in found) == realtime
    if realtime:
        assert int(found["LimitRTPRIO"][0]) >= 90
        with pytest.raises(ValueError, match="priority"):  # nobody can configure more than is granted
            RealtimeSettings(priority=int(found["LimitRTPRIO"][0]) + 1)
        assert "RestrictRealtime" not in found
        assert "PrivateDevices" not in found


def test_a_slave_that_ended_by_a_fault_is_started_by_a_person() -> None:
    found = directives(DEPLOY / "systemd" / "forefeel-slave@.service")
    assert found["Restart"] == ["on-abnormal"]  # killed, hung, dumped; never an exit code
    assert "SuccessExitStatus" not in found
    assert found["RestartForceExitStatus"] == ["2"]  # wrong input: it never began
    assert "AF_CAN" in found["RestrictAddressFamilies"][0].split()
    assert int(found["StartLimitBurst"][0]) <= 6


def test_the_account_of_the_units_is_made_by_the_sysusers_file() -> None:
    lines = [line.split() for line in (DEPLOY / "systemd" / "forefeel.sysusers").read_text().splitlines()]
    assert ["m", "forefeel", "dialout"] in lines
    assert any(line[:2] == ["u", "forefeel"] for line in lines)
