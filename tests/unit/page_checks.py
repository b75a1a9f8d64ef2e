"""What holds of every page, whichever its kind."""

import json
import re
from xml.etree import ElementTree

_NAMESPACES = {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}


def check_page(page: str, figures: int = 0, drawings: int = 0) -> None:
    """Needs nothing else and shows no number that is none; its figures are JSON, and drawn by one script."""
    assert set(re.findall(r"""https?://[^"'\s<>)]+""", page)) <= _NAMESPACES
    assert not re.search(r"<(link|img|iframe|object|base)\b|@import|url\((?!#)", page)
    assert not re.search(r"(?:src|href)=[\"']?(?!#)[^\"' >]", page)
    page, script, more = page.partition('<script type="module">')
    assert script and "<script" not in more
    data = re.findall(r'<script type="application/json">(.*?)</script>', page)
    assert len(data) == page.count("<canvas") == page.count("<script")
    for spec in data:
        assert {"panels", "vessel"} & json.loads(spec).keys()
        assert not re.search(r"\b(NaN|Infinity)\b", spec)
    assert page.count('class="plots"') == figures
    assert not re.search(r">[^<]*\b(nan|inf|None)\b[^<]*<", page)
    found = re.findall(r"<svg .*?</svg>", page, flags=re.DOTALL)
    assert len(found) == drawings
    for drawing in found:
        ElementTree.fromstring(drawing)
        assert not re.search(r"\b(nan|inf)\b", drawing)
