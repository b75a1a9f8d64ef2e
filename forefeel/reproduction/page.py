"""reproduction.html: numbers and figures in one file that needs nothing else."""

from collections.abc import Sequence

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from forefeel.diagnosis.reproduction.results import Reproduction
from forefeel.report import wording
from forefeel.report.text import DISCLAIMER
from forefeel.reproduction.drawing import Picture

_WORDS = "quantity", "share", "ratio", "number"


def render_page(numbers: Reproduction, pictures: Sequence[Picture]) -> str:
    """The page; `pictures` by their names, as `draw_all` makes them."""
    environment = Environment(
        loader=PackageLoader("forefeel", "reproduction"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals.update(
        svg=lambda picture: Markup(picture.svg),  # matplotlib has escaped what the drawing says
        disclaimer=DISCLAIMER,
        **{name: getattr(wording, name) for name in _WORDS},
    )
    return environment.get_template("page.html.j2").render(
        all=numbers, flaws=numbers.flaws, pictures={picture.name: picture for picture in pictures}
    )
