"""Writes state.h, `python -m forefeel.common.kernels.header`: a struct for each Protocol of a record, and the
constants that Python and C share, which are Python's.
"""

from collections.abc import Iterator, Mapping

from forefeel.common.estimation import band, bank, blend, experts, forces, learner, path_force, state_filter
from forefeel.common.estimation.evaluator import Evaluation, Learned, OwnMotion, Predicted, Reading
from forefeel.common.estimation.learner import Knowledge
from forefeel.common.kernels.build import FOLDER
from forefeel.common.kernels.record import members

PATH = FOLDER / "state.h"
_RECORDS = Evaluation, Learned, Knowledge, OwnMotion, Reading, Predicted
_WIDTH = 110


def header() -> str:
    """Text of state.h: C constants and structs, from the Python of ../estimation, and the structs' sizes."""
    structs = _structs()
    sizes = [f'{{"{name}", sizeof({name})}}' for name in structs]
    return "\n".join(
        (
            "/* Written by header.py; change the Protocols and constants of ../estimation. */",
            "#pragma once",
            "",
            *_wrapped("enum { ", [f"{name} = {value}" for name, value in _counts().items()], " };"),
            *(f"static const double {name} = {value!r};" for name, value in _numbers().items()),
            *(f"static const {kind} {name}[] = {{{values}}};" for kind, name, values in _constant_arrays()),
            "",
            *(f"typedef struct {{\n{members}\n}} {name};\n" for name, members in structs.items()),
            *_wrapped("static const struct { const char *name; long size; } RECORDS[] = { ", sizes, " };"),
            "",
        )
    )


def _counts() -> Mapping[str, int]:
    """Integer constants by name: lengths of arrays and places in them."""
    firsts = "FIRST_STOP", "FIRST_RELAXATION", "FIRST_DIFFERENCE", "FIRST_NONLINEAR"
    return {
        **{name: getattr(bank, name) for name in ("RING", "STOPS", "COUNT", *firsts)},
        "RELAXATIONS": len(bank.RELAXATIONS_S),
        "DIFFERENCES": len(bank.SPANS),
        **{name: getattr(experts, name) for name in ("THEN", "HELD", "PAST", "STEP", "ROW", "PLAIN", "ODD")},
        "LAGS": len(experts.LAGS_S),
        "EXPERTS": len(experts.NAMES),
        "MEMBERS": blend.MEMBERS,
        "RIVALS": blend.RIVALS,
        "ZOH": blend.ZOH,
        "FIRST_EXPERT": blend.FIRST,
        "CONTACT": blend.CONTACT,
        "FIRST_FORCES": forces.FIRST,
        "BINS": band.BINS,
        "ZERO_BIN": band.ZERO_BIN,
        "PER_OCTAVE": band.PER_OCTAVE,
        "NODES": path_force.NODES,
        "WORSE_THAN_NOTHING": learner.WORSE_THAN_NOTHING,
    }


def _numbers() -> Mapping[str, float]:
    return {"GAP_S": state_filter.GAP_S, "NO_OCTAVE": bank.NO_OCTAVE}


def _constant_arrays() -> Iterator[tuple[str, str, str]]:
    """Yields C type, name and comma-separated values of each constant array."""
    for kind, name, values in (
        ("int", "SPANS", bank.SPANS),
        ("double", "RELAXATIONS_S", bank.RELAXATIONS_S),
        ("double", "LAGS_S", experts.LAGS_S),
    ):
        yield kind, name, ", ".join(map(repr, values))


def _structs() -> dict[str, str]:
    """Declarations of each struct's members, by its name; what a struct contains comes before it."""
    structs: dict[str, str] = {}

    def add(of: type) -> None:
        """Adds the struct of a Protocol, behind those that it contains."""
        lines = []
        for name, kind in members(of):
            if isinstance(kind, type):
                add(kind)
                lines.append(f"    {kind.__name__} {name};")
            else:
                lines.append(f"    double {name}{''.join(f'[{n}]' for n in kind)};")
        structs.setdefault(of.__name__, "\n".join(lines))

    for record in _RECORDS:
        add(record)
    return structs


def _wrapped(start: str, items: list[str], end: str) -> Iterator[str]:
    """Yields `start`, the items between commas, and `end` in lines of at most `_WIDTH` characters."""
    line = start
    for n, item in enumerate(items):
        text = item + (", " if n < len(items) - 1 else end)
        if len(line + text) > _WIDTH:
            yield line.rstrip()
            line = "    "
        line += text
    yield line


if __name__ == "__main__":
    PATH.write_text(header(), encoding="ascii")
