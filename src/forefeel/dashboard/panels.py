"""Contents of the page's cards of one axis, as plain data for JSON. Pure: time is an argument."""

from collections.abc import Mapping
from math import isfinite
from typing import Any

import numpy as np

from forefeel.common.events.console import printable
from forefeel.common.events.text import UNKNOWN, quantity
from forefeel.common.lateness import FEW_MISSED
from forefeel.common.messages import LoopTiming, SafetyState
from forefeel.common.topics import (
    FORCE,
    HAPTICS,
    MASTER_STATE,
    MASTER_TIMING,
    PARAMETERS,
    SLAVE_STATE,
    SLAVE_TIMING,
)
from forefeel.dashboard.axis_view import AxisView
from forefeel.dashboard.detector import Signs
from forefeel.dashboard.event_log import Level
from forefeel.dashboard.indicators import safety_word
from forefeel.dashboard.trace import SPAN_S
from forefeel.report.vessel import friction
from forefeel.report.wording import micros, named, number, scale, share, statement_text

Card = dict[str, Any]
_FRESH_S = 0.5  # s for which a value is shown after it was heard, as long as `stale_after_s` of the states
_MODEL_S = 2.0  # s for which what the model says of itself counts after it was heard
# s for which a loop's lateness is shown after it was heard: it comes once a second, three may be lost
_TIMING_S = 3.5
_TICKS_OF_DELAY = 1000  # answered commands of which the delay is said, the last second at 1 kHz
_ROLES = ("master", "slave")
_MOST_PARAMETERS = 24  # rows of the table of parameters
_COUNTED = {
    "late": ("late",),
    "reordered": ("reordered", "sequence", "duplicat"),
    "lost": ("lost", "dropped", "missed"),
    "refused": ("refused", "malformed"),
}
"""Kinds of counters, by what their names hold; the first that fits."""


def numbers(view: AxisView, now_ns: int) -> Card:
    """Texts of the large figures: felt, predicted and measured force, delay; `UNKNOWN` or empty where none is
    fresh. Measured is the newest force that the master has; without a master the newest valid one heard here.
    """
    haptics, force = view.newest.haptics, view.newest.force
    fresh = _fresh(view, HAPTICS.name, now_ns)
    felt = haptics if fresh else None
    received = force if _fresh(view, FORCE.name, now_ns) and force is not None and force.valid else None
    return {
        "felt": _number_n(felt.rendered_n if felt else None),
        "limited": bool(felt and felt.limited),
        "predicted": _number_n(felt.predicted_n if felt else None),
        "band": _band(felt.low_n, felt.high_n) if felt else "",
        # what the hand has; without a master what is heard here, which may be sooner
        "measured": _number_n(felt.zoh_n if felt else received.force_n if received else None),
        "age": "" if felt is None or felt.force_age_s is None else f"{quantity(felt.force_age_s, 's')} old",
        "delay": UNKNOWN if felt is None or felt.delay_s is None else f"{1e3 * felt.delay_s:.0f}",
    }


def gain(view: AxisView, now_ns: int) -> Card:
    """Texts of the rms errors of prediction and late force over the last 20 s, and of the median delay; level
    `good` where the prediction's error is smaller, else `off`. `UNKNOWN` while too few forces were compared.
    """
    errors = view.comparison.errors(view.timeline.now_s(now_ns))
    delays_s = view.delays.rows()[-_TICKS_OF_DELAY:, 1]
    if errors is None or not len(delays_s):
        return {"level": "off", "name": "error of the prediction", "error": UNKNOWN, "more": "not judged yet"}
    predicted, late = (f"{1e3 * error_n:.{1 if error_n < 0.00995 else 0}f}" for error_n in errors)
    return {
        "level": "good" if errors.predicted_n < errors.late_n else "off",
        "name": f"error, {1e3 * float(np.median(delays_s)):.0f} ms ahead",
        "error": predicted,
        "more": f"the late force has {late} mN",
    }


def banner(view: AxisView) -> Card:
    """Reason of a latched stop and the command that clears it; empty texts while none is latched."""
    slave = view.newest.slave
    if slave is None or slave.state not in (SafetyState.ESTOPPED, SafetyState.FAULT):
        return {"head": "", "more": ""}
    return {
        "head": f"{safety_word(slave)}: {printable(slave.reason)}",
        "more": "To go on, on the slave's host: forefeel clear --config FILE, with the slave's file",
    }


def delay(view: AxisView, now_ns: int) -> str:
    """Text with the quantiles in ms of the round trips of the last minute, or that there are none."""
    rows = view.delays.rows()
    delays_s = rows[rows[:, 0] > now_ns * 1e-9 - SPAN_S, 1]
    if not len(delays_s):
        return "no answered command in the last minute"
    p50, p99, most = 1e3 * np.quantile(delays_s, [0.5, 0.99, 1.0])
    return f"median {p50:.4g} · 99 % {p99:.4g} · most {most:.4g} ms"


def model(view: AxisView, now_ns: int) -> Card:
    """Card of the newest model, however old: parameters (at most 24) with their uncertainty, sentences on
    which ones the motion can tell apart, rms innovation, and the friction to draw in the vessel. Before any
    model it has only a sentence.
    """
    latest = view.newest.model
    if latest is None:
        nothing = "the identification has said nothing yet"
        return {"parameters": [], "statements": [nothing], "foot": "", "friction": {}}
    quiet = "" if _fresh(view, PARAMETERS.name, now_ns) else " · not heard now"
    resets = f" · {number(latest.resets)} returns to the prior" if latest.resets else ""
    prior = f" · prior: {printable(latest.prior)}" if latest.prior else ""
    statements = [statement_text(printable(statement)) for statement in latest.identifiable]
    if not latest.valid:
        statements = ["not valid yet: too little motion so far", *statements]
    rows = zip(latest.names, latest.values, latest.standard_deviations, strict=False)
    return {
        "parameters": [_parameter(*row) for row in list(rows)[:_MOST_PARAMETERS]],
        "statements": statements or ["the motion tells all parameters apart"],
        "foot": f"innovation {quantity(latest.innovation_rms_n, 'N')} rms · {number(latest.updates)} updates"
        f"{resets}{prior}{quiet}",
        "friction": friction(latest.names, latest.values, latest.standard_deviations),
    }


def _parameter(name: str, value: float, deviation: float) -> Card:
    """Row of the table of parameters: label, value and deviation as texts in one prefixed unit, and how well
    it is known, in a word.
    """
    label, plain = named(printable(name))
    factor, unit = scale(plain, max(abs(value), deviation))
    return {
        "name": label,
        "value": f"{float(f'{factor * value:.3g}'):g}",
        "deviation": f"{float(f'{factor * deviation:.2g}'):g}",
        "unit": unit,
        "known": _known(value, deviation),
    }


def _known(value: float, deviation: float) -> str:
    if deviation <= 0.0:
        return "fixed"
    share = abs(value) / deviation
    return "well" if share > 10 else "roughly" if share > 2 else "not yet"


def energy(view: AxisView, now_ns: int) -> Card:
    """Net energy that the hand has put in, with its lowest; level `warn` where the handle has given more than
    it took, `off` without a fresh sample.
    """
    felt = view.newest.haptics
    if felt is None or not _fresh(view, HAPTICS.name, now_ns):
        return {"level": "off", "value": UNKNOWN, "words": "no hand heard"}
    level: Level = "good" if felt.energy_j >= 0.0 else "warn"
    words = "passive" if level == "good" else "the handle has given more than it took"
    lowest = f"lowest {quantity(view.worst_energy_j, 'J')}"
    return {"level": level, "value": quantity(felt.energy_j, "J"), "words": f"{words} · {lowest}"}


def watch(view: AxisView, now_ns: int) -> Card:
    """Answer whether the model fits: no (`warn`), with the worst signs of the alarm, else by the present ones
    yes (`good`), not yet (`busy`) or unknown (`off`). `since_s`: begin of the alarm on the listener's clock.
    """
    alarm, now_s = view.watch.alarm, view.timeline.now_s(now_ns)
    if alarm is None:
        signs = view.watch.signs if _fresh(view, PARAMETERS.name, now_ns, _MODEL_S) else Signs()
        level, since_s, how, word, next_ = "good", None, "", "Yes", ""
        if signs.innovation_ratio is None:
            level, word, next_ = "off", "Not known yet", "It needs a hand that moves."
        elif view.watch.misses_band:
            level, word, next_ = "busy", "Not yet", "It learns while the hand moves."
    else:
        signs, how = Signs(alarm.innovation_ratio, alarm.outside_share), "at worst "
        level, since_s = "warn", round(now_ns * 1e-9 - (now_s - alarm.since_s), 1)
        word, next_ = "No", "forefeel diagnose names the cause, from the recording."
    parts = []
    if signs.innovation_ratio is not None:
        parts.append(f"errors of the model {how}{signs.innovation_ratio:.1f} × the usual")
    if signs.outside_share is not None:
        parts.append(f"{share(signs.outside_share)} of the forces outside of the 95 % band")
    return {"level": level, "word": word, "since_s": since_s, "signs": " · ".join(parts), "next": next_}


def loops(view: AxisView, now_ns: int) -> list[Card]:
    """Lateness of both loops since they began; `UNKNOWN` for one that was not received lately."""
    topics = (MASTER_TIMING, SLAVE_TIMING)
    fresh = {topic.publisher for topic in topics if _fresh(view, topic.name, now_ns, _TIMING_S)}
    return [_loop(role, view.newest.timings.get(role) if role in fresh else None) for role in _ROLES]


def _loop(role: str, timing: LoopTiming | None) -> Card:
    """Card of the lateness of one loop, with a level by the share of missed ticks; None: not heard, `off`."""
    if timing is None:
        return {"who": role, "level": "off", "word": "not heard", "p50": UNKNOWN, "p99": UNKNOWN,
                "max": UNKNOWN, "missed": UNKNOWN}  # fmt: skip
    share = timing.missed / max(1, timing.ticks + timing.missed)
    level: Level = "bad" if share > 0.05 else "warn" if share > FEW_MISSED else "good"
    word = {"good": "on time", "warn": "late", "bad": "misses"}[level]
    return {
        "who": role,
        "level": level,
        "word": word,
        "p50": micros(timing.p50_us),
        "p99": micros(timing.p99_us),
        "max": micros(timing.max_us),
        "missed": number(timing.missed),
    }


def counted(view: AxisView, now_ns: int, local: Mapping[str, int] = {}) -> str:
    """Text with the numbers of late, reordered, lost and refused messages, by the counters of both ends and
    `local`; then caveats, then which end is not heard now. Other counters are left out.
    """
    states = view.newest.slave, view.newest.master
    counters = [local, *(state.counters for state in states if state is not None)]
    sums = dict.fromkeys(_COUNTED, 0)
    for name, count in (item for end in counters for item in end.items()):
        kind = next((kind for kind, marks in _COUNTED.items() if any(mark in name for mark in marks)), None)
        if kind is not None:
            sums[kind] += count
    parts = [f"{number(count)} {kind}" for kind, count in sums.items()]
    missing = [t.publisher for t in (SLAVE_STATE, MASTER_STATE) if not _fresh(view, t.name, now_ns)]
    caveats = {printable(caveat) for state in states if state is not None for caveat in state.caveats}
    return " · ".join([*parts, *sorted(caveats), *(f"{publisher} not heard now" for publisher in missing)])


def _fresh(view: AxisView, topic: str, now_ns: int, most_s: float = _FRESH_S) -> bool:
    heard_ns = view.newest.heard_ns.get(topic)
    return heard_ns is not None and (now_ns - heard_ns) * 1e-9 <= most_s


def _number_n(value_n: float | None) -> str:
    return UNKNOWN if value_n is None or not isfinite(value_n) else f"{value_n:.3f}"


def _band(low_n: float | None, high_n: float | None) -> str:
    return "" if low_n is None or high_n is None else f"95 %: {low_n:.3f} to {high_n:.3f}"
