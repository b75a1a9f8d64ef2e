"""The page of every cause, from the classes of `common/causes`."""

import sys
from itertools import groupby

from docs.hooks.markdown import NOTE, code, prose, table
from forefeel.common.causes.base import Effect
from forefeel.common.causes.registry import OWN

_HEAD = f"""{NOTE}
# Causes

The vocabulary of a diagnosis, and the effects that a `model.yaml` or `world.yaml` may name. `x` is the
position in m, `v` and `a` its derivatives, `s` the direction of the motion, `f` the force in N. Every contact
has a `mass_damper_spring`. [An effect of your own](../examples/effect-package/README.md) is tried like these.
"""


def page() -> str:
    """The page as Markdown."""
    kinds = sorted(OWN.values(), key=lambda kind: (kind.__module__, kind.name))
    sections = [_HEAD]
    for module, group in groupby(kinds, key=lambda kind: kind.__module__):
        title = prose(sys.modules[module].__doc__).splitlines()[0].rstrip(".")
        sections += [f"## {title}\n", *map(_section, group)]
    return "\n".join(sections)


def _section(kind: type[Effect]) -> str:
    rows = [
        [code(each.name), each.unit, f"{each.lower:g} to {each.upper:g}", code(f"{each.default:g}")]
        for each in kind.parameters
    ]
    words = kind.words.format(column="a further column")
    parts = [
        f"### {kind.name} {{ #{kind.name} }}",
        f"{words[:1].upper()}{words[1:]}." if words else "",
        prose(kind.__doc__),
        f"Shows in what is left without it: {kind.fingerprint}.",
        table(["parameter", "unit", "range", "default"], rows),
        f"Source: {kind.reference}.\n",
    ]
    return "\n\n".join(filter(None, parts))
