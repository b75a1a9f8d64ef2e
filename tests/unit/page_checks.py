"""What holds of every page, whichever its kind."""

import re
from xml.etree import ElementTree

_NAMESPACES = {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}


def check_page(page: str, drawings: int) -> None:
    """Needs nothing else and shows no number that is none; its drawings are well-formed, their ids differ."""
    assert set(re.findall(r"""https?://[^"'\s<>)]+""", page)) <= _NAMESPACES
    assert not re.search(r"<(script|link|img|iframe|object|base)\b|@import|url\((?!#)", page)
    assert not re.search(r"(?:src|href)=[\"']?(?!#)[^\"' >]", page)
    assert not re.search(r">[^<]*\b(nan|inf|None)\b[^<]*<", page)
    found = re.findall(r"<svg .*?</svg>", page, flags=re.DOTALL)
    assert len(found) == drawings
    ids: list[str] = []
    for drawing in found:
        ElementTree.fromstring(drawing)
        assert not re.search(r"\b(nan|inf)\b", drawing)
        ids += set(re.findall(r' id="([^"]+)"', drawing))
    assert len(ids) == len(set(ids))
