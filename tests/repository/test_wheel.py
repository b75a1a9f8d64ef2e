"""The wheel, in a project whose own folders have the names of ours; the library of kernels in it."""

import os
import platform
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from forefeel.common.kernels.build import LIBRARY, BuildError, compiler, sources_sha256
from tests.commands.test_simulate import MODEL

ROOT = Path(__file__).parents[2]
OURS = "common", "master", "slave", "devices", "diagnosis", "studies", "tests"
BUILT_FROM = ("pyproject.toml", "setup.py", "README.md", "LICENSE", "src", "common", "master", "slave")

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
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of what a distribution is built from."""
    source = tmp_path_factory.mktemp("source")
    for name in BUILT_FROM:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / name, symlinks=True)
        else:
            shutil.copy(ROOT / name, source)
    return source


def built(source: Path, kind: str) -> Path:
    """The file that setuptools builds: a `wheel` or an `sdist`."""
    build = f"from setuptools.build_meta import build_{kind}; print(build_{kind}('.'))"
    done = subprocess.run(
        [sys.executable, "-c", build], cwd=source, capture_output=True, text=True, check=True
    )
    return source / done.stdout.split()[-1]


@pytest.fixture(scope="module")
def wheel(source: Path) -> Path:
    try:
        compiler()
    except BuildError as error:
        pytest.skip(str(error))
    return built(source, "wheel")


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the wheel holds, as `pip install` lays it down."""
    site = tmp_path_factory.mktemp("site")
    with zipfile.ZipFile(wheel) as file:
        file.extractall(site)
    return site


def test_one_wheel_for_every_python_of_a_platform(wheel: Path) -> None:
    assert wheel.name == f"forefeel-0.3.0-py3-none-linux_{platform.machine()}.whl"


def test_the_wheel_holds_the_library_and_its_sources(installed: Path) -> None:
    kernels = installed / "forefeel" / "common" / "kernels"
    assert sources_sha256(kernels) == sources_sha256(LIBRARY.parent)
    assert sources_sha256(kernels).encode() in (kernels / LIBRARY.name).read_bytes()


def test_the_source_distribution_holds_what_the_library_is_built_of(source: Path) -> None:
    with tarfile.open(built(source, "sdist")) as file:
        names = {Path(*Path(name).parts[1:]) for name in file.getnames()}
    kernels = Path("forefeel", "common", "kernels")
    made_of = {Path("src") / kernels / path.name for path in LIBRARY.parent.glob("*.[ch]")}
    assert made_of | {Path("setup.py"), Path("src") / kernels / "build.py"} <= names
    assert Path("src") / kernels / LIBRARY.name not in names


def test_nothing_stands_beside_forefeel(installed: Path) -> None:
    found = {path.name for path in installed.iterdir()}
    assert found == {"forefeel", "forefeel-0.3.0.dist-info"}
    templates = {str(path.relative_to(ROOT / "src")) for path in (ROOT / "src").glob("**/*.j2")}
    assert templates == {str(path.relative_to(installed)) for path in installed.glob("**/*.j2")}
    links = [path for path in installed.rglob("*") if path.is_symlink()]
    assert not links
    assert (installed / "forefeel-0.3.0.dist-info" / "licenses" / "LICENSE").exists()


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
