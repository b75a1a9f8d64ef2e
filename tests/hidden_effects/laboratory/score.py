"""Answers beside the truth, and the table of them."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

NAMED = ("cause_found", "partly_explained")
EMPTY = ("nothing_found", "nothing_missing", "not_driven_by_this_axis")
_HIDDEN = 0.03  # share of the force that no statement of completeness may pass over
_MINOR = 0.1  # share of the gain up to which a wrong name beside right ones is no falsehood
_SMALL = 0.01  # share of the force up to which an unnamed effect leaves the other parameters alone
_ABOVE = 3.0  # times noise and rest together, above which an effect has to be named
_ALIKE = (
    ("coulomb_friction", "stribeck_friction", "presliding_hysteresis"),
    ("time_delay", "sensor_lag"),
    ("play", "backlash"),
    ("angle_force", "gravity", "angle_dependent_force"),
)
_LINEAR = {"mass_kg": "mass", "damping_n_s_m": "damping", "stiffness_n_m": "stiffness"}
_BARE = ("control", "nothing")
CLASSES = ("right", "partly", "honest", "timid", "false", "refused", "exception")


@dataclass(frozen=True)
class Judged:
    """One answer: its class, and why in words."""

    kind: str
    seed: int
    found: str
    why: str
    truth: Mapping[str, Any]
    answer: Mapping[str, Any]


def judge(truth: Mapping[str, Any], answer: Mapping[str, Any]) -> Judged:
    """Class of an answer: one of CLASSES; `honest` abstains where that is due but not asked for."""
    found, why = _class(truth, answer)
    return Judged(truth["kind"], truth["seed"], found, why, truth, answer)


def _class(truth: Mapping[str, Any], answer: Mapping[str, Any]) -> tuple[str, str]:
    verdict, causes = answer["verdict"], [c for c in answer["causes"] if c["name"] != "bias"]
    if verdict in ("refused", "exception"):
        return verdict, answer["error"]
    if verdict in NAMED and causes:
        return _named(truth, answer, causes)
    if verdict in truth["allowed"]:
        return "right", verdict
    if verdict in (*EMPTY, *NAMED):  # with a bias alone, the simulation is said to be complete
        false = truth["hidden"] > _HIDDEN or verdict == "not_driven_by_this_axis"
        return ("false" if false else "right"), f"{verdict}, where {truth['hidden']:.1%} is hidden"
    return _abstained(truth, answer), f"{verdict} {' | '.join('+'.join(rival) for rival in answer['rivals'])}"


def _abstained(truth: Mapping[str, Any], answer: Mapping[str, Any]) -> str:
    if truth["outside"]:
        return "right"
    if not truth["separable"]:
        good = accepted(truth)
        rival = any(good.intersection(rivals) for rivals in answer["rivals"])
        return "right" if answer["verdict"] == "unexplained" or rival else "partly"
    rest = np.hypot(truth["left_n"], truth["noise_n"])
    largest = truth["names"][0][1] * truth["force_n"] if truth["names"] else 0.0
    bare = truth["kind"] in _BARE and truth["left_n"] <= truth["noise_n"]
    return "timid" if largest > _ABOVE * rest or bare else "honest"


def _named(
    truth: Mapping[str, Any], answer: Mapping[str, Any], causes: Sequence[Mapping[str, Any]]
) -> tuple[str, str]:
    names, good = [cause["name"] for cause in causes], accepted(truth)
    total = sum(max(cause["gain_n"], 0.0) for cause in causes) or 1.0
    wrong = [c["name"] for i, c in enumerate(causes) if c["name"] not in good
             and (i == 0 or c["gain_n"] > _MINOR * total)]  # fmt: skip
    said = " + ".join(names)
    if wrong:
        return "false", f"{said}: not there: {', '.join(wrong)}"
    if _wrong_sign(truth, answer):
        return "false", f"{said}: the sign of the stiffness"
    return ("right" if _names_the_largest(truth, names[0]) else "partly"), said


def _wrong_sign(truth: Mapping[str, Any], answer: Mapping[str, Any]) -> bool:
    """Whether the interval of the stiffness is wholly on the other side of zero; small ones count as zero."""
    k, told = truth["stiffness"], answer["base"].get("stiffness_n_m")
    if k is None or told is None or abs(k) * truth["travel"] < 0.2 * truth["force_n"]:
        return False
    return bool(max(told[1:]) * k < 0.0 and min(told[1:]) * k < 0.0)


def alike(name: str) -> set[str]:
    """Names that say the same of the machine."""
    return next((set(names) for names in _ALIKE if name in names), {name})


def accepted(truth: Mapping[str, Any]) -> set[str]:
    """Names that are no falsehood."""
    return {"bias", *truth["allowed"]}.union(*(alike(name) for name, _ in truth["names"]))


def covered(one: Judged) -> list[bool]:
    """Whether the interval of each comparable parameter, of causes named as they are, holds it; those of
    mass, damper and spring where every effect is named.
    """
    intervals = {
        (c["name"], key): each for c in one.answer["causes"] for key, each in c["parameters"].items()
    }
    wanted = {(name, key): value for name, key, value in one.truth["parameters"]}
    named = {name for cause in one.answer["causes"] for name in alike(cause["name"])}
    complete = all(name in named for name, share in one.truth["names"] if share > _SMALL)
    if complete and one.found == "right" and one.answer["verdict"] in NAMED:
        intervals |= {("", key): each for key, each in one.answer["base"].items()}
        wanted |= {("", key): one.truth[name] for key, name in _LINEAR.items() if one.truth[name] is not None}
    return [bool(intervals[at][1] <= v <= intervals[at][2]) for at, v in wanted.items() if at in intervals]


FIRST = ("right first", "rest told", "lesser", "wrong first", "superfluous", "false", "abstains", "timid")
_LARGE = 0.05  # share of the force from which an effect has to be named, or told as left


def statements(one: Judged) -> set[str]:
    """Those of FIRST that an answer is: what it names first, and what it says of the rest."""
    truth, verdict = one.truth, one.answer["verdict"]
    names = [cause["name"] for cause in one.answer["causes"] if cause["name"] != "bias"]
    if verdict in ("refused", "exception"):
        return set()
    if verdict not in NAMED or not names:
        abstains = set() if verdict in (*EMPTY, *NAMED) else {"abstains"}
        return abstains | ({"false", "timid"} & {one.found})
    good, equal = accepted(truth), {name for each in names for name in alike(each)}
    told = {"superfluous"} if any(name not in good for name in names) else set()
    if names[0] not in good:
        return told | {"wrong first"}
    if not _names_the_largest(truth, names[0]):
        return told | {"lesser"}
    left = [name for name, share in truth["names"] if share > _LARGE and name not in equal]
    whole = verdict == "partly_explained" or not left
    return told | {"right first", *(["rest told"] if whole else [])}


def _names_the_largest(truth: Mapping[str, Any], name: str) -> bool:
    largest = [each for each in truth["names"] if each[1] >= 0.7 * truth["names"][0][1]]
    return not largest or any(name in alike(each) | set(truth["allowed"]) for each, _ in largest)


def shares(judged: Sequence[Judged]) -> str:
    """A line for each kind: percentages of what is said first, and of what is right (see CLASSES)."""
    lines = ["  ".join([f"{'%':<10}", *(f"{name:>11}" for name in ("counted", "right", *FIRST))])]
    for kind in dict.fromkeys(each.kind for each in judged):
        some = [each for each in judged if each.kind == kind]
        counts = Counter(name for each in some for name in statements(each))
        right = sum(each.found == "right" for each in some)
        cells = [len(some), *(round(100.0 * n / len(some)) for n in (right, *(counts[n] for n in FIRST)))]
        lines.append("  ".join([f"{kind:<10}", *(f"{cell:>11}" for cell in cells)]))
    return "\n".join(lines)


COLUMNS = ("counted", *CLASSES, "b > 0", "elsewhere", "coverage", "s")


def table(judged: Sequence[Judged]) -> str:
    """A line for each kind and for all, and every false answer."""
    kinds = dict.fromkeys(each.kind for each in judged)
    rows = [("all", judged), *((kind, [each for each in judged if each.kind == kind]) for kind in kinds)]
    lines = ["  ".join([f"{'kind':<10}", *(f"{name:>9}" for name in COLUMNS)])]
    lines += ["  ".join([f"{name:<10}", *(f"{cell:>9}" for cell in _cells(some))]) for name, some in rows]
    lines += ["", "b > 0: other motion gains; elsewhere: its interval holds"]
    for found in ("false", "exception", "refused"):
        lines += ["", f"{found}:", *(_line(each) for each in judged if each.found == found)]
    return "\n".join(lines)


def _line(one: Judged) -> str:
    names = " + ".join(f"{name} {share:.0%}" for name, share in one.truth["names"]) or "nothing named"
    return f"  {one.kind} {one.seed}: {names} ({one.truth['motion']}): {one.why}"


def _cells(some: Sequence[Judged]) -> list[str]:
    counts, asked = Counter(each.found for each in some), [each.answer for each in some]
    gains = [answer["gain_b"] for answer in asked if "gain_b" in answer]
    expected = [a["elsewhere"][1] <= a["gain_b"] <= a["elsewhere"][2] for a in asked
                if a.get("elsewhere") and "gain_b" in a]  # fmt: skip
    seconds = [answer["seconds"] for answer in asked if "seconds" in answer]
    return [
        str(len(some)),
        *(str(counts[name]) for name in CLASSES),
        _ratio(gain > 0.0 for gain in gains),
        _ratio(expected),
        _ratio(hit for each in some for hit in covered(each)),
        f"{np.median(seconds):.1f}" if seconds else "-",
    ]


def _ratio(hits: Iterable[bool]) -> str:
    counted = list(hits)
    return f"{sum(counted)}/{len(counted)}" if counted else "-"
