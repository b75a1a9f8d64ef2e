"""Pages as one HTML file that needs nothing else: the templates, and the words that they use."""

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from forefeel.report import wording
from forefeel.report.svg import Drawing
from forefeel.report.text import DISCLAIMER

_WORDS = (
    "quantity", "micros", "share", "ratio", "number", "verdict", "calibration",
    "reasons", "refused", "injected",
)  # fmt: skip


def render(template: str, **values: object) -> str:
    """The page of a template, by its path in this package, such as `report/page.html.j2`."""
    environment = Environment(
        loader=PackageLoader("forefeel", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals.update(
        svg=_svg,
        disclaimer=DISCLAIMER,
        **{name: getattr(wording, name) for name in _WORDS},
    )
    return environment.get_template(template).render(**values)


def _svg(drawing: Drawing) -> Markup:
    """Not escaped: matplotlib has escaped what the drawing says."""
    return Markup(drawing.svg)
