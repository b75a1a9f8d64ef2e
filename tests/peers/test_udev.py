"""The udev rules: by systemd's tool where it knows how (from 254 on), by their grammar everywhere."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

RULES = Path(__file__).parents[2] / "deploy" / "udev" / "99-forefeel.rules"
_PAIR = re.compile(r'([A-Z_]+)(\{[^}]+\})?\s*(==|!=|\+=|-=|:=|=)\s*"((?:[^"\\]|\\.)*)"')
MATCHES = {"ACTION", "SUBSYSTEM", "SUBSYSTEMS", "DRIVER", "ATTRS", "KERNEL"}
ASSIGNS = {"GROUP", "MODE", "SYMLINK", "ENV", "ATTR"}


def rules() -> list[str]:
    """Every rule, those that are offered behind a # too."""
    lines = [line.lstrip("#") for line in RULES.read_text().splitlines() if '="' in line]
    return [line for line in lines if not line.startswith(" ")]


@pytest.mark.parametrize("rule", rules())
def test_a_rule_has_matches_and_assignments_and_nothing_else(rule: str) -> None:
    assert re.sub(r",\s*", "", _PAIR.sub("", rule)).strip() == ""
    pairs = [(name, operator) for name, _, operator, _ in _PAIR.findall(rule)]
    assert {name for name, operator in pairs if operator in {"==", "!="}} <= MATCHES
    assert {name for name, operator in pairs if operator not in {"==", "!="}} <= ASSIGNS
    assert len({operator in {"==", "!="} for _, operator in pairs}) == 2


def test_nobody_but_the_group_may_open_the_ports() -> None:
    modes = re.findall(r'MODE="(\d+)"', RULES.read_text())
    assert modes
    assert all(int(mode, 8) & 0o007 == 0 for mode in modes)


def test_udevadm_finds_nothing_to_complain_of() -> None:
    tool = shutil.which("udevadm")
    helped = tool and subprocess.run(
        [tool, "--help"], capture_output=True, text=True, timeout=10, check=False
    )
    if not tool or not helped or "verify" not in helped.stdout:
        pytest.skip("no udevadm that verifies rules (systemd 254 or newer)")
    command = [tool, "verify", "--resolve-names=never", str(RULES)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
