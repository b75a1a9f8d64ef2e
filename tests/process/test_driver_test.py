"""`forefeel driver test` on the emulators, and on the package that docs/how-to/own-driver.md builds."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.repository.pages import DOCS

ALL = "zaber_ascii", "cia402", "bota_serial", "ascii_line", "cia404", "coil_serial"
QUICK = ("zaber_ascii",)


def verdicts_of(name: str, site: Path | None = None) -> tuple[int, dict[str, str], str]:
    """Exit code, the verdict of each check (kept, where a late host hid it), and stderr."""
    environment = {**os.environ, "PYTHONPATH": str(site or "")}
    command = [sys.executable, "-m", "forefeel", "driver", "test", name, "--json"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=100, check=False)
    document = json.loads(done.stdout)
    assert document["schema"] == "forefeel.driver_test/1"
    checks = {each["check"]: each for each in document["checks"]}
    late = [name for name, each in checks.items() if each["said"].startswith("this host was late by")]
    return (
        done.returncode,
        {name: "kept" if name in late else checks[name]["verdict"] for name in checks},
        done.stderr,
    )


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.soak) for name in ALL]
)
def test_every_driver_with_hardware_keeps_its_port(name: str) -> None:
    code, verdicts, said = verdicts_of(name)
    assert code == 0, said
    assert said == ""
    assert "broken" not in verdicts.values()
    assert {verdicts[each] for each in ("opens", "reads", "refuses", "freezes", "unplugs")} == {"kept"}


def test_the_example_package_is_found_where_it_is_installed(tmp_path: Path) -> None:
    example = tmp_path / "source"
    subprocess.run(["cp", "-r", str(DOCS / "examples" / "load-cell-driver"), str(example)], check=True)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip, "--target", str(tmp_path / "site"), str(example)], check=True)
    code, verdicts, said = verdicts_of("iio", tmp_path / "site")
    assert code == 0, said
    assert said == ""
    assert {"measures", "distrusts", "freezes", "unplugs"} <= {c for c, v in verdicts.items() if v == "kept"}
