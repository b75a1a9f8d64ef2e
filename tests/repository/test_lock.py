"""The pinned versions fit what is asked for, and each has the hashes of its files."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from packaging.markers import Marker
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = PYPROJECT["project"]
PIN = re.compile(
    r"^([\w.\-]+)==(\S+)(?: ; (.*?))? \\\n((?:    --hash=sha256:[0-9a-f]{64}(?: \\)?\n)+)", re.MULTILINE
)


def pins(name: str) -> dict[str, str]:
    """Version by name, of those that this interpreter installs."""
    text = (ROOT / "deploy" / "lock" / f"{name}.txt").read_text()
    assert PIN.sub("", text).strip() == "", "nothing but pins with hashes"
    found = PIN.findall(text)
    return {canonicalize_name(n): v for n, v, marker, _ in found if not marker or Marker(marker).evaluate()}


def asked(extra: str) -> Iterator[Requirement]:
    """What the project asks for with that extra."""
    for line in [*PROJECT["dependencies"], *PROJECT["optional-dependencies"][extra]]:
        requirement = Requirement(line)
        if requirement.name != PROJECT["name"]:
            yield requirement
        for each in requirement.extras if requirement.name == PROJECT["name"] else ():
            yield from asked(each)


@pytest.mark.parametrize("name", ["demo", "dev"])
def test_what_is_asked_for_is_pinned(name: str) -> None:
    found = pins(name)
    for requirement in asked(name):
        assert requirement.specifier.contains(found[canonicalize_name(requirement.name)]), requirement


def test_the_compiler_of_machines_without_one_is_pinned() -> None:
    (asked_for,) = map(Requirement, PYPROJECT["dependency-groups"]["compiler"])
    assert asked_for.specifier.contains(pins("compiler")[asked_for.name])
    assert f'"{asked_for}"' in (ROOT / "setup.py").read_text()


def test_the_tests_run_on_what_the_demo_runs_on() -> None:
    assert pins("demo").items() <= pins("dev").items()
