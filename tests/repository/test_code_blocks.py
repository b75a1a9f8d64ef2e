"""What the pages tell people to type exists, and the files that they show can be loaded."""

import re
from pathlib import Path

import pytest
import yaml

from forefeel.common.errors import ConfigurationError
from forefeel.common.model_file import load_model
from forefeel.daemon_settings import load_any
from tests.repository.commands import typed, wrong
from tests.repository.pages import DOCS, ROOT, WRITTEN, Block, blocks, made, name_of, prose

_SHELL = {"", "bash", "sh", "console"}
_FILE = re.compile(r"[\w./-]+\.(yaml|csv|parquet|mcap|json5)")
EVERY = [*WRITTEN, *made()]
BLOCKS = [block for path in EVERY for block in blocks(path)]
TARGETS = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)


def place(block: Block) -> str:
    return f"{block.page}:{block.line}"


@pytest.mark.parametrize("path", EVERY, ids=name_of)
def test_commands_in_blocks_exist_with_their_options(path: Path) -> None:
    for block in blocks(path):
        if block.language in _SHELL:
            for words in typed(block.text):
                assert wrong(words) is None, f"{place(block)}: forefeel {' '.join(words)}: {wrong(words)}"


@pytest.mark.parametrize("path", EVERY, ids=name_of)
def test_commands_in_the_text_exist_with_their_options(path: Path) -> None:
    for inline in re.findall(r"`(forefeel [^`\n]+)`", prose(path)):
        for words in typed(inline):
            assert wrong(words, whole=False) is None, f"{inline}: {wrong(words, whole=False)}"


def test_the_pages_do_show_commands() -> None:
    shown = [words[0] for block in BLOCKS if block.language in _SHELL for words in typed(block.text)]
    assert len(shown) > 50
    assert {"loopback", "diagnose", "evaluate", "slave", "master", "pki", "estop", "clear"} <= set(shown)


@pytest.mark.parametrize(
    "line",
    [
        "forefeel diagnos run.csv --out out",
        "forefeel diagnose run.csv --outt out",
        "forefeel diagnose --out out",
        "forefeel pki",
        "forefeel pki make DIR",
        "$ .venv/bin/forefeel report run.mcap other.mcap --out out",
        "LANG=C sudo forefeel slave --config slave.yaml --speed 3",
    ],
)
def test_a_command_that_does_not_exist_is_seen(line: str) -> None:
    assert [wrong(words) for words in typed(line)] != [None]


@pytest.mark.parametrize("path", EVERY, ids=name_of)
def test_make_targets_exist(path: Path) -> None:
    shell = [block.text for block in blocks(path) if block.language in _SHELL]
    named = re.findall(r"^(?:\$ )?make ([a-z-]+)", "\n".join(shell), re.MULTILINE)
    named += re.findall(r"`make ([a-z-]+)[^`]*`", prose(path))
    assert [target for target in named if target not in TARGETS] == []


def is_settings(block: Block) -> bool:
    return block.language in {"", "yaml"} and re.match(r"(#.*\n)*role: ", block.text) is not None


def is_model(block: Block) -> bool:
    return block.language in {"", "yaml"} and block.text.startswith("schema: forefeel.model/1")


def loaded(block: Block, folder: Path) -> object:
    """The settings of a block; the files that it names are there."""
    for found in _FILE.finditer(block.text):
        file = folder / found[0]
        if not Path(found[0]).is_absolute():
            file.parent.mkdir(parents=True, exist_ok=True)
            file.touch()
    path = folder / "shown.yaml"
    path.write_text(block.text)
    return load_any(path)


@pytest.mark.parametrize("block", [each for each in BLOCKS if is_settings(each)], ids=place)
def test_whole_settings_files_can_be_loaded(block: Block, tmp_path: Path) -> None:
    assert loaded(block, tmp_path)


def test_there_are_whole_settings_files_and_a_wrong_one_is_seen(tmp_path: Path) -> None:
    found = [block for block in BLOCKS if is_settings(block)]
    assert found
    with pytest.raises(ConfigurationError, match="unknown key"):
        loaded(found[0]._replace(text=found[0].text + "speed: 3\n"), tmp_path)


@pytest.mark.parametrize("block", [each for each in BLOCKS if is_model(each)], ids=place)
def test_whole_models_can_be_loaded(block: Block, tmp_path: Path) -> None:
    if "effect: cogging" in block.text:  # of the example package, which is not installed here
        example = (DOCS / "examples" / "effect-package" / "forefeel_cogging.py").read_text()
        shown = yaml.safe_load(block.text)["effects"][-1]["parameters"]
        assert all(f'Parameter("{name}"' in example for name in shown)
        return
    path = tmp_path / "model.yaml"
    path.write_text(block.text)
    assert load_model(path).effects


@pytest.mark.parametrize("block", [each for each in BLOCKS if each.language == "yaml"], ids=place)
def test_other_yaml_is_yaml(block: Block) -> None:
    assert yaml.safe_load(block.text) is not None
