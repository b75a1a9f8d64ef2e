"""Pages as one HTML file that needs nothing else: `base.html.j2`, and a template for each kind of page.

Text stands in the file; figures stand in it as JSON, see `drawing`, with the script that draws them.
"""

import re
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from forefeel.common.events.text import UNKNOWN, quantity
from forefeel.report.wording import DISCLAIMER, micros, number, share, statement_text

_STATIC = Path(__file__).parent.parent / "dashboard" / "static"
_IMPORT = re.compile(r'^import (\{[^}]*\}) from "\./(\w+)\.js";$', re.MULTILINE)
_EXPORT = re.compile(r"^export (?:const|function|class) (\w+)", re.MULTILINE)


def environment() -> Environment:
    """Jinja environment of all pages, a new one at each call: escapes values, raises for undefined ones, and
    finds templates by their path in the package, such as `report/page.html.j2`. Its globals word numbers and
    insert styles and modules of the live page.
    """
    made = Environment(
        loader=PackageLoader("forefeel", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.policies["json.dumps_kwargs"] = {"separators": (",", ":")}
    words = {word.__name__: word for word in (quantity, micros, share, number, statement_text)}
    made.globals.update(words, style=_style, module=_module, disclaimer=DISCLAIMER, unknown=UNKNOWN)
    return made


def render(template: str, **values: object) -> str:
    return environment().get_template(template).render(**values)


def _style(name: str) -> Markup:
    return Markup((_STATIC / f"{name}.css").read_text(encoding="utf-8"))


def _module(name: str) -> Markup:
    """A module of the live page as a statement: `const chart = ...` has all that chart.js exports.

    Of the modules it imports, each is made before it.
    """
    source = (_STATIC / f"{name}.js").read_text(encoding="utf-8")
    exported = ", ".join(_EXPORT.findall(source))
    body = _IMPORT.sub(r"const \1 = \2;", source).replace("\nexport ", "\n")
    return Markup(f"const {name} = (() => {{\n{body}\nreturn {{ {exported} }};\n}})();")
