"""The short table at the end of the command."""

from pathlib import Path

from forefeel.diagnosis.reproduction.results import Reproduction
from forefeel.report.text import DISCLAIMER
from forefeel.report.wording import quantity, ratio, share


def short_table(numbers: Reproduction, folder: Path) -> list[str]:
    """What was found, a line each."""
    flaws = numbers.flaws
    lines = [f"{line.subject:<42} {line.verdict}" for line in numbers.comparisons]
    found, fast = flaws.unidentifiable, flaws.memory.rows[0]
    ends = ", ".join(
        f"{row.forgetting_factor:g}: {quantity(row.overflow_s, 's')}" for row in flaws.windup.rows
    )
    bias = next(row for row in flaws.unmodelled.rows if row.what == "bias")
    lines += [
        f"(a) identifiable    m {found.paper[0]:.3g}, b {found.paper[1]:.3g}, k {found.paper[2]:.3g} for "
        f"{', '.join(f'{value:g}' for value in found.true)}; product: {'; '.join(found.product_says)}",
        f"(b) overflow        {ends}",
        f"(c) memory          {quantity(fast.paper_rms_n, 'N')} rms at {fast.rate_hz:g} Hz; "
        f"product {quantity(fast.product_rms_n, 'N')}",
        f"(d) bias            {quantity(bias.size_n, 'N')} leave {quantity(bias.paper_rms_n, 'N')}; "
        f"product {quantity(bias.product_rms_n, 'N')}",
        f"(f) pairing         {quantity(flaws.pairing.newest_rms_n, 'N')} rms, "
        f"hold {quantity(flaws.pairing.hold_rms_n, 'N')}",
        f"{'(e) rms over that of the hold':<48} {'paper':>8} {'tared':>8} {'product':>8}",
    ]
    lines += [
        f"    {row.name + (', simulated bench' if row.source == 'simulated bench' else ''):<44} "
        f"{ratio(row.paper_over_hold):>8} {ratio(row.tared_over_hold):>8} {ratio(row.product_over_hold):>8}"
        for row in flaws.baseline.rows
    ]
    if not flaws.baseline.recordings_given:
        lines.append("    no measured recordings given (--recordings DIR)")
    lines.append(
        f"{'Error not felt (29 mN or 7 %), share of time':<48} {'hold':>8} {'paper':>8} {'product':>8}"
    )
    shares = {(row.instrument, row.style, row.method): row.strict_share for row in numbers.thresholds.rows}
    for instrument, style in dict.fromkeys((key[0], key[1]) for key in shares):
        values = [shares[instrument, style, method] for method in ("hold", "paper", "product")]
        lines.append(f"    {f'{instrument}, {style}':<44} {' '.join(f'{share(v):>8}' for v in values)}")
    lines += [f"Files      reproduction.html, reproduction.json, figures in {folder}", DISCLAIMER]
    return lines
