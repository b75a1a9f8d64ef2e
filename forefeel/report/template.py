"""Pages as one HTML file that needs nothing else: `base.html.j2`, and a template for each kind of page."""

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from forefeel.common.events.text import UNKNOWN, quantity
from forefeel.report.drawing import Drawing
from forefeel.report.wording import DISCLAIMER, deviating, micros, number, ratio, share


def environment() -> Environment:
    """Finds templates by their path in this package, such as `report/page.html.j2`."""
    made = Environment(
        loader=PackageLoader("forefeel", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    words = {word.__name__: word for word in (quantity, micros, share, ratio, number, deviating)}
    made.globals.update(words, svg=_svg, disclaimer=DISCLAIMER, unknown=UNKNOWN)
    return made


def render(template: str, **values: object) -> str:
    return environment().get_template(template).render(**values)


def _svg(drawing: Drawing) -> Markup:
    """Not escaped: matplotlib has escaped what the drawing says."""
    return Markup(drawing.svg)
