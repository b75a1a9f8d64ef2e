"""Python and the packages that the daemons need."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata

from packaging.requirements import Requirement

from forefeel.doctor.findings import Finding

GROUP = "software"
_OLDEST = (3, 11)  # Python, as `requires-python` in pyproject.toml
_NEWEST_TRIED = (3, 13)  # Python, the newest that this was tried with


@dataclass(frozen=True, slots=True)
class Package:
    """One requirement, as it is written, and the version that is installed; None: it is not."""

    name: str
    wanted: str
    installed: str | None


def read_packages(distribution: str = "forefeel") -> tuple[str | None, list[Package]]:
    """Our own version and what it requires outside of its extras; (None, []) where it is not installed."""
    try:
        own, lines = metadata.version(distribution), metadata.requires(distribution) or []
    except metadata.PackageNotFoundError:
        return None, []
    found = []
    for line in lines:
        wanted = Requirement(line)
        if wanted.marker is None or wanted.marker.evaluate({"extra": ""}):
            found.append(Package(wanted.name, str(wanted.specifier), _version(wanted.name)))
    return own, found


def python_version() -> tuple[int, int, int]:
    """Of this interpreter."""
    return sys.version_info[:3]


def judge_software(
    python: tuple[int, int, int], own: str | None, packages: Sequence[Package]
) -> list[Finding]:
    """Python, then the packages: one line when all are there, else one for each that is not as required."""
    findings = [_python(python)]
    if own is None:
        advice = "pip install -e . in the checkout"
        return [*findings, Finding(GROUP, "forefeel", "amber", "runs without being installed", advice)]
    wrong = [each for each in packages if not _fits(each)]
    if not wrong:
        zenoh = next((each.installed for each in packages if each.name == "eclipse-zenoh"), None)
        found = f"{own}; {len(packages)} packages as required; Zenoh {zenoh or 'unknown'}"
        return [*findings, Finding(GROUP, "forefeel", "green", found)]
    return findings + [
        Finding(
            GROUP,
            each.name,
            "red",
            f"{each.installed or 'not installed'}, required {each.wanted or 'any'}",
            f'pip install "{each.name}{each.wanted}"',
        )
        for each in wrong
    ]


def _python(python: tuple[int, int, int]) -> Finding:
    text = ".".join(map(str, python))
    if python[:2] < _OLDEST:
        return Finding(GROUP, "Python", "red", text, "Python 3.11 or newer")
    if python[:2] > _NEWEST_TRIED:
        return Finding(
            GROUP, "Python", "amber", f"{text}, newer than what this was tried with", "Python 3.11"
        )
    return Finding(GROUP, "Python", "green", text)


def _fits(package: Package) -> bool:
    wanted = Requirement(f"{package.name}{package.wanted}").specifier
    return package.installed is not None and wanted.contains(package.installed, prereleases=True)


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None
