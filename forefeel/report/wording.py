"""Numbers in words: SI prefixes, three digits, and a dash for what is not known."""

from collections.abc import Mapping
from math import floor, log10

from forefeel.report.model import CalibrationFigures, NotJudged

UNKNOWN = "–"
REASONS = {
    "not_followed": "not followed",
    "skipped": "skipped",
    "invalid_force": "invalid force",
    "not_predicted": "not predicted",
}
"""Why a command was not judged, see `NotJudged`."""
_PREFIXES = {-3: "n", -2: "µ", -1: "m", 0: ""}


def quantity(value: float | None, unit: str) -> str:
    """`value` in `unit` with three digits and a prefix from nano to none: 0.0123 N is `12.3 mN`."""
    if value is None:
        return UNKNOWN
    if value == 0.0:
        return f"0 {unit}"
    rounded = float(f"{value:.3g}")
    power = min(0, max(-3, floor(log10(abs(rounded)) / 3 + 1e-9)))
    return f"{rounded / 1000.0**power:.3g} {_PREFIXES[power]}{unit}"


def micros(value_us: float | None) -> str:
    """A time that is given in us."""
    return quantity(None if value_us is None else value_us * 1e-6, "s")


def share(value: float | None) -> str:
    """A share in per cent, never rounded up to 100."""
    if value is None:
        return UNKNOWN
    return f"{floor(value * 1000 + 1e-9) / 10:g} %"


def ratio(value: float | None) -> str:
    """A ratio with three digits."""
    return UNKNOWN if value is None else f"{value:#.3g}".rstrip(".")


def number(value: float | None) -> str:
    """An integer with thin gaps between the thousands, or a number with four digits."""
    if value is None:
        return UNKNOWN
    return (
        f"{value:,}".replace(",", "\N{NARROW NO-BREAK SPACE}") if isinstance(value, int) else f"{value:.4g}"
    )


def reasons(found: NotJudged) -> str:
    """Why commands were not judged, the most frequent reason first."""
    return in_order({words: getattr(found, name) for name, words in REASONS.items()})


def refused(counters: Mapping[str, int]) -> str:
    """How many commands the slave's gate refused, and by which rules."""
    start = "slave_refused_"
    rules = {name.removeprefix(start): n for name, n in counters.items() if name.startswith(start)}
    by_rule = in_order(rules)
    return f"{sum(rules.values())} refused{f' ({by_rule})' if by_rule else ''}"


def injected(counters: Mapping[str, int]) -> str:
    """What the injected impairment did to messages of both ends."""

    def total(what: str) -> int:
        return sum(
            n for name, n in counters.items() if name.startswith("impairment_") and name.endswith(what)
        )

    return ", ".join(f"{total(what)} {what}" for what in ("dropped", "duplicated", "delayed"))


def in_order(counts: Mapping[str, int]) -> str:
    """Numbers with their names, the largest first, without those that are zero."""
    return ", ".join(f"{n} {name}" for name, n in sorted(counts.items(), key=lambda each: -each[1]) if n)


def calibration(found: CalibrationFigures) -> str:
    """A calibration in one line."""
    who = f"{found.driver} {found.slot.replace('_', ' ')}, serial {found.serial}, calibrated {found.date}"
    if found.slot == "stage":
        scale = f"{number(found.native_per_m)} native units per m, zero at {number(found.zero)}"
        return f"{who}: {scale}, home found again within {quantity(found.repeatability_m, 'm')}"
    scale = f"{quantity(found.gain_n, 'N')} per native unit, zero at {number(found.zero)}"
    left = f"residual {quantity(found.residual_n, 'N')}, hysteresis {quantity(found.hysteresis_n, 'N')}"
    return f"{who}: {scale}, {left}"


def verdict(ratio_rms: float | None) -> str:
    """What the ratio of the errors means."""
    if ratio_rms is None:
        return "nothing to compare"
    if ratio_rms > 1:
        return "worse than holding the last force"
    return "better than holding the last force" if ratio_rms < 1 else "as good as holding the last force"
