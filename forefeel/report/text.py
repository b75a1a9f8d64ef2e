"""The report in ten lines for the terminal."""

from pathlib import Path

from forefeel.common.error_size import ErrorSize
from forefeel.common.limiter import MOTION_RULES
from forefeel.report.model import LoopFigures, RunReport
from forefeel.report.states import START_S
from forefeel.report.wording import injected, micros, quantity, ratio, reasons, refused, share

DISCLAIMER = "Research software, not a medical device."
_LONGEST = 99


def ten_lines(report: RunReport, directory: Path | None = None) -> list[str]:
    """Ten lines of fewer than 100 characters each. `directory`: where the files were written."""
    where = f" in {directory}" if directory else ""
    lines = [
        f"Run        {_what_ran(report)}",
        f"Prediction {_size(report.prediction)}; {report.commands.scored} of {report.commands.sent} "
        "commands scored",
        f"Hold       {_size(report.hold)}; prediction / hold {ratio(report.ratio.rms)}, "
        f"settled {ratio(report.settled.ratio.rms)}",
        f"Delay      {quantity(report.delay_s.p50, 's')} p50, {quantity(report.delay_s.p99, 's')} p99, "
        f"{quantity(report.delay_s.max, 's')} max; force age {quantity(report.force_age_s.p50, 's')}; "
        f"clocks {_clock(report)}",
        f"Armed      {share(report.armed_share)} from the first arming (or {START_S:g} s) "
        f"to the session's end; {_count(report.stops)} unchosen stops",
        f"Loops      p50/p99 late: {_loop('master', report.loop.master)}; "
        f"{_loop('slave', report.loop.slave)}",
        f"Not judged {_not_judged(report)}",
        f"Counters   {_counters(report)}",
        f"Files      report.html, report.json{where}",
        DISCLAIMER,
    ]
    return [_fitted(line) for line in lines]


def _what_ran(report: RunReport) -> str:
    ended = ", cut short" if report.truncated else ""
    return (
        f"{report.recording}: {report.duration_s:.1f} s{ended}, axis {report.axis or 'none'}, "
        f"impairment {report.impairment or 'unknown'}, seed {report.seed or 'unknown'}"
    )


def _size(size: ErrorSize) -> str:
    return (
        f"{quantity(size.rms_n, 'N')} rms, {quantity(size.p95_n, 'N')} p95, {quantity(size.max_n, 'N')} max"
    )


def _loop(role: str, loop: LoopFigures) -> str:
    return f"{role} {micros(loop.p50_us)}/{micros(loop.p99_us)}, {_count(loop.missed)} missed"


def _clock(report: RunReport) -> str:
    clock = report.clock
    return "unknown" if clock.bound_s is None else f"±{quantity(clock.bound_s, 's')} ({clock.grade})"


def _not_judged(report: RunReport) -> str:
    commands = report.commands
    why = reasons(commands.reasons)
    return f"{commands.not_judged} of {commands.sent} sent{f': {why}' if why else ''}"


def _counters(report: RunReport) -> str:
    limited = sum(report.counters.get(f"limit_{rule}", 0) for rule in MOTION_RULES)
    return f"{limited} limited; on purpose {injected(report.counters)}; {refused(report.counters)}"


def _count(value: int | None) -> str:
    return "unknown" if value is None else str(value)


def _fitted(line: str) -> str:
    """One printable line: names in a recording may hold anything."""
    clean = "".join(c if c.isprintable() else "?" for c in line)
    return clean if len(clean) <= _LONGEST else f"{clean[: _LONGEST - 3]}..."
