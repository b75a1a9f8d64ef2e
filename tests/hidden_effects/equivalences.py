"""Every case in which two answers count as one. There is no other.

| answers | why they are one |
|---|---|
| asymmetric `coulomb_friction` = `coulomb_friction` and `bias` | `forward_n = force_n + bias`, `backward_n = force_n - bias`: the same force |
| `force_n` of a symmetric `coulomb_friction` = mean of `forward_n` and `backward_n` | two notations |
| `forward_n_s_m`, `backward_n_s_m` of `asymmetric_damping` are compared by their difference | the damper's own coefficient adds to both: only the difference is determined |
"""  # noqa: E501 - a table

from collections.abc import Iterable, Mapping
from math import hypot

from tests.hidden_effects.answers import Answer, Interval
from tests.hidden_effects.generator import Truth


def same_names(truth: Truth, names: Iterable[str]) -> bool:
    given = set(names)
    return given == set(truth.names) or (_asymmetric(truth) and given == {*truth.names, "bias"})


def right_first(truth: Truth, names: tuple[str, ...]) -> bool:
    """Whether the name of the largest force is one that was hidden."""
    return bool(names) and names[0] in _accepted(truth)


def only_hidden(truth: Truth, names: Iterable[str]) -> bool:
    return set(names) <= _accepted(truth)


def _accepted(truth: Truth) -> set[str]:
    return {*truth.names, "bias"} if _asymmetric(truth) else set(truth.names)


def _asymmetric(truth: Truth) -> bool:
    return ("coulomb_friction", "asymmetric") in zip(truth.names, truth.labels, strict=True)


def comparable(answer: Answer, effect: str) -> dict[str, Interval]:
    """The answer's parameters of an effect with everything that follows from them by the table."""
    found = dict(answer.parameters.get(effect, {}))
    if effect == "coulomb_friction":
        _complete_friction(found, answer.parameters.get("bias", {}))
    if effect == "asymmetric_damping" and {"forward_n_s_m", "backward_n_s_m"} <= set(found):
        found["difference_n_s_m"] = _combined(found["forward_n_s_m"], found["backward_n_s_m"], 1.0, -1.0)
    return found


def _complete_friction(found: dict[str, Interval], bias: Mapping[str, Interval]) -> None:
    if "force_n" in found and "forward_n" not in found:
        found["forward_n"] = found["backward_n"] = found["force_n"]
    if "forward_n" in found and "backward_n" in found:
        found.setdefault("force_n", _combined(found["forward_n"], found["backward_n"], 0.5, 0.5))
        if "force_n" in bias:
            found["forward_n"] = _combined(found["forward_n"], bias["force_n"], 1.0, 1.0)
            found["backward_n"] = _combined(found["backward_n"], bias["force_n"], 1.0, -1.0)


def _combined(first: Interval, second: Interval, one: float, other: float) -> Interval:
    """Half widths add as those of independent estimates do."""
    value = one * first[0] + other * second[0]
    half = hypot(one * (first[2] - first[1]) / 2.0, other * (second[2] - second[1]) / 2.0)
    return value, value - half, value + half
