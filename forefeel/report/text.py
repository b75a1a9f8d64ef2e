"""The report in ten lines for the terminal."""

from pathlib import Path

from common.error_size import ErrorSize
from common.limiter import MOTION_RULES
from forefeel.report.model import LoopFigures, RunReport
from forefeel.report.states import START_S
from forefeel.report.wording import micros, quantity, ratio, share

DISCLAIMER = "Research software, not a medical device."
_LONGEST = 99


def ten_lines(report: RunReport, directory: Path | None = None) -> list[str]:
    """Ten lines of fewer than 100 characters each. `directory`: where the files were written."""
    where = f" in {directory}" if directory else ""
    lines = [
        f"Run        {_what_ran(report)}",
        f"Prediction {_size(report.prediction)}; {report.commands.scored} commands scored, "
        f"{share(report.commands.answered_share)} answered",
        f"Hold       {_size(report.hold)}; prediction / hold {ratio(report.ratio.rms)}, "
        f"settled {ratio(report.settled.ratio.rms)}",
        f"Delay      {quantity(report.delay_s.p50, 's')} median, {quantity(report.delay_s.p99, 's')} p99, "
        f"{quantity(report.delay_s.max, 's')} max; force age {quantity(report.force_age_s.p50, 's')} median",
        f"Armed      {share(report.armed_share)} since the first arming (or {START_S:g} s); "
        f"{_count(report.stops)} stops that the operator did not choose",
        f"Loops      p50 / p99 late: {_loop('master', report.loop.master)}; "
        f"{_loop('slave', report.loop.slave)}",
        f"Clock      {_clock(report)}",
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
    return f"{role} {micros(loop.p50_us)} / {micros(loop.p99_us)}, {_count(loop.missed)} missed"


def _clock(report: RunReport) -> str:
    clock = report.clock
    if clock.bound_s is None:
        return "offset unknown"
    return f"offset {quantity(clock.offset_s, 's')} within ±{quantity(clock.bound_s, 's')} ({clock.grade})"


def _counters(report: RunReport) -> str:
    def total(start: str, end: str = "") -> int:
        return sum(n for name, n in report.counters.items() if name.startswith(start) and name.endswith(end))

    return (
        f"{sum(total(f'limit_{rule}') for rule in MOTION_RULES)} limited, {total('slave_refused_')} refused, "
        f"{total('impairment_', '_lost')} lost and "
        f"{total('impairment_', '_duplicated')} duplicated on purpose"
    )


def _count(value: int | None) -> str:
    return "unknown" if value is None else str(value)


def _fitted(line: str) -> str:
    """One printable line: names in a recording may hold anything."""
    clean = "".join(c if c.isprintable() else "?" for c in line)
    return clean if len(clean) <= _LONGEST else f"{clean[: _LONGEST - 3]}..."
