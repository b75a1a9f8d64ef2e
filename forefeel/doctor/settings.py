"""Do the files load, and do both ends share what they must?"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from forefeel.common.errors import ConfigurationError
from forefeel.common.settings import DaemonSettings, shared_text
from forefeel.common.topics import Role
from forefeel.daemon_settings import load_daemon
from forefeel.doctor.findings import Finding

GROUP = "settings"
Loaded = dict[Role, tuple[Path, DaemonSettings]]


def load_files(files: Sequence[Path]) -> tuple[Loaded, list[Finding]]:
    """The files that load, by role, and a finding for each.

    Raises:
        ConfigurationError: a file is not there, or two are of one role.
    """
    loaded: Loaded = {}
    findings = []
    for path in files:
        if not path.is_file():
            raise ConfigurationError(
                f"--config {path}: no such file; expected a slave's or master's YAML file"
            )
        try:
            settings = load_daemon(path)
        except ConfigurationError as error:
            advice = f"correct it; forefeel config check {path} prints the whole"
            findings.append(Finding(GROUP, path.name, "red", str(error), advice))
            continue
        role = cast(Role, getattr(settings, "role", "slave"))
        if role in loaded:
            raise ConfigurationError(
                f"--config {path}: another {role} beside {loaded[role][0]}; expected one of each role"
            )
        loaded[role] = path, settings
        findings.append(Finding(GROUP, path.name, "green", f"{role} of cell {settings.cell}, loads"))
    return loaded, findings


def judge_agreement(loaded: Mapping[Role, tuple[Path, DaemonSettings]]) -> list[Finding]:
    """Whether slave and master would arm together: a finding for each field that differs."""
    if len(loaded) < 2:
        return []
    slave, master = (_shared(loaded[role][1]) for role in ("slave", "master"))
    findings = []
    for axis in sorted({*slave, *master}):
        mine, theirs = slave.get(axis), master.get(axis)
        if mine is None or theirs is None:
            there, missing = ("slave", "master") if theirs is None else ("master", "slave")
            found = f"at the {there} only"
            findings.append(Finding(GROUP, f"axis {axis}", "red", found, f"name it at the {missing}, too"))
            continue
        findings += [
            Finding(
                GROUP,
                f"axis {axis}, {field}",
                "red",
                f"{mine.get(field)} at the slave, {theirs.get(field)} at the master",
                "make them equal: nothing arms before",
            )
            for field in sorted({*mine, *theirs})
            if mine.get(field) != theirs.get(field)
        ]
    return findings or [Finding(GROUP, "both ends", "green", f"agree on {', '.join(sorted(slave))}")]


def _shared(settings: DaemonSettings) -> dict[str, dict[str, Any]]:
    """What the handshake compares, axis by axis."""
    axes = getattr(settings, "axes", ())
    return {axis.name: json.loads(shared_text(settings.cell, axis.name, axis.limits)) for axis in axes}
