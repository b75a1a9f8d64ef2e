"""The wheel, in a project whose own folders have the names of ours."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.commands.test_simulate import MODEL

ROOT = Path(__file__).parents[2]
OURS = "common", "master", "slave", "devices", "diagnosis", "studies", "tests"
BUILT_FROM = ("pyproject.toml", "README.md", "LICENSE", "forefeel", "common", "master", "slave")

SCRIPT = """
import sys
from importlib.metadata import entry_points
from pathlib import Path

import common, devices, diagnosis, master, slave, studies, tests
import forefeel
from forefeel.common.causes.registry import effect_class
from forefeel.diagnosis import evaluation
from forefeel.master.daemon import MasterDaemon
from forefeel.slave.daemon import SlaveDaemon

here = Path(__file__).parent
for theirs in (common, devices, diagnosis, master, slave, studies, tests):
    assert Path(theirs.__file__).parent.parent == here, theirs
assert Path(forefeel.__file__).parents[1] == Path(sys.argv[1]), forefeel
for kind in "stages", "grippers", "load_cells", "handles":
    drivers = entry_points(group=f"forefeel.{kind}")
    assert drivers, kind
    for driver in drivers:
        driver.load()
for name, module in list(sys.modules.items()):  # an editable installation would find what the wheel has not
    if name.partition(".")[0] == "forefeel":
        assert Path(module.__file__).is_relative_to(sys.argv[1]), module
run = next(iter(entry_points(group="console_scripts", name="forefeel"))).load()
sys.argv[1:] = ["simulate", "--model", "model.yaml", "--duration", "1", "--out", "one.csv"]
run()
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the wheel holds, as `pip install` lays it down."""
    source, site = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("site")
    for name in BUILT_FROM:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / name, symlinks=True)
        else:
            shutil.copy(ROOT / name, source)
    build = "from setuptools.build_meta import build_wheel; print(build_wheel('.'))"
    done = subprocess.run(
        [sys.executable, "-c", build], cwd=source, capture_output=True, text=True, check=True
    )
    with zipfile.ZipFile(source / done.stdout.split()[-1]) as wheel:
        wheel.extractall(site)
    return site


def test_nothing_stands_beside_forefeel(installed: Path) -> None:
    found = {path.name for path in installed.iterdir()}
    assert found == {"forefeel", "forefeel-0.2.0.dist-info"}
    templates = {str(path.relative_to(ROOT)) for path in (ROOT / "forefeel").glob("**/*.j2")}
    assert templates == {str(path.relative_to(installed)) for path in installed.glob("**/*.j2")}
    links = [path for path in installed.rglob("*") if path.is_symlink()]
    assert not links
    assert (installed / "forefeel-0.2.0.dist-info" / "licenses" / "LICENSE").exists()


def test_a_project_with_folders_of_the_same_names(installed: Path, tmp_path: Path) -> None:
    for name in OURS:
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("")
    (tmp_path / "bench.py").write_text(SCRIPT)
    (tmp_path / "model.yaml").write_text(MODEL)
    done = subprocess.run(
        [sys.executable, "bench.py", str(installed)],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(installed)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "one.csv").read_text().startswith("time_s,position_m,force_n")
