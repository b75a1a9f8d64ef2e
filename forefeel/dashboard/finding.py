"""What the live diagnosis says: whether the model fits, since when not, and what is the matter. Pure."""

from dataclasses import dataclass
from typing import Any, Literal

from forefeel.common.topics import PARAMETERS
from forefeel.dashboard.axis_view import AxisView
from forefeel.dashboard.detector import Alarm, Signs
from forefeel.dashboard.levels import BAD, GOOD, OFF, WARN
from forefeel.dashboard.lights import SILENT_NS
from forefeel.report.wording import share

LEAST_S = 12.0
"""A shorter stretch tells little of anything slow."""
MOST_S = 60.0  # s, longest stretch that is diagnosed: what `samples` of an axis hold
# s after the begin of the alarm that are left out: a block and a half of the detector
_SETTLING_S = 1.5
Past = Literal["live", "whole", "part"]
_PART = {
    "level": OFF,
    "word": "no change in sight",
    "headline": "Compared with the seconds before only. Played from its begin it is judged as a whole.",
}
_ASK = "forefeel diagnose FILE names the cause."


@dataclass(frozen=True, slots=True)
class LiveDiagnosis:
    """The last diagnosis of an axis, of the `span_s` seconds up to `until_s`.

    `since_s`: when the model went wrong. `headline` empty: it is at work. `causes`: one line each.
    `final`: it is not done again.
    """

    since_s: float
    span_s: float
    until_s: float
    headline: str = ""
    causes: tuple[str, ...] = ()
    final: bool = False


def wanted_s(alarm: Alarm | None, last: LiveDiagnosis | None, now_s: float) -> float | None:
    """How many of the last seconds are to be diagnosed now; None: nothing is.

    What came before the model went wrong is left out, for a diagnosis explains its stretch as a whole. It is
    done again when as much again has come, until it names a cause.
    """
    if alarm is None:
        return None
    span_s = min(now_s - alarm.since_s - _SETTLING_S, MOST_S)
    if span_s < LEAST_S:
        return None
    if last is None or last.since_s != alarm.since_s:
        return span_s
    return None if last.final or now_s - last.until_s < last.span_s else span_s


def watch_card(
    view: AxisView, finding: LiveDiagnosis | None, now_ns: int, past: Past = "live"
) -> dict[str, Any]:
    """The card of the live diagnosis; `since_s` on the clock of who listens.

    `past`: what came before; of a recording nothing is diagnosed, and what is usual may not be known.
    """
    alarm = view.watch.alarm
    now_s = view.timeline.now_s(now_ns)
    if alarm is None:
        signs = view.watch.signs if _heard(view, now_ns) else Signs()
        return _calm(signs, finding) | (_PART if past == "part" else {})
    known = finding if finding is not None and finding.since_s == alarm.since_s else None
    level = BAD if known is not None and known.causes else WARN
    return {
        "level": level,
        "word": "the model is wrong",
        "since_s": round(now_ns * 1e-9 - (now_s - alarm.since_s), 1),
        "signs": _signs(Signs(alarm.innovation_ratio, alarm.outside_share), "at worst "),
        "headline": _stage(known, now_s - alarm.since_s) if past == "live" else _ASK,
        "causes": [] if known is None else list(known.causes),
    }


def _calm(signs: Signs, finding: LiveDiagnosis | None) -> dict[str, Any]:
    known = signs.innovation_ratio is not None
    before = "" if finding is None or not finding.headline else f"Before: {_in_one(finding)}"
    return {
        "level": GOOD if known else OFF,
        "word": "the model fits" if known else "nothing to judge by",
        "since_s": None,
        "signs": _signs(signs, "") if known else "needs a hand that moves and forces that answer",
        "headline": before,
        "causes": [],
    }


def _heard(view: AxisView, now_ns: int) -> bool:
    heard_ns = view.newest.heard_ns.get(PARAMETERS.name)
    return heard_ns is not None and now_ns - heard_ns <= SILENT_NS


def _in_one(finding: LiveDiagnosis) -> str:
    return " ".join([finding.headline, "; ".join(finding.causes)]).strip()


def _signs(signs: Signs, how: str) -> str:
    parts = []
    if signs.innovation_ratio is not None:
        parts.append(f"errors of the model {how}{signs.innovation_ratio:.1f} × the usual")
    if signs.outside_share is not None:
        parts.append(f"{share(signs.outside_share)} of the forces outside of the 95 % band")
    return " · ".join(parts)


def _stage(known: LiveDiagnosis | None, elapsed_s: float) -> str:
    if known is None:
        left_s = LEAST_S + _SETTLING_S - elapsed_s
        return f"The cause is looked for in {left_s:.0f} s." if left_s > 0.5 else "The cause is looked for."
    if not known.headline:
        return f"Diagnosing {known.span_s:.0f} s of data …"
    return f"From {known.span_s:.0f} s: {known.headline}"
