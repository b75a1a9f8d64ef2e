"""What holds of every page, whichever its kind."""

import json
import re


def check_page(page: str, figures: int) -> None:
    """Needs nothing else and shows no number that is none; its figures are JSON, and drawn by one script."""
    assert "http" not in page
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
