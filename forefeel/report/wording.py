"""Numbers in words: SI prefixes, three digits, and a dash for what is not known."""

from math import floor, log10

from forefeel.report.model import CalibrationFigures

UNKNOWN = "–"
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
