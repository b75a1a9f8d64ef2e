"""What the script may not do, and the command line without the extra."""

import re
from pathlib import Path

import pytest

import forefeel.dashboard

STATIC = Path(forefeel.dashboard.__file__).parent / "static"
FILES = sorted(STATIC.iterdir())


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_nothing_is_made_html_and_nothing_is_loaded_from_elsewhere(file: Path) -> None:
    text = file.read_text().replace("http://www.w3.org/2000/svg", "")  # a name, not an address
    for word in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", "new Function"):
        assert word not in text
    assert not re.search(r"(https?:)?//[a-z0-9-]+\.[a-z]", text)
    assert len(text.splitlines()) <= 300
