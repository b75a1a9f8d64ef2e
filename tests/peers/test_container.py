"""The container file and compose file, by parsers of others. Neither is ever run here."""

import json
import re
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
import yaml
from dockerfile_parse import DockerfileParser
from jsonschema.validators import validator_for

from forefeel.daemon_settings import load_daemon
from tests.commands.command_line import group

ROOT = Path(__file__).parents[2]
COMPOSE = ROOT / "deploy" / "compose.yaml"
DOCKERFILE = ROOT / "deploy" / "container" / "Dockerfile"


def flaws(document: object) -> list[str]:
    """By the schema of compose-spec.io, as check-jsonschema carries it."""
    place = resources.files("check_jsonschema") / "builtin_schemas" / "vendor" / "compose-spec.json"
    schema = json.loads(place.read_text(encoding="utf-8"))
    return [error.message for error in validator_for(schema)(schema).iter_errors(document)]


@pytest.fixture(scope="module")
def services() -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = yaml.safe_load(COMPOSE.read_text())["services"]
    return found


@pytest.fixture(scope="module")
def instructions() -> list[tuple[str, str]]:
    parser = DockerfileParser(path=str(DOCKERFILE))
    return [(each["instruction"], each["value"]) for each in parser.structure]


def test_the_compose_file_is_one_by_its_schema() -> None:
    text = COMPOSE.read_text()
    assert flaws(yaml.safe_load(text)) == []
    for right, wrong in (("read_only: true", "read_only: [1]"), ("cap_drop:", "cap_dorp:")):
        assert flaws(yaml.safe_load(text.replace(right, wrong)))  # else that could not fail


def test_each_service_runs_a_command_that_there_is(services: dict[str, dict[str, Any]]) -> None:
    assert set(services) == {"router", "slave", "master"}
    for service in services.values():
        name, *options = service["command"]
        group([name]).make_context(name, options).close()


def test_what_is_mounted_is_there_or_made_by_the_how_to(services: dict[str, dict[str, Any]]) -> None:
    told = (ROOT / "docs" / "how-to" / "deploy.md").read_text()
    for volume in (volume for service in services.values() for volume in service["volumes"]):
        source = volume.partition(":")[0]
        if source.startswith("./"):
            path = COMPOSE.parent / source
            assert path.is_file() or f"deploy/{source[2:]}" in told, source


@pytest.mark.parametrize("role", ["slave", "master"])
def test_the_settings_of_the_containers_load_and_are_secured(role: str) -> None:
    settings = load_daemon(DOCKERFILE.with_name(f"{role}.yaml"), role)
    assert settings.transport.connect == ("tls/router:7447",)


def test_both_ends_in_containers_share_what_they_must() -> None:
    slave, master = (load_daemon(DOCKERFILE.with_name(f"{role}.yaml")) for role in ("slave", "master"))
    shared = [
        (end.cell, [(axis.name, axis.limits) for axis in getattr(end, "axes", ())]) for end in (slave, master)
    ]
    assert shared[0] == shared[1]


def test_the_image_is_built_of_files_that_there_are(instructions: list[tuple[str, str]]) -> None:
    stages = [value for name, value in instructions if name == "FROM"]
    assert len(stages) == 2
    assert all(re.match(r"\S+:\S+", stage) and ":latest" not in stage for stage in stages)
    ignored = (ROOT / ".dockerignore").read_text().split()
    for name, value in instructions:
        if name == "COPY" and not value.startswith("--from"):
            for source in value.split()[:-1]:
                assert (ROOT / source).exists(), source
                assert f"!{source.removeprefix('./')}" in ignored, f"{source} does not reach the build"


def test_the_image_holds_every_package_of_the_product(instructions: list[tuple[str, str]]) -> None:
    copied = " ".join(value for name, value in instructions if name == "COPY")
    for package in ("common", "master", "slave", "src"):
        assert f" ./{package}" in copied
