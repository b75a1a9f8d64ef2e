"""Every link leads somewhere, every page can be found, and nothing is loaded from elsewhere."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.repository.pages import DOCS, ROOT, WRITTEN, anchors, made, name_of, prose

_LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
_WRITTEN_BY_A_RUN = {"explanation/faults.md"}
SITE: dict[str, Any] = yaml.safe_load((ROOT / "mkdocs.yml").read_text())
EVERY = [*WRITTEN, *made()]


def dead(path: Path, target: str) -> bool:
    """Whether `target`, written in the page `path`, leads to nothing."""
    if re.match(r"https?://[\w.-]+", target):
        return False
    file, _, anchor = target.partition("#")
    found = (path.parent / file).resolve() if file else path
    if not (found in made() or (found.exists() and found.is_relative_to(ROOT))):
        return True
    return bool(anchor) and anchor not in anchors(found)


@pytest.mark.parametrize("path", EVERY, ids=name_of)
def test_every_link_leads_somewhere(path: Path) -> None:
    links = _LINK.findall(re.sub(r"`[^`\n]*`", "", prose(path)))
    assert [target for target in links if dead(path, target)] == []


@pytest.mark.parametrize(
    "target",
    ["nowhere.md", "../README.md#no-such-heading", "how-to/diagnose.md#nothing", "../../etc", "#none"],
)
def test_a_dead_link_is_seen(target: str) -> None:
    assert dead(DOCS / "index.md", target)


def test_headings_of_a_made_page_have_anchors_of_their_own() -> None:
    for path in made():
        found = anchors(path)
        assert len(found) == len(set(found)), name_of(path)


def listed(nav: object) -> list[str]:
    if isinstance(nav, str):
        return [nav]
    entries = nav.values() if isinstance(nav, dict) else nav
    assert isinstance(entries, list) or isinstance(nav, dict)
    return [page for entry in entries for page in listed(entry)]  # type: ignore[attr-defined]


def test_every_page_stands_in_the_navigation_once() -> None:
    pages = {str(path.relative_to(DOCS)) for path in EVERY if path.is_relative_to(DOCS)}
    found = listed(SITE["nav"])
    assert sorted(found) == sorted(set(found))
    assert set(found) - _WRITTEN_BY_A_RUN == pages - _WRITTEN_BY_A_RUN


def test_every_decision_stands_in_the_index() -> None:
    index = (DOCS / "decisions" / "README.md").read_text()
    for path in DOCS.glob("decisions/0*.md"):
        number = path.name[:4]
        assert path.read_text().startswith(f"# {number} ")
        assert f"| [{number}]({path.name}) |" in index


def test_the_site_loads_nothing_from_elsewhere() -> None:
    assert SITE["theme"]["font"] is False
    assert "repo_url" not in SITE  # the theme would ask its host for stars
    assert "extra_javascript" not in SITE
    for path in SITE["extra_css"]:
        assert "//" not in (DOCS / path).read_text()
    for path in EVERY:
        assert not re.search(r"<(script|link|iframe|img)\b|!\[[^\]]*\]\(http|```mermaid", path_text(path)), (
            path
        )


def path_text(path: Path) -> str:
    return made().get(path) or path.read_text()


def test_pages_that_are_made_are_not_in_the_tree() -> None:
    assert not any(path.exists() for path in made())
